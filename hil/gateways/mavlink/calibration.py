"""Calibrations that ground stations ask for. A simulated sensor has none: each is answered as done, as ArduSub would.

Public: answer, COMMANDS. It must not know sockets or the vehicle.
"""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

SENSORS = {0: "gyroscope", 1: "compass", 2: "barometer", 3: "remote control", 5: "motors' field", 6: "barometer"}
ACCELEROMETER = {1: "accelerometer", 2: "level", 4: "accelerometer", 76: "accelerometer"}  # by the fifth parameter
ALL_SIDES = 1  # of the fifth parameter: QGroundControl then waits for the command of the last side
FITNESS = 1.0  # mGauss, of a compass; QGroundControl warns from 16 on
COMMANDS = (
    dialect.MAV_CMD_PREFLIGHT_CALIBRATION, dialect.MAV_CMD_DO_START_MAG_CAL, dialect.MAV_CMD_DO_ACCEPT_MAG_CAL,
    dialect.MAV_CMD_DO_CANCEL_MAG_CAL, dialect.MAV_CMD_FIXED_MAG_CAL_YAW, dialect.MAV_CMD_ACCELCAL_VEHICLE_POS,
)  # fmt: skip


def answer(command: int, params: tuple[float, ...]) -> tuple[list[str], list[Any]]:
    """Return the texts and messages that report a calibration as done."""
    if command == dialect.MAV_CMD_DO_START_MAG_CAL:
        mask = int(params[0]) if 0.0 < params[0] < 256.0 else 1
        report = dialect.MAVLink_mag_cal_report_message(
            0, mask, dialect.MAG_CAL_SUCCESS, 1, FITNESS, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0
        )
        return ["compass: calibrated"], [report]
    if command != dialect.MAV_CMD_PREFLIGHT_CALIBRATION:
        return [], []
    asked = [name for index, name in SENSORS.items() if params[index] not in (0.0, -1.0)]
    asked += [ACCELEROMETER[int(params[4])]] if params[4] in ACCELEROMETER else []
    done = dialect.MAVLink_command_long_message(
        0, 0, dialect.MAV_CMD_ACCELCAL_VEHICLE_POS, 0, dialect.ACCELCAL_VEHICLE_POS_SUCCESS, *[0.0] * 6
    )
    return [f"{name}: calibrated" for name in asked], [done] if params[4] == ALL_SIDES else []

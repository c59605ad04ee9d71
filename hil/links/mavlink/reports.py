"""Status messages of the ends of a MAVLink thruster link: heartbeat, system status, ESC telemetry."""

import math
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import ThrusterTelemetry
from hil.links.mavlink.settings import EscReading

MAVLINK_VERSION = 3  # in a HEARTBEAT, for MAVLink 1 and 2
NOT_MEASURED = {"load": 0, "voltage_battery": 0xFFFF, "current_battery": -1, "battery_remaining": -1}

_ESC_MESSAGES = (
    dialect.MAVLink_esc_telemetry_1_to_4_message,
    dialect.MAVLink_esc_telemetry_5_to_8_message,
    dialect.MAVLink_esc_telemetry_9_to_12_message,
    dialect.MAVLink_esc_telemetry_13_to_16_message,
)
GROUP = 4  # ESCs in each

RPM = 2.0 * math.pi / 60.0  # rad/s
CENTI = 0.01
MAH = 3.6  # A s
U8, U16 = 0xFF, 0xFFFF


def encode_host_heartbeat() -> Any:
    """Return the HEARTBEAT of an onboard controller."""
    return _heartbeat(dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, dialect.MAV_STATE_ACTIVE)


def encode_device_heartbeat(report: ThrusterTelemetry) -> Any:
    """Return the HEARTBEAT of the device that sent `report`.

    Its type is a submarine with a generic autopilot, because a ground station sends nothing to other types.
    """
    state = dialect.MAV_STATE_ACTIVE if report.armed else dialect.MAV_STATE_STANDBY
    return _heartbeat(
        dialect.MAV_TYPE_SUBMARINE,
        dialect.MAV_AUTOPILOT_GENERIC,
        dialect.MAV_MODE_FLAG_SAFETY_ARMED if report.armed else 0,
        dialect.MAV_STATE_CRITICAL if report.timed_out else state,
    )


def _heartbeat(kind: int, autopilot: int, base_mode: int, status: int) -> Any:
    return dialect.MAVLink_heartbeat_message(kind, autopilot, base_mode, 0, status, MAVLINK_VERSION)


def encode_sys_status(report: ThrusterTelemetry) -> Any:
    """Return the SYS_STATUS of the device that sent `report`: the health of its outputs, and its counters."""
    outputs = dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    return dialect.MAVLink_sys_status_message(
        onboard_control_sensors_present=outputs,
        onboard_control_sensors_enabled=outputs if report.armed else 0,
        onboard_control_sensors_health=0 if report.timed_out else outputs,
        **NOT_MEASURED,
        drop_rate_comm=0,
        errors_comm=report.errors,
        errors_count1=report.watchdog_trips,
        errors_count2=report.frames,
        errors_count3=0,
        errors_count4=0,
    )


def encode_esc_telemetry(esc: Sequence[EscReading], count: int) -> list[Any]:
    """Return ESC_TELEMETRY of these readings (up to 16); `count` is how often the ESCs have been read (wraps)."""
    return [_ESC_MESSAGES[i // GROUP](*_columns(esc[i : i + GROUP], count)) for i in range(0, len(esc), GROUP)]


def _columns(group: Sequence[EscReading], count: int) -> list[list[int]]:
    """Return temperature, voltage, current, totalcurrent, rpm and count, in the message's order, for four ESCs each."""
    columns = [
        [_whole_units(esc.temperature, 1.0, U8) for esc in group],
        [_whole_units(esc.voltage, CENTI, U16) for esc in group],
        [_whole_units(esc.current, CENTI, U16) for esc in group],
        [_whole_units(esc.charge, MAH, U16) for esc in group],
        [_whole_units(abs(esc.speed), RPM, U16) for esc in group],
        [count & U16 for _ in group],
    ]
    return [column + [0] * (GROUP - len(group)) for column in columns]


def _whole_units(value: float, unit: float, top: int) -> int:
    """Return the value in whole units, limited to the field's range; nan gives 0."""
    return round(min(max(0.0, value / unit), top))

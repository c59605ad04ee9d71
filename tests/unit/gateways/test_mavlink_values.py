"""Every field of the messages of state and sensors, for one vehicle whose numbers differ from each other."""

from math import atan2, cos, degrees, hypot, inf, nan, radians, sin
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.client.samples import State
from hil.gateways.mavlink.protocols.streams import number_of
from hil.gateways.mavlink.snapshot import Context, Echo, Origin, Snapshot
from hil.gateways.mavlink.telemetry import BUILDERS, status_text
from hil.ros.joints import MotorState
from sim.geodesy import TangentPlane
from sim.rotations import from_euler, rotate
from sim.sensors.extra_samples import BatterySample, FixSample
from sim.sensors.samples import ImuSample

NU = (1.0, -0.5, 0.25, 0.01, 0.02, 0.03)
ATTITUDE, LEVEL = from_euler(0.1, -0.2, 1.2), (1.0, 0.0, 0.0, 0.0)
NORTH, EAST, DOWN = rotate(ATTITUDE, NU[:3])
BATTERY = BatterySample(0, 14.8, 2.5, 2.5, 10.0, False)
FIX = FixSample(0, 45.1234567, -10.7654321, 12.3, (0.25, 0.04), True)
VEHICLE = Snapshot(
    State(0, (10.0, -20.0, 5.0), ATTITUDE, NU), BATTERY, 121_325.0, Echo(7.5, 0.3, 50.0), FIX,
    pulses=(1500, 1620, 0, 1298), sensors=frozenset(("imu", "gps", "battery")), slave_load=0.37,
    imu=ImuSample(0, ATTITUDE, (0.1, 0.2, -0.3), (0.5, -1.5, -9.0)), field=(20e-6, -5e-6, 40e-6),
)  # fmt: skip
ORIGIN = Origin(45.0, 10.0, 100.0)
AROUND = Context(
    12_345_678_901, 1_700_000_000_123_456_789, (1.0, 2.0, 0.5), ORIGIN, TangentPlane(*ORIGIN), True, (13.0, -16.0, 8.0),
    (1100, 1900), {"Turns": 2.5}, {9: 1234}, 30.0,
)  # fmt: skip
NOW = {"time_boot_ms": 12_345}
NOW_US = {"time_usec": 12_345_678}
PLACE = {"lat": pytest.approx(450_000_900, abs=5), "lon": pytest.approx(99_997_463, abs=5)}
ANGLES = {"roll": 0.1, "pitch": -0.2, "yaw": 1.2}
RATES = {"rollspeed": 0.01, "pitchspeed": 0.02, "yawspeed": 0.03}
SPEEDS = {"vx": NORTH, "vy": EAST, "vz": DOWN}
SCALED = {
    "xacc": 51, "yacc": -153, "zacc": -918, "xgyro": 100, "ygyro": 200, "zgyro": -300,
    "xmag": 200, "ymag": -50, "zmag": 400,
}  # fmt: skip
HERE = dict(zip(("x", "y", "z"), (10.0, -20.0, 5.0), strict=True))
UNKNOWN = pytest.approx([nan, *[0.0] * 20], nan_ok=True)
PRESENT = (
    dialect.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION | dialect.MAV_SYS_STATUS_AHRS
    | dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | dialect.MAV_SYS_STATUS_SENSOR_GPS | dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    | dialect.MAV_SYS_STATUS_PREARM_CHECK | dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
)  # fmt: skip
HEALTHY = PRESENT | dialect.MAV_SYS_STATUS_GEOFENCE
RELATIVE = (
    dialect.EKF_ATTITUDE | dialect.EKF_VELOCITY_HORIZ | dialect.EKF_VELOCITY_VERT | dialect.EKF_POS_HORIZ_REL
    | dialect.EKF_POS_VERT_ABS | dialect.EKF_PRED_POS_HORIZ_REL
)  # fmt: skip


def message(name: str, vehicle: Snapshot = VEHICLE, around: Context = AROUND) -> Any:
    return BUILDERS[number_of(name)](vehicle, around)


def check(found: Any, fields: dict[str, Any]) -> None:
    """Compare fields; those of the message are 32-bit floats at best."""
    for name, wanted in fields.items():
        value = getattr(found, name)
        assert value == (pytest.approx(wanted, rel=1e-6, nan_ok=True) if isinstance(wanted, float) else wanted), name


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("ATTITUDE", NOW | ANGLES | RATES),
        ("ATTITUDE_QUATERNION", NOW | RATES | dict(zip(("q1", "q2", "q3", "q4"), ATTITUDE, strict=True))),
        ("AHRS2", ANGLES | {"altitude": 95.0, "lat": PLACE["lat"], "lng": PLACE["lon"]}),
        (
            "GLOBAL_POSITION_INT",
            NOW | PLACE | {name: round(100.0 * value) for name, value in SPEEDS.items()}
            | {"alt": 95_000, "relative_alt": -4500, "hdg": 6875},
        ),
        ("LOCAL_POSITION_NED", NOW | HERE | SPEEDS),
        (
            "VFR_HUD",
            {"airspeed": 1.0, "groundspeed": hypot(NORTH, EAST), "heading": 69, "throttle": 50, "alt": -5.0,
             "climb": -DOWN},
        ),
        (
            "HOME_POSITION",
            {"x": 1.0, "y": 2.0, "z": 0.5, "altitude": 99_500, "time_usec": 1_700_000_000_123_456,
             "latitude": pytest.approx(450_000_090, abs=5), "longitude": pytest.approx(100_000_254, abs=5),
             "q": [1.0, 0.0, 0.0, 0.0]},
        ),
        (
            "EKF_STATUS_REPORT",
            {"flags": RELATIVE | dialect.EKF_POS_HORIZ_ABS | dialect.EKF_PRED_POS_HORIZ_ABS},
        ),
        ("AHRS", {}), ("VIBRATION", NOW_US), ("EXTENDED_SYS_STATE", {}),
        (
            "SERVO_OUTPUT_RAW",
            NOW_US | {"servo1_raw": 1500, "servo2_raw": 1620, "servo3_raw": 0, "servo4_raw": 1298, "servo5_raw": 0,
                      "servo9_raw": 1234, "servo16_raw": 0},
        ),
        (
            "SYS_STATUS",
            {"onboard_control_sensors_present": PRESENT, "onboard_control_sensors_enabled": PRESENT,
             "onboard_control_sensors_health": HEALTHY, "load": 370, "voltage_battery": 14_800,
             "current_battery": 250, "battery_remaining": 25},
        ),
        (
            "NAV_CONTROLLER_OUTPUT",
            {"nav_roll": degrees(0.1), "nav_pitch": degrees(-0.2), "nav_bearing": 53, "target_bearing": 53,
             "wp_dist": 5, "alt_error": -3.0, "aspd_error": 0.0, "xtrack_error": 0.0},
        ),
        (
            "ODOMETRY",
            NOW_US | HERE | RATES | {"frame_id": 1, "child_frame_id": 12, "vx": 1.0, "vy": -0.5, "vz": 0.25,
                                     "estimator_type": dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT,
                                     "q": pytest.approx(ATTITUDE, rel=1e-6), "pose_covariance": UNKNOWN,
                                     "velocity_covariance": UNKNOWN},
        ),
        (
            "ALTITUDE",
            NOW_US | {"altitude_monotonic": -5.0, "altitude_amsl": 95.0, "altitude_local": -5.0,
                      "altitude_relative": -4.5, "altitude_terrain": nan, "bottom_clearance": 7.5},
        ),
        ("GPS_GLOBAL_ORIGIN", NOW_US | {"latitude": 450_000_000, "longitude": 100_000_000, "altitude": 100_000}),
        ("RC_CHANNELS", NOW | {"chancount": 2, "chan1_raw": 1100, "chan2_raw": 1900, "chan3_raw": 0, "rssi": 255}),
        (
            "GIMBAL_DEVICE_ATTITUDE_STATUS",
            NOW | {"q": [cos(radians(15.0)), 0.0, sin(radians(15.0)), 0.0], "gimbal_device_id": 1,
                   "flags": dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME}
            | dict.fromkeys([f"angular_velocity_{axis}" for axis in "xyz"] + ["delta_yaw", "delta_yaw_velocity"], nan),
        ),
        (
            "DISTANCE_SENSOR",
            NOW | {"min_distance": 30, "max_distance": 5000, "current_distance": 750, "orientation": 25,
                   "type": dialect.MAV_DISTANCE_SENSOR_ULTRASOUND, "covariance": 255},
        ),
        ("RANGEFINDER", {"distance": 7.5}),
        ("SCALED_PRESSURE", NOW | {"press_abs": 1213.25, "temperature": 2000}),
        ("SCALED_IMU2", NOW | SCALED),
        ("RAW_IMU", NOW_US | SCALED),
        (
            "HIGHRES_IMU",
            NOW_US | {"xacc": 0.5, "yacc": -1.5, "zacc": -9.0, "xgyro": 0.1, "ygyro": 0.2, "zgyro": -0.3, "xmag": 0.2,
                      "ymag": -0.05, "zmag": 0.4, "abs_pressure": 1213.25, "fields_updated": 0x3FF},
        ),
        ("POWER_STATUS", {"flags": dialect.MAV_POWER_STATUS_BRICK_VALID}),
        (
            "BATTERY_STATUS",
            {"voltages": [14_800, *[0xFFFF] * 9], "current_battery": 250, "current_consumed": 7500,
             "battery_remaining": 25, "charge_state": dialect.MAV_BATTERY_CHARGE_STATE_OK, "temperature": 32_767,
             "battery_function": dialect.MAV_BATTERY_FUNCTION_ALL, "type": dialect.MAV_BATTERY_TYPE_LION,
             "energy_consumed": -1},
        ),
        (
            "GPS_RAW_INT",
            {"time_usec": 1_700_000_000_123_456, "fix_type": 3, "lat": 451_234_567, "lon": -107_654_321, "alt": 12_300,
             "vel": round(100.0 * hypot(NORTH, EAST)), "h_acc": 500, "v_acc": 200,
             "cog": round(100.0 * degrees(atan2(EAST, NORTH))), "alt_ellipsoid": 12_300,
             "eph": 0xFFFF, "epv": 0xFFFF, "satellites_visible": 10},
        ),
        ("SYSTEM_TIME", NOW | {"time_unix_usec": 1_700_000_000_123_456}),
    ],
)  # fmt: skip
def test_each_field_has_its_value(name: str, fields: dict[str, Any]) -> None:
    found = message(name)
    check(found, fields)
    rest = {other: getattr(found, other) for other in found.fieldnames if other not in fields}
    assert not any(value if isinstance(value, (int, float)) else any(value) for value in rest.values()), rest


BARE = Snapshot(VEHICLE.state)
HERE_NED = VEHICLE.state.position
ALMOST_NORTH = State(0, HERE_NED, from_euler(0.0, 0.0, -1e-6), (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
FAST = State(0, (0.0, 1e6, 5.0), LEVEL, (400.0, -400.0, 0.0, 0.0, 0.0, 0.0))
NOWHERE = AROUND._replace(origin=None, plane=None, target=None, ready=False)


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("GLOBAL_POSITION_INT", {"lat": 0, "lon": 0, "alt": -5000}),
        ("EKF_STATUS_REPORT", {"flags": RELATIVE}),
        ("NAV_CONTROLLER_OUTPUT", {"nav_bearing": 0, "wp_dist": 0, "alt_error": 0.0}),
        ("VFR_HUD", {"throttle": 0}), ("SERVO_OUTPUT_RAW", {"servo1_raw": 0}),
        ("ALTITUDE", {"bottom_clearance": nan}),
        ("POWER_STATUS", {"flags": 0}),
        ("GPS_RAW_INT", dict.fromkeys(("fix_type", "lat", "lon", "alt", "satellites_visible"), 0)
         | dict.fromkeys(("vel", "cog", "eph", "epv"), 0xFFFF)),
        (
            "SYS_STATUS",
            {"voltage_battery": 0, "current_battery": -1, "battery_remaining": -1, "load": 0,
             "onboard_control_sensors_health": dialect.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
             | dialect.MAV_SYS_STATUS_AHRS | dialect.MAV_SYS_STATUS_GEOFENCE
             | dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS},
        ),
    ],
)  # fmt: skip
def test_what_a_bare_vehicle_lacks_is_marked(name: str, fields: dict[str, Any]) -> None:
    check(message(name, BARE, NOWHERE), fields)


@pytest.mark.parametrize(
    "name",
    ["HOME_POSITION", "GPS_GLOBAL_ORIGIN", "DISTANCE_SENSOR", "RANGEFINDER", "SCALED_PRESSURE", "SCALED_IMU", "RAW_IMU",
     "HIGHRES_IMU", "BATTERY_STATUS", "ESC_TELEMETRY_1_TO_4"],
)  # fmt: skip
def test_a_message_without_contents_is_not_sent(name: str) -> None:
    assert not message(name, BARE, NOWHERE)
    assert not message("RANGEFINDER", VEHICLE._replace(echo=Echo(inf, 0.3, 50.0)))


@pytest.mark.parametrize(
    ("name", "change", "fields"),
    [
        ("DISTANCE_SENSOR", {"echo": Echo(inf, 0.3, 50.0)}, {"current_distance": 5001}),
        ("DISTANCE_SENSOR", {"echo": Echo(inf, 0.3, 900.0)}, {"current_distance": 0xFFFF, "max_distance": 0xFFFF}),
        ("HIGHRES_IMU", {"field": None, "pascal": None}, {"fields_updated": 0x3F, "xmag": 0.0, "abs_pressure": 0.0}),
        ("SCALED_IMU", {"field": None}, {"xmag": 0, "xacc": 51}),
        ("POWER_STATUS", {"battery": BATTERY._replace(cut_off=True)}, {"flags": 0}),
        (
            "BATTERY_STATUS",
            {"battery": BATTERY._replace(cut_off=True, charge=11.0, voltage=-1.0)},
            {"charge_state": dialect.MAV_BATTERY_CHARGE_STATE_FAILED, "battery_remaining": 100, "current_consumed": 0,
             "voltages": [0, *[0xFFFF] * 9]},
        ),
        ("BATTERY_STATUS", {"battery": BATTERY._replace(capacity=0.0, charge=0.0)}, {"battery_remaining": -1}),
        (
            "SYS_STATUS",
            {"battery": BATTERY._replace(cut_off=True), "link_silent": True, "slave_load": 3.0},
            {"onboard_control_sensors_health": HEALTHY & ~dialect.MAV_SYS_STATUS_SENSOR_BATTERY
             & ~dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS, "load": 1000},
        ),
        *[(name, {"battery": BATTERY._replace(current=999.0, voltage=99.0)}, {"current_battery": 32_767})
          for name in ("SYS_STATUS", "BATTERY_STATUS")],
        ("SYS_STATUS", {"battery": BATTERY._replace(voltage=99.0)}, {"voltage_battery": 0xFFFE}),
        ("GLOBAL_POSITION_INT", {"state": FAST}, {"vx": 32_767, "vy": -32_767, "vz": 0}),
        ("NAV_CONTROLLER_OUTPUT", {"state": FAST}, {"wp_dist": 0xFFFF, "target_bearing": 270}),
        ("RAW_IMU", {"imu": ImuSample(0, ATTITUDE, (99.0, -99.0, nan), (0.0,) * 3)},
         {"xgyro": 32_767, "ygyro": -32_767, "zgyro": 0}),
        ("DISTANCE_SENSOR", {"echo": Echo(700.0, 0.3, 50.0)}, {"current_distance": 0xFFFF}),
        ("GPS_RAW_INT", {"fix": FIX._replace(fix=False)}, {"fix_type": 1, "lat": 0, "h_acc": 0}),
        ("VFR_HUD", {"pulses": (1500, 2100)}, {"throttle": 100}), ("VFR_HUD", {"pulses": (0, 1499)}, {"throttle": 0}),
        ("GPS_RAW_INT", {"state": State(0, HERE_NED, ATTITUDE, (900.0, *NU[1:]))}, {"vel": 0xFFFE}),
        ("GPS_RAW_INT", {"state": ALMOST_NORTH}, {"cog": 0}),
        ("GLOBAL_POSITION_INT", {"state": ALMOST_NORTH}, {"hdg": 0}),
        ("VFR_HUD", {"state": ALMOST_NORTH}, {"heading": 0, "climb": 0.0, "groundspeed": 1.0}),
    ],
)  # fmt: skip
def test_limits_and_faults_are_shown(name: str, change: dict[str, Any], fields: dict[str, Any]) -> None:
    check(message(name, VEHICLE._replace(**change)), fields)


def test_values_of_the_panel_are_named() -> None:
    (row,) = message("NAMED_VALUE_FLOAT")
    check(row, NOW | {"name": "Turns", "value": 2.5})


@pytest.mark.parametrize(("battery", "volts"), [(BATTERY, 1480), (None, 0)])
def test_currents_of_motors_have_no_sign(battery: BatterySample | None, volts: int) -> None:
    motors = (MotorState(1300, -100.0, -2.0), *[MotorState(1500, nan, nan)] * 4)
    found, _ = message("ESC_TELEMETRY_1_TO_4", VEHICLE._replace(battery=battery, motors=motors))
    check(found, {"rpm": [955, 0, 0, 0], "voltage": [volts] * 4, "current": [200, 0, 0, 0], "count": [0] * 4,
                  "temperature": [0] * 4, "totalcurrent": [0] * 4})  # fmt: skip


@pytest.mark.parametrize(
    ("size", "parts"), [(0, [0]), (50, [50]), (51, [50, 1]), (99, [50, 49]), (149, [50, 50, 49]), (150, [50] * 3 + [0])]
)
def test_a_long_text_is_sent_in_parts_of_which_the_last_is_not_full(size: int, parts: list[int]) -> None:
    found = status_text(4, "x" * size, 7)
    assert [(len(part.text), part.severity, part.id, part.chunk_seq) for part in found] == [
        (length, 4, 7 * (len(parts) > 1), at) for at, length in enumerate(parts)
    ]

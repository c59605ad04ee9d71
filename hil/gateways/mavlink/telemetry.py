"""Messages of the vehicle's state: one function a message, from a snapshot. Units and frames are MAVLink's."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_MS, NS_PER_US
from hil.gateways.mavlink import newer_messages as newer
from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.protocols import streams
from hil.gateways.mavlink.snapshot import Origin, Snapshot
from hil.ros.joints import MotorState
from sim.geodesy import TangentPlane
from sim.rotations import rotate

U16, U32 = 0xFFFF, 0xFFFF_FFFF
SERVOS = 16
KELVIN_FREE = 2000  # cdegC: the water's temperature is not measured
DEGE7 = 1e7


class Context(NamedTuple):
    """Values that messages need beside the snapshot: times (ns), home (m, NED), origin, mode, setpoint."""

    now: int  # since the gateway started
    wall_ns: int  # since 1970
    home: tuple[float, float, float]
    origin: Origin | None
    plane: TangentPlane | None
    mode: Mode
    armed: bool
    ready: bool  # whether arming would be accepted
    target: tuple[float, float, float] | None  # m, NED


def place_e7(context: Context, position: tuple[float, float, float]) -> tuple[int, int]:
    """Return latitude and longitude (1e-7 degrees) of a place (m, NED); 0, 0 without an origin."""
    if context.plane is None:
        return 0, 0
    latitude, longitude, _ = context.plane.geodetic((position[0], position[1], 0.0))
    return round(latitude * DEGE7), round(longitude * DEGE7)


def altitude_mm(context: Context, depth: float) -> int:
    """Return the altitude (mm) of a depth (m)."""
    return round(1000.0 * ((context.origin.altitude if context.origin else 0.0) - depth))


def attitude(s: Snapshot, c: Context) -> Any:
    """Return ATTITUDE."""
    state = s.state
    return dialect.MAVLink_attitude_message(
        _boot_ms(c), state.roll, state.pitch, state.heading, *state.angular_velocity
    )


def attitude_quaternion(s: Snapshot, c: Context) -> Any:
    """Return ATTITUDE_QUATERNION."""
    return dialect.MAVLink_attitude_quaternion_message(_boot_ms(c), *s.state.orientation, *s.state.angular_velocity)


def local_position(s: Snapshot, c: Context) -> Any:
    """Return LOCAL_POSITION_NED."""
    return dialect.MAVLink_local_position_ned_message(_boot_ms(c), *s.state.position, *_ned(s))


def global_position(s: Snapshot, c: Context) -> Any:
    """Return GLOBAL_POSITION_INT; relative to home, which is at the surface: negative under water."""
    depth = s.state.position[2]
    velocity = [_clip(100.0 * v, 32_767) for v in _ned(s)]
    latitude, longitude = place_e7(c, s.state.position)
    return dialect.MAVLink_global_position_int_message(
        _boot_ms(c), latitude, longitude, altitude_mm(c, depth), round(1000.0 * (c.home[2] - depth)), *velocity,
        round(100.0 * _degrees(s.state.heading)) % 36_000,
    )  # fmt: skip


def vfr_hud(s: Snapshot, c: Context) -> Any:
    """Return VFR_HUD; its altitude is that above the surface, as ArduSub has it."""
    north, east, down = _ned(s)
    pulses = [abs(pulse - 1500) for pulse in s.pulses if pulse]
    throttle = round(max(pulses, default=0) / 4.0)
    return dialect.MAVLink_vfr_hud_message(
        s.state.velocity[0], math.hypot(north, east), round(_degrees(s.state.heading)) % 360, min(throttle, 100),
        -s.state.position[2], -down,
    )  # fmt: skip


def scaled_pressure2(s: Snapshot, c: Context) -> Any:
    """Return SCALED_PRESSURE2, the water's pressure; None without such a sensor."""
    if s.pascal is None:
        return None
    return dialect.MAVLink_scaled_pressure2_message(_boot_ms(c), s.pascal / 100.0, 0.0, KELVIN_FREE)


def battery_status(s: Snapshot, _: Context) -> Any:
    """Return BATTERY_STATUS; None without a battery."""
    battery = s.battery
    if battery is None:
        return None
    charge_state = dialect.MAV_BATTERY_CHARGE_STATE_FAILED if battery.cut_off else dialect.MAV_BATTERY_CHARGE_STATE_OK
    return dialect.MAVLink_battery_status_message(
        0, dialect.MAV_BATTERY_FUNCTION_ALL, dialect.MAV_BATTERY_TYPE_LION, 32_767,
        [_millivolts(battery.voltage)] + [U16] * 9, _clip(100.0 * battery.current, 32_767),
        round(1000.0 * max(0.0, battery.capacity - battery.charge)), -1, _remaining(s), 0, charge_state,
    )  # fmt: skip


def gps_raw(s: Snapshot, c: Context) -> Any:
    """Return GPS_RAW_INT: no GPS (0), no fix under water (1), or a fix at the surface (3)."""
    fix, wall_us = s.fix, c.wall_ns // NS_PER_US
    if fix is None or not fix.fix:
        kind = dialect.GPS_FIX_TYPE_NO_GPS if fix is None else dialect.GPS_FIX_TYPE_NO_FIX
        return dialect.MAVLink_gps_raw_int_message(wall_us, kind, 0, 0, 0, U16, U16, U16, U16, 0)
    north, east, _ = _ned(s)
    course = round(100.0 * _degrees(math.atan2(east, north))) % 36_000
    accuracy = [round(1000.0 * math.sqrt(max(0.0, variance))) for variance in fix.variances]
    return dialect.MAVLink_gps_raw_int_message(
        wall_us, dialect.GPS_FIX_TYPE_3D_FIX, round(fix.latitude * DEGE7), round(fix.longitude * DEGE7),
        round(1000.0 * fix.altitude), U16, U16, _clip(100.0 * math.hypot(north, east), U16 - 1), course, 10,
        round(1000.0 * fix.altitude), *accuracy,
    )  # fmt: skip


def home_position(_: Snapshot, c: Context) -> Any:
    """Return HOME_POSITION; None without an origin, as it is a place on the earth."""
    if c.plane is None:
        return None
    latitude, longitude = place_e7(c, c.home)
    return dialect.MAVLink_home_position_message(
        latitude, longitude, altitude_mm(c, c.home[2]), *c.home, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0,
        c.wall_ns // NS_PER_US,
    )  # fmt: skip


def ekf_status(_: Snapshot, c: Context) -> Any:
    """Return EKF_STATUS_REPORT. The navigation solution is one sensor here: its parts are all there."""
    flags = (
        dialect.EKF_ATTITUDE | dialect.EKF_VELOCITY_HORIZ | dialect.EKF_VELOCITY_VERT | dialect.EKF_POS_HORIZ_REL
        | dialect.EKF_POS_VERT_ABS | dialect.EKF_PRED_POS_HORIZ_REL
    )  # fmt: skip
    if c.origin:
        flags |= dialect.EKF_POS_HORIZ_ABS | dialect.EKF_PRED_POS_HORIZ_ABS
    return dialect.MAVLink_ekf_status_report_message(flags, 0.0, 0.0, 0.0, 0.0, 0.0)


def distance_sensor(s: Snapshot, c: Context) -> Any:
    """Return DISTANCE_SENSOR, to the seabed; None without one. No echo is a distance beyond its reach."""
    if s.echo is None:
        return None
    least, most = (_clip(100.0 * limit, U16) for limit in (s.echo.least, s.echo.most))
    is_number = math.isfinite(s.echo.distance)
    distance = _clip(100.0 * s.echo.distance, U16) if is_number else min(most + 1, U16)
    return dialect.MAVLink_distance_sensor_message(
        _boot_ms(c), least, most, distance, dialect.MAV_DISTANCE_SENSOR_ULTRASOUND, 0,
        dialect.MAV_SENSOR_ROTATION_PITCH_270, 0xFF,
    )  # fmt: skip


def servo_output(s: Snapshot, c: Context) -> Any:
    """Return SERVO_OUTPUT_RAW: the pulses in effect."""
    pulses = [*s.pulses[:SERVOS], *[0] * (SERVOS - len(s.pulses))]
    return dialect.MAVLink_servo_output_raw_message(c.now // NS_PER_US & U32, 0, *pulses[:SERVOS])


def esc_status(s: Snapshot, c: Context) -> list[Any]:
    """Return ESC_STATUS of each four channels: turns a minute (0 if not known), battery's voltage, currents (nan)."""
    volts = s.battery.voltage if s.battery else math.nan
    return [
        newer.EscStatus(
            c.now // NS_PER_US, [_turns(motor) for motor in four], [volts] * newer.ESCS,
            [motor.current for motor in four], newer.ESCS * number,
        )
        for number, four in enumerate(_fours(s))
    ]  # fmt: skip


def esc_telemetry(s: Snapshot, _: Context) -> list[Any]:
    """Return ESC_TELEMETRY_1_TO_4 and its like; what is not known is 0, their "none"."""
    volts = [_clip(100.0 * s.battery.voltage, U16) if s.battery else 0] * newer.ESCS
    none = [0] * newer.ESCS
    kinds = (
        dialect.MAVLink_esc_telemetry_1_to_4_message, dialect.MAVLink_esc_telemetry_5_to_8_message,
        dialect.MAVLink_esc_telemetry_9_to_12_message, dialect.MAVLink_esc_telemetry_13_to_16_message,
    )  # fmt: skip
    messages = []
    for kind, four in zip(kinds, _fours(s), strict=False):
        currents = [_clip(100.0 * abs(motor.current), U16) for motor in four]
        messages.append(kind(none, volts, currents, none, [min(abs(_turns(motor)), U16) for motor in four], none))
    return messages


def _fours(s: Snapshot) -> list[list[MotorState]]:
    """Return the motors in fours, the last ones filled up; none while nothing is known of them but their pulses."""
    motors = list(s.motors) or [MotorState(pulse, math.nan, math.nan) for pulse in s.pulses]
    if not s.battery and all(math.isnan(motor.speed) and math.isnan(motor.current) for motor in motors):
        return []
    blank = MotorState(0.0, math.nan, math.nan)
    motors += [blank] * (-len(motors) % newer.ESCS)
    return [motors[first : first + newer.ESCS] for first in range(0, len(motors), newer.ESCS)]


def _turns(motor: MotorState) -> int:
    """Return turns a minute, with the sign of the thrust; 0 if not known."""
    return 0 if math.isnan(motor.speed) else round(motor.speed * 60.0 / math.tau)


def sys_status(s: Snapshot, c: Context) -> Any:
    """Return SYS_STATUS: which sensors there are, and PREARM_CHECK while arming would be accepted."""
    present = health = dialect.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION | dialect.MAV_SYS_STATUS_AHRS
    for topic, bits in _SENSOR_BITS.items():
        present |= bits if topic in s.sensors else 0
        health |= bits if topic in s.sensors else 0
    present |= dialect.MAV_SYS_STATUS_PREARM_CHECK | dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    health |= dialect.MAV_SYS_STATUS_PREARM_CHECK if c.ready else 0
    health |= dialect.MAV_SYS_STATUS_GEOFENCE  # there is none, and MAVProxy says "fence breach" without it
    health |= 0 if s.link_silent else dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    if s.battery and s.battery.cut_off:
        health &= ~dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    voltage = _millivolts(s.battery.voltage) if s.battery else U16
    current = _clip(100.0 * s.battery.current, 32_767) if s.battery else -1
    return dialect.MAVLink_sys_status_message(
        present, present, health, _clip(1000.0 * s.slave_load, 1000), voltage, current, _remaining(s), 0, 0, 0, 0, 0, 0
    )


_SENSOR_BITS: dict[str, int] = {
    "imu": dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    "magnetometer": dialect.MAV_SYS_STATUS_SENSOR_3D_MAG,
    "pressure": dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    "gps": dialect.MAV_SYS_STATUS_SENSOR_GPS,
    "dvl": dialect.MAV_SYS_STATUS_SENSOR_VISION_POSITION,
    "altimeter": dialect.MAV_SYS_STATUS_SENSOR_LASER_POSITION,
    "battery": dialect.MAV_SYS_STATUS_SENSOR_BATTERY,
}


def system_time(_: Snapshot, c: Context) -> Any:
    """Return SYSTEM_TIME."""
    return dialect.MAVLink_system_time_message(c.wall_ns // NS_PER_US, _boot_ms(c))


def extended_state(s: Snapshot, _: Context) -> Any:
    """Return EXTENDED_SYS_STATE: always "in air", as nothing stands on the ground under water."""
    return dialect.MAVLink_extended_sys_state_message(dialect.MAV_VTOL_STATE_UNDEFINED, dialect.MAV_LANDED_STATE_IN_AIR)


def navigation(s: Snapshot, c: Context) -> Any:
    """Return NAV_CONTROLLER_OUTPUT: bearing and distance to the target, and the error of depth."""
    north, east, depth = c.target or s.state.position
    ahead, right = north - s.state.position[0], east - s.state.position[1]
    bearing = round(_degrees(math.atan2(right, ahead)))
    distance = _clip(math.hypot(ahead, right), U16)
    return dialect.MAVLink_nav_controller_output_message(
        math.degrees(s.state.roll), math.degrees(s.state.pitch), bearing, bearing, distance,
        s.state.position[2] - depth, 0.0, 0.0,
    )  # fmt: skip


BUILDERS: dict[int, Callable[[Snapshot, Context], Any]] = {
    streams.ATTITUDE: attitude, streams.ATTITUDE_QUATERNION: attitude_quaternion,
    streams.LOCAL_POSITION_NED: local_position, streams.GLOBAL_POSITION_INT: global_position,
    streams.VFR_HUD: vfr_hud, streams.SCALED_PRESSURE2: scaled_pressure2, streams.BATTERY_STATUS: battery_status,
    streams.GPS_RAW_INT: gps_raw, streams.HOME_POSITION: home_position, streams.EKF_STATUS_REPORT: ekf_status,
    streams.DISTANCE_SENSOR: distance_sensor, streams.SERVO_OUTPUT_RAW: servo_output,
    streams.SYS_STATUS: sys_status,
    streams.SYSTEM_TIME: system_time, streams.EXTENDED_SYS_STATE: extended_state,
    streams.NAV_CONTROLLER_OUTPUT: navigation,
}  # fmt: skip

SEVERAL: dict[int, Callable[[Snapshot, Context], list[Any]]] = {
    streams.ESC_STATUS: esc_status, streams.ESC_TELEMETRY: esc_telemetry,
}  # fmt: skip


def _boot_ms(c: Context) -> int:
    return c.now // NS_PER_MS & U32


def _ned(s: Snapshot) -> tuple[float, float, float]:
    north, east, down = rotate(s.state.orientation, s.state.velocity)
    return north, east, down


def _degrees(radians: float) -> float:
    return math.degrees(radians) % 360.0


def _clip(value: float, most: int) -> int:
    """Return a whole number within ±`most`; 0 for what is no number."""
    return round(max(-float(most), min(float(most), value))) if value == value else 0


def _millivolts(volts: float) -> int:
    return min(max(0, round(1000.0 * volts)), U16 - 1)


def _remaining(s: Snapshot) -> int:
    if s.battery is None or s.battery.capacity <= 0.0:
        return -1
    return _clip(100.0 * min(max(0.0, s.battery.charge / s.battery.capacity), 1.0), 100)

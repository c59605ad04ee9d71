"""Messages of single sensors: one function a message, from a snapshot. Units and axes are MAVLink's."""

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_US
from hil.gateways.mavlink.snapshot import Context, Snapshot
from hil.links.contract import MAX_THRUSTERS
from hil.links.mavlink.reports import encode_esc_telemetry
from hil.links.mavlink.settings import EscReading
from hil.ros.joints import MotorState

U16 = 0xFFFF
DEGE7 = 1e7
G0 = 9.80665  # m/s^2
GAUSS_PER_TESLA = 1e4
NO_TEMPERATURE = 2000  # cdegC: the water's temperature is not measured
Builder = Callable[[Snapshot, Context], Any]


def clip(value: float, most: int) -> int:
    """Return a whole number within ±`most`; 0 for what is no number."""
    return round(max(-float(most), min(float(most), value))) if value == value else 0


def degrees360(radians: float) -> float:
    """Return an angle in degrees, 0 to 360."""
    return math.degrees(radians) % 360.0


def distance_sensor(s: Snapshot, c: Context) -> Any:
    """Return DISTANCE_SENSOR, to the seabed; None without one. No echo is a distance beyond its reach."""
    if s.echo is None:
        return None
    least, most = (clip(100.0 * limit, U16) for limit in (s.echo.least, s.echo.most))
    distance = clip(100.0 * s.echo.distance, U16) if s.echo.is_valid else min(most + 1, U16)
    return dialect.MAVLink_distance_sensor_message(
        c.boot_ms, least, most, distance, dialect.MAV_DISTANCE_SENSOR_ULTRASOUND, 0,
        dialect.MAV_SENSOR_ROTATION_PITCH_270, 0xFF,
    )  # fmt: skip


def scaled_pressure(kind: Callable[..., Any]) -> Builder:
    """Return the function for SCALED_PRESSURE and its like: the water's pressure, which is the only one measured."""

    def build(s: Snapshot, c: Context) -> Any:
        return None if s.pascal is None else kind(c.boot_ms, s.pascal / 100.0, 0.0, NO_TEMPERATURE)

    return build


def scaled_imu(kind: Callable[..., Any]) -> Builder:
    """Return the function for SCALED_IMU and its like; all of them have the one IMU of the vehicle."""

    def build(s: Snapshot, c: Context) -> Any:
        return kind(c.boot_ms, *scaled(s), 0) if s.imu else None

    return build


def highres_imu(s: Snapshot, c: Context) -> Any:
    """Return HIGHRES_IMU; None without an IMU. Bits say which of its fields are measured."""
    if s.imu is None:
        return None
    gauss = [GAUSS_PER_TESLA * axis for axis in s.field] if s.field else [0.0] * 3
    pressure = 0.0 if s.pascal is None else s.pascal / 100.0
    updated = 0x3F | (0x1C0 if s.field else 0) | (0 if s.pascal is None else 0x200)
    return dialect.MAVLink_highres_imu_message(
        c.boot_us, *s.imu.acceleration, *s.imu.angular_velocity, *gauss, pressure, 0.0, 0.0, 0.0, updated, 0
    )


def scaled(s: Snapshot) -> list[int]:
    """Return specific force (1e-3 g), turn rate (mrad/s) and field (mgauss)."""
    assert s.imu
    field = s.field or (0.0, 0.0, 0.0)
    rows = (1000.0 / G0, s.imu.acceleration), (1000.0, s.imu.angular_velocity), (1000.0 * GAUSS_PER_TESLA, field)
    return [clip(factor * axis, 32_767) for factor, vector in rows for axis in vector]


def power_status(s: Snapshot, _: Context) -> Any:
    """Return POWER_STATUS: the supply of the electronics is not measured (0), whether the battery feeds it is known."""
    feeds = s.battery is not None and not s.battery.cut_off
    return dialect.MAVLink_power_status_message(0, 0, dialect.MAV_POWER_STATUS_BRICK_VALID if feeds else 0)


def battery_status(s: Snapshot, _: Context) -> Any:
    """Return BATTERY_STATUS; None without a battery."""
    battery = s.battery
    if battery is None:
        return None
    charge_state = dialect.MAV_BATTERY_CHARGE_STATE_FAILED if battery.cut_off else dialect.MAV_BATTERY_CHARGE_STATE_OK
    return dialect.MAVLink_battery_status_message(
        0, dialect.MAV_BATTERY_FUNCTION_ALL, dialect.MAV_BATTERY_TYPE_LION, 32_767,
        [millivolts(battery.voltage)] + [U16] * 9, clip(100.0 * battery.current, 32_767),
        round(1000.0 * max(0.0, battery.capacity - battery.charge)), -1, remaining(s), 0, charge_state,
    )  # fmt: skip


def gps_raw(s: Snapshot, c: Context) -> Any:
    """Return GPS_RAW_INT: no GPS (0), no fix under water (1), or a fix at the surface (3)."""
    fix, wall_us = s.fix, c.wall_ns // NS_PER_US
    if fix is None or not fix.fix:
        kind = dialect.GPS_FIX_TYPE_NO_GPS if fix is None else dialect.GPS_FIX_TYPE_NO_FIX
        return dialect.MAVLink_gps_raw_int_message(wall_us, kind, 0, 0, 0, U16, U16, U16, U16, 0)
    north, east, _ = s.velocity_ned
    course = round(100.0 * degrees360(math.atan2(east, north))) % 36_000
    accuracy = [round(1000.0 * math.sqrt(max(0.0, variance))) for variance in fix.variances]
    return dialect.MAVLink_gps_raw_int_message(
        wall_us, dialect.GPS_FIX_TYPE_3D_FIX, round(fix.latitude * DEGE7), round(fix.longitude * DEGE7),
        round(1000.0 * fix.altitude), U16, U16, clip(100.0 * math.hypot(north, east), U16 - 1), course, 10,
        round(1000.0 * fix.altitude), *accuracy,
    )  # fmt: skip


def esc_telemetry(s: Snapshot, _: Context) -> list[Any]:
    """Return ESC_TELEMETRY_1_TO_4 and its like; none while nothing is known of the motors but their pulses."""
    motors = list(s.motors) or [MotorState(pulse, math.nan, math.nan) for pulse in s.pulses]
    if not s.battery and all(math.isnan(motor.speed) and math.isnan(motor.current) for motor in motors):
        return []
    volts = s.battery.voltage if s.battery else 0.0
    readings = [EscReading(motor.speed, volts, abs(motor.current), 0.0, 0.0) for motor in motors[:MAX_THRUSTERS]]
    return encode_esc_telemetry(readings, 0)


def remaining(s: Snapshot) -> int:
    """Return the charge that is left in percent, -1 if not known."""
    if s.battery is None or s.battery.capacity <= 0.0:
        return -1
    return clip(100.0 * min(max(0.0, s.battery.charge / s.battery.capacity), 1.0), 100)


def millivolts(volts: float) -> int:
    """Return a voltage in mV, as its fields of 16 bits have it."""
    return min(max(0, round(1000.0 * volts)), U16 - 1)

"""Messages of the vehicle's state: one function a message, from a snapshot. Units and frames are MAVLink's."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_US
from hil.gateways.mavlink import sensors
from hil.gateways.mavlink.protocols.streams import number_of
from hil.gateways.mavlink.sensors import U16, clip, degrees360
from hil.gateways.mavlink.snapshot import Context, Snapshot

U32 = 0xFFFF_FFFF
SERVOS = 16
CHANNELS = 18  # of RC_CHANNELS
NO_RSSI = 255
DEGE7 = 1e7
TEXT_SIZE = 50  # bytes of one STATUSTEXT


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
    return dialect.MAVLink_attitude_message(c.boot_ms, state.roll, state.pitch, state.heading, *state.angular_velocity)


def global_position(s: Snapshot, c: Context) -> Any:
    """Return GLOBAL_POSITION_INT; relative to home, which is at the surface: negative under water."""
    depth = s.state.position[2]
    velocity = [clip(100.0 * v, 32_767) for v in s.velocity_ned]
    latitude, longitude = place_e7(c, s.state.position)
    return dialect.MAVLink_global_position_int_message(
        c.boot_ms, latitude, longitude, altitude_mm(c, depth), round(1000.0 * (c.home[2] - depth)), *velocity,
        round(100.0 * degrees360(s.state.heading)) % 36_000,
    )  # fmt: skip


def vfr_hud(s: Snapshot, c: Context) -> Any:
    """Return VFR_HUD; its altitude is that above the surface, as ArduSub has it."""
    north, east, down = s.velocity_ned
    pulses = [abs(pulse - 1500) for pulse in s.pulses if pulse]
    throttle = round(max(pulses, default=0) / 4.0)
    return dialect.MAVLink_vfr_hud_message(
        s.state.velocity[0], math.hypot(north, east), round(degrees360(s.state.heading)) % 360, min(throttle, 100),
        -s.state.position[2], -down,
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


def servo_output(s: Snapshot, c: Context) -> Any:
    """Return SERVO_OUTPUT_RAW: the pulses in effect of thrusters, and from output 9 on of other outputs."""
    pulses = dict.fromkeys(range(1, SERVOS + 1), 0) | dict(c.outputs) | dict(enumerate(s.pulses, 1))
    return dialect.MAVLink_servo_output_raw_message(c.boot_us & U32, 0, *[pulses[at + 1] for at in range(SERVOS)])


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
    voltage = sensors.millivolts(s.battery.voltage) if s.battery else 0  # as ArduSub without a battery monitor
    current = clip(100.0 * s.battery.current, 32_767) if s.battery else -1
    return dialect.MAVLink_sys_status_message(
        present, present, health, clip(1000.0 * s.slave_load, 1000), voltage, current, sensors.remaining(s),
        0, 0, 0, 0, 0, 0,
    )  # fmt: skip


_SENSOR_BITS: dict[str, int] = {
    "imu": dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    "magnetometer": dialect.MAV_SYS_STATUS_SENSOR_3D_MAG,
    "pressure": dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    "gps": dialect.MAV_SYS_STATUS_SENSOR_GPS,
    "dvl": dialect.MAV_SYS_STATUS_SENSOR_VISION_POSITION,
    "altimeter": dialect.MAV_SYS_STATUS_SENSOR_LASER_POSITION,
    "battery": dialect.MAV_SYS_STATUS_SENSOR_BATTERY,
}


def navigation(s: Snapshot, c: Context) -> Any:
    """Return NAV_CONTROLLER_OUTPUT: bearing and distance to the target, and the error of depth."""
    north, east, depth = c.target or s.state.position
    ahead, right = north - s.state.position[0], east - s.state.position[1]
    bearing = round(degrees360(math.atan2(right, ahead)))
    distance = clip(math.hypot(ahead, right), U16)
    return dialect.MAVLink_nav_controller_output_message(
        math.degrees(s.state.roll), math.degrees(s.state.pitch), bearing, bearing, distance,
        s.state.position[2] - depth, 0.0, 0.0,
    )  # fmt: skip


def ahrs2(s: Snapshot, c: Context) -> Any:
    """Return AHRS2, which has the same solution as ATTITUDE."""
    state = s.state
    altitude = altitude_mm(c, state.position[2]) / 1000.0
    return dialect.MAVLink_ahrs2_message(state.roll, state.pitch, state.heading, altitude, *place_e7(c, state.position))


def odometry(s: Snapshot, c: Context) -> Any:
    """Return ODOMETRY: the pose in NED, the velocity in FRD; covariances are not known."""
    unknown = [math.nan, *[0.0] * 20]
    return dialect.MAVLink_odometry_message(
        c.boot_us, dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_FRD, *s.state.position,
        list(s.state.orientation), *s.state.nu, unknown, unknown, 0, dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    )  # fmt: skip


def altitude(s: Snapshot, c: Context) -> Any:
    """Return ALTITUDE: that above the surface, above the sea, above home, and the clearance below the vehicle."""
    up = -s.state.position[2]
    clearance = s.echo.distance if s.echo else math.nan
    return dialect.MAVLink_altitude_message(
        c.boot_us, up, altitude_mm(c, -up) / 1000.0, up, c.home[2] + up, math.nan, clearance
    )


def origin(_: Snapshot, c: Context) -> Any:
    """Return GPS_GLOBAL_ORIGIN; None without an origin."""
    if c.origin is None:
        return None
    e7 = round(c.origin.latitude * DEGE7), round(c.origin.longitude * DEGE7)
    return dialect.MAVLink_gps_global_origin_message(*e7, round(1000.0 * c.origin.altitude), c.boot_us)


def rc_channels(_: Snapshot, c: Context) -> Any:
    """Return RC_CHANNELS: what the sticks of the ground station are as pulses (us); 0 is a channel without one."""
    channels = [*c.channels, *[0] * (CHANNELS - len(c.channels))]
    return dialect.MAVLink_rc_channels_message(c.boot_ms, len(c.channels), *channels, NO_RSSI)


def gimbal_attitude(_: Snapshot, c: Context) -> Any:
    """Return GIMBAL_DEVICE_ATTITUDE_STATUS: the tilt of the camera relative to the hull."""
    half, nan = math.radians(c.tilt) / 2.0, math.nan
    return dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, c.boot_ms, dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME,
        [math.cos(half), 0.0, math.sin(half), 0.0], nan, nan, nan, 0, nan, nan, 1,
    )  # fmt: skip


def status_text(severity: int, text: str, number: int) -> list[Any]:
    """Return STATUSTEXT, several with this number where the text is long."""
    data = text.encode("ascii", "replace")
    if len(data) <= TEXT_SIZE:
        return [dialect.MAVLink_statustext_message(severity, data)]
    chunks = [data[start : start + TEXT_SIZE] for start in range(0, len(data), TEXT_SIZE)]
    if len(chunks[-1]) == TEXT_SIZE:
        chunks.append(b"")  # a chunk that is full is not the last one
    return [dialect.MAVLink_statustext_message(severity, chunk, number, at) for at, chunk in enumerate(chunks)]


_BUILDERS: dict[str, sensors.Builder] = {
    "AHRS2": ahrs2, "ALTITUDE": altitude, "ATTITUDE": attitude, "BATTERY_STATUS": sensors.battery_status,
    "DISTANCE_SENSOR": sensors.distance_sensor, "EKF_STATUS_REPORT": ekf_status,
    "ESC_TELEMETRY_1_TO_4": sensors.esc_telemetry, "GIMBAL_DEVICE_ATTITUDE_STATUS": gimbal_attitude,
    "GLOBAL_POSITION_INT": global_position, "GPS_GLOBAL_ORIGIN": origin, "GPS_RAW_INT": sensors.gps_raw,
    "HIGHRES_IMU": sensors.highres_imu, "HOME_POSITION": home_position, "NAV_CONTROLLER_OUTPUT": navigation,
    "ODOMETRY": odometry, "POWER_STATUS": sensors.power_status, "RC_CHANNELS": rc_channels,
    "SCALED_IMU": sensors.scaled_imu(dialect.MAVLink_scaled_imu_message),
    "SCALED_IMU2": sensors.scaled_imu(dialect.MAVLink_scaled_imu2_message),
    "SCALED_IMU3": sensors.scaled_imu(dialect.MAVLink_scaled_imu3_message),
    "SCALED_PRESSURE": sensors.scaled_pressure(dialect.MAVLink_scaled_pressure_message),
    "SCALED_PRESSURE2": sensors.scaled_pressure(dialect.MAVLink_scaled_pressure2_message),
    "SERVO_OUTPUT_RAW": servo_output, "SYS_STATUS": sys_status, "VFR_HUD": vfr_hud,
    # The navigation solution states no drift and no error of its own, and a simulated hull does not vibrate.
    "AHRS": lambda s, c: dialect.MAVLink_ahrs_message(*[0.0] * 7),
    "VIBRATION": lambda s, c: dialect.MAVLink_vibration_message(c.boot_us, 0.0, 0.0, 0.0, 0, 0, 0),
    "ATTITUDE_QUATERNION": lambda s, c: dialect.MAVLink_attitude_quaternion_message(
        c.boot_ms, *s.state.orientation, *s.state.angular_velocity
    ),
    # Undefined, as ArduSub has it: QGroundControl does not arm what is "in air".
    "EXTENDED_SYS_STATE": lambda s, c: dialect.MAVLink_extended_sys_state_message(
        dialect.MAV_VTOL_STATE_UNDEFINED, dialect.MAV_LANDED_STATE_UNDEFINED
    ),
    "LOCAL_POSITION_NED": lambda s, c: dialect.MAVLink_local_position_ned_message(
        c.boot_ms, *s.state.position, *s.velocity_ned
    ),
    "NAMED_VALUE_FLOAT": lambda s, c: [
        dialect.MAVLink_named_value_float_message(c.boot_ms, name.encode(), row) for name, row in c.panel.items()
    ],
    "RANGEFINDER": lambda s, c: (
        dialect.MAVLink_rangefinder_message(s.echo.distance, 0.0) if s.echo and s.echo.is_valid else None
    ),
    "RAW_IMU": lambda s, c: dialect.MAVLink_raw_imu_message(c.boot_us, *sensors.scaled(s), 0, 0) if s.imu else None,
    "SYSTEM_TIME": lambda s, c: dialect.MAVLink_system_time_message(c.wall_ns // NS_PER_US, c.boot_ms),
}  # fmt: skip
BUILDERS = {number_of(name): build for name, build in _BUILDERS.items()}

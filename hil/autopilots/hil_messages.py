"""Encode the MAVLink messages of a simulator for PX4, in their units: gauss, hPa, degrees * 1e7, mm, cm/s.

Positions and velocities are NED, body vectors FRD. Source: MAVLink common.xml, and how PX4 reads it
(src/modules/simulation/simulator_mavlink).
"""

from collections.abc import Sequence
from math import atan2, degrees, hypot, isfinite, nan, sqrt
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import MOST_US, PWM_NEUTRAL_US
from sim.sensors.samples import DvlSample, OdometrySample

SPAN_US = MOST_US - PWM_NEUTRAL_US  # pulse width from neutral to a control of 1 or -1
ACCELEROMETER, GYROSCOPE, MAGNETOMETER, BAROMETER = 0x007, 0x038, 0x1C0, 0x1A00
ARMED, LOCKSTEP = 0x80, 0x01
UNKNOWN_16 = 0xFFFF
STANDARD_HPA = 1013.25
BOX_TEMPERATURE = 20.0  # degC; of sensors in the vehicle's hull
LOCAL_NED, BODY_FRD, LOCAL_FRD = 1, 12, 20  # MAV_FRAME
DEPTH_VARIANCE = 0.01  # m², of a depth by pressure
VISION = 2  # MAV_ESTIMATOR_TYPE: PX4 fuses it as external navigation


def encode_sensor(
    time_us: int, acceleration: Sequence[float] | None, gyro: Sequence[float] | None, field: Sequence[float] | None,
    pascal: float | None,
) -> Any:  # fmt: skip
    """Return a HIL_SENSOR message (m/s², rad/s, T, Pa); values that are None are not marked as updated."""
    updated = 0
    for group, value in ((ACCELEROMETER, acceleration), (GYROSCOPE, gyro), (MAGNETOMETER, field), (BAROMETER, pascal)):
        updated |= group if value is not None else 0
    hectopascal = 0.0 if pascal is None else pascal / 100.0
    gauss = [1e4 * x for x in field] if field is not None else (0.0, 0.0, 0.0)
    return dialect.MAVLink_hil_sensor_message(
        time_us, *(acceleration or (0.0, 0.0, 0.0)), *(gyro or (0.0, 0.0, 0.0)), *gauss, hectopascal, 0.0,
        compute_pressure_altitude(hectopascal) if pascal is not None else 0.0, BOX_TEMPERATURE, updated, 0,
    )  # fmt: skip


def compute_pressure_altitude(hectopascal: float) -> float:
    """Return the altitude (m) of this pressure in the standard atmosphere."""
    ratio: float = (hectopascal / STANDARD_HPA) ** 0.190263
    return 44_330.77 * (1.0 - ratio)


def encode_gps(time_us: int, fix: Any, velocity: Sequence[float]) -> Any:
    """Return the HIL_GPS message of a FixSample, without a position if it has no fix; `velocity` NED in m/s."""
    if not fix.fix:
        return dialect.MAVLink_hil_gps_message(
            time_us, 0, 0, 0, 0, UNKNOWN_16, UNKNOWN_16, UNKNOWN_16, 0, 0, 0, UNKNOWN_16, 0
        )
    north, east, down = (_limited(100.0 * x, 32_767) for x in velocity)
    course = round(100.0 * degrees(atan2(east, north))) % 36_000
    return dialect.MAVLink_hil_gps_message(
        time_us, 3, round(1e7 * fix.latitude), round(1e7 * fix.longitude), round(1000.0 * fix.altitude),
        _limited(100.0 * sqrt(fix.variances[0]), 65_534), _limited(100.0 * sqrt(fix.variances[1]), 65_534),
        _limited(hypot(north, east), 65_534), north, east, down, course, 12,
    )  # fmt: skip


def encode_odometry(time_us: int, sample: OdometrySample, variances: Sequence[float], frame: int = LOCAL_NED) -> Any:
    """Return the ODOMETRY message of a navigation solution, marked as a vision system, which PX4 uses for position.

    `variances`: of horizontal position and depth m², attitude rad², velocity (m/s)², angular velocity (rad/s)².
    """
    level, depth, angle, velocity, rate = variances
    pose = _diagonal(level, level, depth, angle, angle, angle)
    twist = _diagonal(velocity, velocity, velocity, rate, rate, rate)
    return dialect.MAVLink_odometry_message(
        time_us, frame, BODY_FRD, *sample.position, list(sample.orientation), *sample.nu, pose, twist, 0, VISION, 100
    )


def encode_velocity(time_us: int, depth: float, dvl: DvlSample | None) -> Any:
    """Return the ODOMETRY message with a depth (m) and a DVL's velocity; without a lock it has no velocity."""
    unknown, pose = [nan] * 3, _diagonal(0.0, 0.0, DEPTH_VARIANCE, 0.0, 0.0, 0.0)
    covariance = dvl.covariance if dvl else ()
    twist = _diagonal(*(covariance[::4] or (1e-4,) * 3), 0.0, 0.0, 0.0)
    velocity = dvl.velocity if dvl and dvl.locked else unknown
    return dialect.MAVLink_odometry_message(
        time_us, LOCAL_NED, BODY_FRD, 0.0, 0.0, depth, [nan] * 4, *velocity, *unknown, pose, twist, 0, VISION, 100,
    )  # fmt: skip


def encode_truth(time_us: int, truth: OdometrySample, velocity: Sequence[float], acceleration: Sequence[float],
                geodetic: Sequence[float]) -> Any:  # fmt: skip
    """Return the HIL_STATE_QUATERNION message of the true state, for PX4's log.

    `velocity`: NED, m/s. `acceleration`: m/s². `geodetic`: latitude, longitude (degrees), altitude (m).
    """
    latitude, longitude, altitude = geodetic
    north, east, down = (_limited(100.0 * x, 32_767) for x in velocity)
    milli_g = [_limited(1000.0 * x / 9.80665, 32_767) for x in acceleration]
    return dialect.MAVLink_hil_state_quaternion_message(
        time_us, list(truth.orientation), *truth.nu[3:], round(1e7 * latitude), round(1e7 * longitude),
        round(1000.0 * altitude), north, east, down, 0, 0, *milli_g,
    )  # fmt: skip


def controls_to_pwm(controls: Sequence[float]) -> tuple[int, ...]:
    """Return the pulse widths (us) of HIL_ACTUATOR_CONTROLS; 0, no output, for values that are not finite."""
    return tuple([PWM_NEUTRAL_US + round(SPAN_US * max(-1.0, min(1.0, x))) if isfinite(x) else 0 for x in controls])


def _diagonal(*variances: float) -> list[float]:
    """Return the upper triangle of a 6 x 6 matrix with these six values on its diagonal."""
    triangle = [0.0] * 21
    for place, variance in zip((0, 6, 11, 15, 18, 20), variances, strict=True):
        triangle[place] = variance
    return triangle


def _limited(value: float, most: int) -> int:
    return round(max(-most, min(most, value)))

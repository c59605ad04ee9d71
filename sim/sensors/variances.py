"""Variances of sensor errors, for messages that have a field for them.

The variance of a quantity is that of its white noise, of its bias, and of the constants that are drawn when the run
starts (`sim.sensors.error.variance`), without the error of the scale, which grows with the value. GPS, USBL and DVL
report a variance with each sample instead, because it depends on the measurement.
"""

from collections.abc import Mapping
from math import hypot
from typing import Any

from sim.environment.world import World
from sim.sensors.error import ErrorModel, constant_variance, noise_variance, variance
from sim.sensors.sensor_set import SensorSet

Variances = tuple[float, ...]
# topic -> keys of the errors whose variances its message has; those of an AHRS follow from its filter
_ERRORS = {
    "imu": ("attitude", "heading", "angular_velocity", "acceleration"),
    "ahrs": ("angular_velocity", "acceleration"),
    "odom": ("horizontal", "depth", "attitude", "velocity", "angular_velocity"),
    "magnetometer": ("error_xy", "error_z"),
    "pressure": ("error",),
    "altimeter": ("error",),
    "echosounder": ("error",),
    "dvl_water": ("velocity",),
}


def error_variances(sensors: SensorSet, world: World) -> Mapping[str, Variances]:
    """Return the variances of each sensor by topic, in the units and order of its message.

    imu and ahrs: roll and pitch, yaw (rad²), angular velocity (rad²/s²), acceleration (m²/s⁴). odom: horizontal
    position, depth (m²), attitude (rad²), velocity (m²/s²), angular velocity. magnetometer: x and y, z (T²). Other
    sensors whose message has a field for it have one variance; the rest have no entry.
    """
    variances: dict[str, Variances] = {}
    for spec in sensors.values():
        if keys := _ERRORS.get(spec.sensor.topic):
            attitude = _attitude(spec.model, world) if spec.sensor.topic == "ahrs" else ()
            period = 1.0 / spec.model.rate
            models = [getattr(spec.model, key) or spec.model.attitude for key in keys]
            variances[spec.topic] = (*attitude, *[variance(model, period) for model in models])
    return variances


def _attitude(model: Any, world: World) -> Variances:
    """Return the variances of an AHRS's attitude: the errors of the inputs after the filter, while the vehicle rests.

    A share of the tilt that the accelerometer shows, and of the heading that the magnetometer shows, is taken up each
    period. Constant errors pass completely, white noise by share / (2 - share). The gyros' constant error accumulates
    over the filter's time constant, and so does the random walk of their noise. A tilt changes the measured heading by
    the tangent of the field's inclination.
    """
    from sim.sensors.magnetometer import earth_field  # imported here, because only an AHRS needs it

    period = 1.0 / model.rate
    north, east, down = earth_field(world)
    across = hypot(north, east)
    level = _filtered_variance(model.acceleration, model.angular_velocity, period, model.level_time, world.gravity)
    heading = _filtered_variance(model.magnetic_field, model.angular_velocity, period, model.heading_time, across)
    heading += level * (down / across) ** 2
    return level, heading


def _filtered_variance(reference: ErrorModel, gyro: ErrorModel, period: float, memory: float, size: float) -> float:
    """Return the variance (rad²) of an angle that follows a reference vector of this `size` with this `memory` (s)."""
    share = min(1.0, period / memory)
    constant, gyro_constant = constant_variance(reference), constant_variance(gyro)
    noise, gyro_noise = noise_variance(reference, period), noise_variance(gyro, period)
    of_reference = (constant + noise * share / (2.0 - share)) / size**2
    return of_reference + (gyro_constant / share + gyro_noise / (2.0 - share)) * period**2 / share

"""Variances of sensor errors, for messages that have a field for them.

The variance of a quantity is that of its white noise, of its bias, and of the constants that are drawn when the run
starts (`sim.sensors.error.variance`), without the error of the scale, which grows with the value. GPS, USBL and DVL
report a variance with each sample instead, because it depends on the measurement.
"""

from collections.abc import Callable, Mapping
from math import hypot
from typing import Any

from sim.environment.world import World
from sim.sensors.error import ErrorModel, variance
from sim.sensors.sensor_set import SensorSet

Spread = tuple[float, ...]


def spreads(sensors: SensorSet, world: World) -> Mapping[str, Spread]:
    """Return each sensor's variances by topic, in the units and order of its message; none for other sensors.

    imu and ahrs: roll and pitch, yaw (rad²), angular velocity (rad²/s²), acceleration (m²/s⁴). odom: horizontal
    position, depth (m²), attitude (rad²), velocity (m²/s²), angular velocity. magnetometer: x and y, z (T²). Other
    sensors have one variance.
    """
    known = [fitted for fitted in sensors.values() if fitted.sensor.topic in _SPREADS]
    return {fitted.topic: _SPREADS[fitted.sensor.topic](fitted.model, world) for fitted in known}


def _imu(model: Any, _: World) -> Spread:
    attitude = _variance(model, "attitude")
    return attitude, attitude, _variance(model, "angular_velocity"), _variance(model, "acceleration")


def _ahrs(model: Any, world: World) -> Spread:
    """Return the variances of the attitude: the errors of the inputs after the filter, while the vehicle rests.

    A share of the tilt that the accelerometer shows, and of the heading that the magnetometer shows, is taken up each
    period: constant errors pass whole, white noise by share / (2 - share); the gyros' constant error stands for the
    time of the filter's memory, their noise walks until it is forgotten. A tilt leans the field into the heading by
    the tangent of its inclination.
    """
    from sim.sensors.magnetometer import earth_field  # with such a unit it is loaded anyway

    period = 1.0 / model.rate
    north, east, down = earth_field(world)
    across = hypot(north, east)
    level = _filtered(model.acceleration, model.angular_velocity, period, model.level_time, world.gravity)
    heading = _filtered(model.magnetic_field, model.angular_velocity, period, model.heading_time, across)
    heading += level * (down / across) ** 2
    return level, heading, _variance(model, "angular_velocity"), _variance(model, "acceleration")


def _filtered(reference: ErrorModel, gyro: ErrorModel, period: float, memory: float, size: float) -> float:
    """Return the variance of an angle (rad²) that follows a reference of that `size` with that `memory` (s)."""
    share = min(1.0, period / memory)
    constant, gyro_constant = _constant_variance(reference), _constant_variance(gyro)
    noise, gyro_noise = variance(reference, period) - constant, variance(gyro, period) - gyro_constant
    of_reference = (constant + noise * share / (2.0 - share)) / size**2
    return of_reference + (gyro_constant / share + gyro_noise / (2.0 - share)) * period**2 / share


def _constant_variance(model: ErrorModel) -> float:
    return model.turn_on**2 + model.bias**2


def _odometry(model: Any, _: World) -> Spread:
    names = "horizontal", "depth", "attitude", "velocity", "angular_velocity"
    return tuple([_variance(model, name) for name in names])


def _magnetometer(model: Any, _: World) -> Spread:
    return _variance(model, "error_xy"), _variance(model, "error_z")


def _one(name: str) -> Callable[[Any, World], Spread]:
    return lambda model, _: (_variance(model, name),)


def _variance(model: Any, name: str) -> float:
    return variance(getattr(model, name), 1.0 / model.rate)


_SPREADS: dict[str, Callable[[Any, World], Spread]] = {
    "imu": _imu,
    "ahrs": _ahrs,
    "odom": _odometry,
    "magnetometer": _magnetometer,
    "pressure": _one("error"),
    "altimeter": _one("error"),
    "echosounder": _one("error"),
    "dvl_water": _one("velocity"),
}

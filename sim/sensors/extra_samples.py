"""Samples of the less common sensors. Conventions are those of sim.sensors.samples."""

from typing import NamedTuple

from hil.common.vectors import Vector3
from sim.sensors.samples import Covariance


class RangeSample(NamedTuple):
    """Distance in m; inf without an echo, -inf below the minimum range. `limits` are the range limits (m)."""

    time_ns: int
    distance: float
    limits: tuple[float, float]


class FieldSample(NamedTuple):
    """Magnetic flux density in tesla."""

    time_ns: int
    field: Vector3


class VelocitySample(NamedTuple):
    """Velocity in m/s."""

    time_ns: int
    velocity: Vector3


class FixSample(NamedTuple):
    """Latitude and longitude in degrees, altitude in m above the ellipsoid (WGS 84); all nan without a `fix`.

    `variances` (m²) are of north and east each, and of altitude.
    """

    time_ns: int
    latitude: float
    longitude: float
    altitude: float
    variances: tuple[float, float]
    fix: bool


class PositionSample(NamedTuple):
    """A position (m) and its covariance (m²)."""

    time_ns: int
    position: Vector3
    covariance: Covariance


class BatterySample(NamedTuple):
    """Voltage (V), current drawn (A), remaining charge and capacity (Ah), and whether the battery is switched off."""

    time_ns: int
    voltage: float
    current: float
    charge: float
    capacity: float
    cut_off: bool


class FlagSample(NamedTuple):
    """State of a switch or detector."""

    time_ns: int
    on: bool


class LaserSample(NamedTuple):
    """A fan of distances in m at `angle_min`, `angle_min` + `angle_increment`, ... rad; inf, -inf as in RangeSample.

    For a laser and a scanning sonar the angle is about the sensor's z axis, from x (ahead) towards y (starboard); for a
    profiler about its x axis, from z (down) towards y (starboard). `intensities` are the strengths of the echoes (dB),
    nan without one; empty for a device that reports none.
    """

    time_ns: int
    angle_min: float
    angle_increment: float
    ranges: tuple[float, ...]
    limits: tuple[float, float]
    intensities: tuple[float, ...] = ()

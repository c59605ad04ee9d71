"""What a receiver knows at one instant: its fix, the satellites above it, and how well they stand for that.

The constellation is GPS's design of 24 satellites on six circular orbits (IS-GPS-200, table of the nominal
constellation, with even spacing). So numbers, rising and setting and dilutions are typical, but not those of a day.
"""

from collections.abc import Sequence
from datetime import datetime, timezone
from functools import lru_cache
from math import atan2, cos, degrees, hypot, pi, radians, sin, sqrt
from typing import NamedTuple

from hil.common.clock import NS_PER_S
from hil.common.vectors import Vector3
from sim.geodesy import TangentPlane, geodetic
from sim.matrices import inverse, product, transpose
from sim.sensors.extra_samples import FixSample

LEAP_SECONDS = 18  # GPS's time ahead of UTC since 2017
GPS_EPOCH = 315_964_800  # 6 January 1980, s since 1970
_WEEK = 604_800
SPEED_ACCURACY = 0.05  # m/s; u-blox NEO-M9N (data sheet)

ORBIT = 26_559_710.0  # m
INCLINATION = radians(55.0)
_EARTH_RATE = 7.2921151467e-5  # rad/s; WGS 84
_PLANES, _IN_PLANE = 6, 4
PERIOD_S = 10.0  # in which a satellite moves 0.1 degrees
LOWEST = 10.0  # degrees of elevation from which on a satellite is used, below the rigging of a deck and waves


class Satellite(NamedTuple):
    """Number, azimuth and elevation (degrees), carrier to noise density (dB Hz)."""

    number: int
    azimuth: float
    elevation: float
    strength: float


class Dilutions(NamedTuple):
    """Dilutions of precision: standard deviations for ranges of 1 m."""

    geometry: float = 99.99
    position: float = 99.99
    time: float = 99.99
    vertical: float = 99.99
    horizontal: float = 99.99
    north: float = 99.99
    east: float = 99.99


@lru_cache(16)
def visible(latitude: float, longitude: float, period: int) -> tuple[tuple[Satellite, ...], Dilutions]:
    """Return the satellites above a place (degrees) in the period `PERIOD_S` with this number, and their dilutions."""
    above = tuple(satellites(latitude, longitude, 0.0, PERIOD_S * period))
    return above, dilutions(above)


def satellites(latitude: float, longitude: float, altitude: float, gps_s: float) -> list[Satellite]:
    """Return the satellites above `LOWEST` for a place (degrees, m) at a time (s since GPS's epoch)."""
    plane = TangentPlane(latitude, longitude, altitude)
    found = []
    for number in range(1, _PLANES * _IN_PLANE + 1):
        north, east, down = plane.local(*geodetic(*_position(number, gps_s)))
        elevation = degrees(atan2(-down, hypot(north, east)))
        if elevation >= LOWEST:
            # C/N0 of a patch antenna under open sky: 35 dB Hz near the horizon, 48 at the zenith
            strength = 35.0 + 13.0 * sin(radians(elevation))
            found.append(Satellite(number, degrees(atan2(east, north)) % 360.0, elevation, strength))
    return found


def _position(number: int, gps_s: float) -> Vector3:
    """Return a satellite's place, earth-centred and earth-fixed (m)."""
    orbit, slot = divmod(number - 1, _IN_PLANE)
    node = orbit * pi / 3.0 - _EARTH_RATE * gps_s
    along = slot * pi / 2.0 + orbit * pi / 12.0 + 2.0 * _EARTH_RATE * gps_s  # two revolutions a sidereal day
    x, y, z = cos(along), sin(along) * cos(INCLINATION), sin(along) * sin(INCLINATION)
    return ORBIT * (x * cos(node) - y * sin(node)), ORBIT * (x * sin(node) + y * cos(node)), ORBIT * z


def dilutions(used: Sequence[Satellite]) -> Dilutions:
    """Return the dilutions of a fix by these satellites; the largest that receivers write with fewer than four."""
    if len(used) < 4:
        return Dilutions()
    lines = []
    for each in used:
        azimuth, elevation = radians(each.azimuth), radians(each.elevation)
        lines.append([cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation), 1.0])
    covariance = inverse(product(transpose(lines), lines))
    north, east, up, time = [covariance[i][i] for i in range(4)]
    squares = (north + east + up + time, north + east + up, time, up, north + east, north, east)
    return Dilutions(*[sqrt(value) for value in squares])


class Epoch(NamedTuple):
    """One solution. `time_ns` since 1970 (UTC); the place is that of `fix`, meaningless without one.

    `separation` (m) is the geoid's height above the ellipsoid, `velocity` (m/s) north, east, down; 0 without a fix.
    """

    time_ns: int
    fix: FixSample
    separation: float
    velocity: Vector3
    satellites: tuple[Satellite, ...]
    dilutions: Dilutions

    @property
    def time(self) -> datetime:
        """UTC, to the microsecond."""
        whole, rest = divmod(self.time_ns, NS_PER_S)
        return datetime.fromtimestamp(whole, timezone.utc).replace(microsecond=rest // 1000)

    @property
    def week_and_ms(self) -> tuple[int, int]:
        """GPS's week, and the time in it in ms."""
        week, rest_ns = divmod(self.time_ns - (GPS_EPOCH - LEAP_SECONDS) * NS_PER_S, _WEEK * NS_PER_S)
        return week, rest_ns // 1_000_000

    @property
    def speed(self) -> float:
        """Speed over ground in m/s."""
        return hypot(self.velocity[0], self.velocity[1])

    @property
    def course(self) -> float:
        """Course over ground in degrees."""
        return degrees(atan2(self.velocity[1], self.velocity[0])) % 360.0


def make_epoch(fix: FixSample, separation: float, velocity: Vector3) -> Epoch:
    """Return the epoch of a sample whose time is since 1970; without a fix no satellite is received."""
    if not fix.fix:
        return Epoch(fix.time_ns, fix, separation, (0.0, 0.0, 0.0), (), Dilutions())
    period = int((fix.time_ns / NS_PER_S - GPS_EPOCH + LEAP_SECONDS) // PERIOD_S)
    place = round(fix.latitude, 1), round(fix.longitude, 1)  # without the noise of the fix
    return Epoch(fix.time_ns, fix, separation, velocity, *visible(*place, period))

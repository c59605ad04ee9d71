"""What a receiver knows at one instant, in the terms of its messages."""

from datetime import datetime, timezone
from math import atan2, degrees, hypot
from typing import NamedTuple

from hil.common.clock import NS_PER_S
from hil.common.vectors import Vector3
from hil.instruments.gps.sky import PERIOD_S, Dilutions, Satellite, visible
from sim.sensors.extra_samples import FixSample

LEAP_SECONDS = 18  # GPS's time ahead of UTC since 2017
GPS_EPOCH = 315_964_800  # 6 January 1980, s since 1970
_WEEK = 604_800
SPEED_ACCURACY = 0.05  # m/s; u-blox NEO-M9N (data sheet)


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

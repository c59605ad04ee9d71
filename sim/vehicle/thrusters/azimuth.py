"""Azimuth thrusters: a servo turns the thruster about the vehicle's vertical axis (`Azimuth` in model.py).

The servo has a channel of its own, after those of the fins. Not modelled: the inflow of a propeller whose thrust falls
with speed (`curve` of kind "advance") counts along its direction at rest; a turning thruster's reaction on the hull.
"""

from collections.abc import Callable, Sequence
from math import cos, sin
from typing import Any

from sim.forces import Force, Wrench
from sim.rotations import Rotation
from sim.vehicle.servos import ServoSet
from sim.vehicle.thrusters.model import Thruster
from sim.vehicle.vehicle import Vehicle


class AzimuthSet(ServoSet, Force):
    """The servos of all azimuth thrusters among `thrusters`, stepped every `dt` s, and the force of their turning.

    The thrusters' own wrench is that of their directions at rest; this force is the difference. `read_thrusts` returns
    the present thrusts (N) of all thrusters.
    """

    def __init__(self, thrusters: Sequence[Thruster], dt: float) -> None:
        self._numbers = [i for i, thruster in enumerate(thrusters) if thruster.azimuth]
        self._turned = [thrusters[i] for i in self._numbers]
        super().__init__([thruster.azimuth for thruster in self._turned if thruster.azimuth], dt)
        self.read_thrusts: Callable[[], Sequence[float]] = lambda: [0.0] * len(thrusters)
        self.twin: Any = None  # the Force in C, if there is one
        self._thrusts = [0.0] * len(self._turned)

    def begin(self, time_ns: int) -> None:
        """Take the present thrusts for the next step."""
        thrusts = self.read_thrusts()
        self._thrusts = [thrusts[i] for i in self._numbers]
        if self.twin is not None:
            self.twin.set_thrusts(self._thrusts)

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the force (N, N m, body axes about the origin)."""
        total = [0.0] * 6
        for thruster, angle, thrust in zip(self._turned, self.angles, self._thrusts, strict=True):
            (x, y, z), (a, b, _) = thruster.position, thruster.unit_direction
            sine, cosine = sin(angle), cos(angle)
            ahead = thrust * (a * cosine - b * sine - a)
            aside = thrust * (a * sine + b * cosine - b)
            torque = thruster.torque
            one = ahead, aside, 0.0, torque * ahead - z * aside, z * ahead + torque * aside, x * aside - y * ahead
            total = [p + q for p, q in zip(total, one, strict=True)]
        return total

    def numbers(self) -> list[float]:
        """Return all numbers that `wrench` uses, with sine and cosine of each angle, for the C twin."""
        rows = zip(self._numbers, self._turned, self._thrusts, self.angles, strict=True)
        return [
            x
            for number, one, thrust, angle in rows
            for x in (
                float(number), *one.position, *one.unit_direction[:2], one.torque, thrust, sin(angle), cos(angle),
            )
        ]  # fmt: skip


def turned(thruster: Thruster) -> Thruster:
    """Return `thruster`, turned clockwise by a quarter from its rest."""
    a, b, c = thruster.direction
    return thruster._replace(direction=(-b, a, c))


def with_turned(vehicle: Vehicle) -> Vehicle:
    """Return `vehicle` with each azimuth thruster as two, at rest and turned by a quarter, for what one axis can do."""
    more = [turned(thruster) for thruster in vehicle.thrusters if thruster.azimuth]
    return vehicle._replace(thrusters=(*vehicle.thrusters, *more))

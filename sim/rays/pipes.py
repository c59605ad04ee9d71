"""Pieces of pipelines and cables near a sensor, as cylinders. Pieces beyond the sensor's reach are left out."""

from array import array
from collections.abc import Sequence
from math import hypot, inf, sqrt

from hil.common.vectors import Vector3
from sim.environment.world import World
from sim.rays.solids import ABSENT, ROW, Solid, cylinder

_MARGIN = 30.0  # m beyond a sensor's reach: a sensor can move this far before pieces are searched again
_JOINT = 0.1  # diameters by which a piece is longer at both ends, so that bends have no gaps
_MIN_ROWS = 32
_UNUSED = array("d", ABSENT.numbers(0))


class NearPipes:
    """The pieces near a position, as `rows` of a scene with ROW numbers each; unused rows are far away.

    Each row contains the object number of its pipeline; that of the first pipeline is `first`.
    """

    def __init__(self, world: World, first: int) -> None:
        self._world, self._first = world, first
        self._centre, self._within = (inf, inf), 0.0
        self.rows = _UNUSED * _MIN_ROWS

    def update(self, origin: Sequence[float], reach: float) -> bool:
        """Find the pieces within `reach` m of `origin` (NED, m); return True if `rows` changed."""
        north, east = origin[0], origin[1]
        away = hypot(north - self._centre[0], east - self._centre[1])
        if away + reach <= self._within:
            return False
        self._centre, self._within = (north, east), reach + _MARGIN
        numbers = [
            row
            for number, pipeline in enumerate(self._world.pipeline, self._first)
            if not pipeline.is_buried
            for one, other in pipeline.pieces(self._world.seabed, self._world.spacing(), north, east, self._within)
            for row in piece(one, other, 0.5 * pipeline.diameter).numbers(number)
        ]
        count = max(_MIN_ROWS, len(self.rows) // ROW, len(numbers) // ROW)
        rows = array("d", numbers) + _UNUSED * (count - len(numbers) // ROW)
        changed = rows != self.rows
        self.rows = rows
        return changed


def piece(begin: Vector3, end: Vector3, radius: float) -> Solid:
    """Return the cylinder between two points (NED, m), longer by `_JOINT` at both ends."""
    x, y, z = (b - a for a, b in zip(begin, end, strict=True))
    length = sqrt(x * x + y * y + z * z) or 1.0
    x, y, z = x / length, y / length, z / length
    level = sqrt(x * x + y * y)
    a, b = (-y / level, x / level) if level else (1.0, 0.0)  # the horizontal direction across it
    # Columns: that direction, the direction across both, and that along the piece.
    rotation = (a, -z * b, x, b, z * a, y, 0.0, x * b - y * a, z)
    middle = tuple(0.5 * (p + q) for p, q in zip(begin, end, strict=True))
    return cylinder(middle, radius, 0.5 * length + _JOINT * 2.0 * radius, rotation)

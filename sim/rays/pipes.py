"""Pieces of pipelines and cables about a sensor, as cylinders: the rays of a sensor meet no others."""

from array import array
from collections.abc import Sequence
from math import hypot, inf, sqrt

from hil.common.vectors import Vector3
from sim.environment.world import World
from sim.rays.solids import POSITION, ROW, Solid, cylinder

_MARGIN = 30.0  # m beyond a sensor's reach: it goes so far before pieces are looked for again
_JOINT = 0.1  # diameters that a piece is longer at both ends, so that bends have no gaps
_FAR = 1e9  # m: where rows are that stand for nothing
_LEAST_ROWS = 32


class NearPipes:
    """The pieces near a place, as rows of a scene: `rows` of ROW numbers, those that stand for nothing far away.

    Each row names whose piece it is: the number of the pipeline among the objects, the first of which is `first`.
    """

    def __init__(self, world: World, first: int) -> None:
        self._world, self._first = world, first
        self._place, self._within = (inf, inf), 0.0
        self.rows = _nothing(_LEAST_ROWS)

    def follow(self, origin: Sequence[float], reach: float) -> bool:
        """Look for the pieces within `reach` m of `origin`, or of several, one after another; True for other rows."""
        north, east = origin[0], origin[1]
        if len(origin) > 3:
            norths, easts = origin[0::3], origin[1::3]
            (south, north), (west, east) = (min(norths), max(norths)), (min(easts), max(easts))
            reach += 0.5 * hypot(north - south, east - west)
            north, east = 0.5 * (south + north), 0.5 * (west + east)
        away = hypot(north - self._place[0], east - self._place[1])
        if away + reach <= self._within:
            return False
        self._place, self._within = (north, east), reach + _MARGIN
        made = [
            row
            for number, pipeline in enumerate(self._world.pipeline, self._first)
            if not pipeline.is_buried
            for one, other in pipeline.pieces(self._world.seabed, self._world.spacing(), north, east, self._within)
            for row in piece(one, other, 0.5 * pipeline.diameter).numbers(number)
        ]
        wanted = max(_LEAST_ROWS, len(self.rows) // ROW, len(made) // ROW)
        found = array("d", made)
        found.extend(_nothing(wanted - len(made) // ROW))
        changed = found != self.rows
        self.rows = found
        return changed


def piece(one: Vector3, other: Vector3, radius: float) -> Solid:
    """Return the cylinder between two places (NED, m), a little longer."""
    x, y, z = (b - a for a, b in zip(one, other, strict=True))
    length = sqrt(x * x + y * y + z * z) or 1.0
    x, y, z = x / length, y / length, z / length
    level = sqrt(x * x + y * y)
    a, b = (-y / level, x / level) if level else (1.0, 0.0)  # across it, on the level
    # Columns: across, across both, along.
    rotation = (a, -z * b, x, b, z * a, y, 0.0, x * b - y * a, z)
    middle = tuple(0.5 * (p + q) for p, q in zip(one, other, strict=True))
    return cylinder(middle, radius, 0.5 * length + _JOINT * 2.0 * radius, rotation)


def _nothing(count: int) -> "array[float]":
    row = cylinder((0.0, 0.0, 0.0), 0.0, 0.0).numbers(0)
    row[POSITION] = _FAR
    return array("d", row * count)

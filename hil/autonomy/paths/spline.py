"""Natural cubic spline through given points."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import atan2, dist, hypot
from typing import NamedTuple

from hil.autonomy.paths.curves import PathPoint, Position
from hil.common.errors import MissionError

_PARTS = 64  # between two points, for measuring the length
_STEPS = 3  # of the search for a place within a part
_LEVEL = 1e-9  # horizontal share below which (vertical, or in a cusp) the turn of the heading is undefined


class Spline:
    """Natural cubic spline through `points` (m, NED).

    Its parameter is the chord length from point to point. Direction and curvature are continuous (de Boor, "A Practical
    Guide to Splines", 2001, chapter IV), except in a cusp where the points lead straight back. `length` m. Raises
    MissionError if there are fewer than two points or two neighbouring points are the same.
    """

    def __init__(self, points: Sequence[Position]) -> None:
        self._chords = [dist(a, b) for a, b in pairwise(points)]
        if not self._chords or min(self._chords) <= 0.0:
            raise MissionError("a spline needs at least two points, each different from the one before")
        axes = [_natural([point[axis] for point in points], self._chords) for axis in range(3)]
        self._spans = list(zip(*axes, strict=True))
        self._begins = [0.0, *accumulate(self._measure(number, 1.0) for number in range(_PARTS * len(self._chords)))]
        self.length = self._begins[-1]

    def at(self, along: float) -> PathPoint:
        """Return the place at this distance (m) from the start, 0 to `length`."""
        number = min(max(bisect_right(self._begins, along) - 1, 0), len(self._begins) - 2)
        begin, end = self._begins[number : number + 2]
        share = (along - begin) / (end - begin)
        for _ in range(_STEPS):
            slope = self._measure(number, share) / share if share else 0.0
            share = min(1.0, (along - begin) / slope) if slope else share
        cubics, t = self._locate(number + share)
        position = tuple(cubic.value(t) for cubic in cubics)
        north, east, down = (cubic.slope(t) for cubic in cubics)
        bend_north, bend_east, _ = (cubic.bend(t) for cubic in cubics)
        level, whole = hypot(north, east), hypot(north, east, down)
        turn = (north * bend_east - east * bend_north) / (level * level * whole) if level > _LEVEL else 0.0
        return PathPoint((position[0], position[1], position[2]), atan2(east, north), atan2(down, level), turn)

    def corners(self) -> list[float]:
        """Return an empty list: the direction is continuous."""
        return []

    def _locate(self, part: float) -> "tuple[Sequence[_Cubic], float]":
        """Return north, east and down as cubics, and their parameter, at a place counted in parts."""
        span = min(int(part / _PARTS), len(self._spans) - 1)
        return self._spans[span], self._chords[span] * (part / _PARTS - span)

    def _measure(self, number: int, share: float) -> float:
        """Return the length (m) of a part up to a share of its parameter, by Simpson's rule."""
        first, middle, last = (self._speed(number + share * at) for at in (0.0, 0.5, 1.0))
        return self._chords[number // _PARTS] / _PARTS * share * (first + 4.0 * middle + last) / 6.0

    def _speed(self, part: float) -> float:
        """Return the length (m) for each m of the parameter, at a place counted in parts."""
        cubics, t = self._locate(part)
        return hypot(*(cubic.slope(t) for cubic in cubics))


class _Cubic(NamedTuple):
    """a + b t + c t² + d t³."""

    a: float
    b: float
    c: float
    d: float

    def value(self, t: float) -> float:
        return self.a + t * (self.b + t * (self.c + t * self.d))

    def slope(self, t: float) -> float:
        return self.b + t * (2.0 * self.c + 3.0 * t * self.d)

    def bend(self, t: float) -> float:
        return 2.0 * self.c + 6.0 * t * self.d


def _natural(values: Sequence[float], chords: Sequence[float]) -> list[_Cubic]:
    """Return the cubics of one coordinate: second derivatives by a tridiagonal system, 0 at both ends."""
    slopes = [(b - a) / h for (a, b), h in zip(pairwise(values), chords, strict=True)]
    bends = [0.0, *_tridiagonal(chords, [6.0 * (b - a) for a, b in pairwise(slopes)]), 0.0]
    return [
        _Cubic(value, slope - h * (2.0 * m + after) / 6.0, m / 2.0, (after - m) / (6.0 * h))
        for value, slope, h, (m, after) in zip(values, slopes, chords, pairwise(bends), strict=False)
    ]


def _tridiagonal(chords: Sequence[float], right: Sequence[float]) -> list[float]:
    """Solve h[i-1] m[i-1] + 2 (h[i-1] + h[i]) m[i] + h[i] m[i+1] = right[i] by elimination."""
    diagonal = [2.0 * (a + b) for a, b in pairwise(chords)]
    solved = list(right)
    for i in range(1, len(solved)):
        factor = chords[i] / diagonal[i - 1]
        diagonal[i] -= factor * chords[i]
        solved[i] -= factor * solved[i - 1]
    for i in reversed(range(len(solved))):
        after = chords[i + 1] * solved[i + 1] if i + 1 < len(solved) else 0.0
        solved[i] = (solved[i] - after) / diagonal[i]
    return solved

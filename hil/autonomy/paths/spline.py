"""Natural cubic spline through given points."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from math import atan2, dist, hypot
from typing import NamedTuple

from hil.autonomy.paths.curves import PathPoint, Position
from hil.common.errors import MissionError

# Gauss-Legendre quadrature on [-1, 1]: node and weight.
_NODES = (
    (0.0, 0.5688888888888889),
    (-0.5384693101056831, 0.47862867049936647),
    (0.5384693101056831, 0.47862867049936647),
    (-0.9061798459386640, 0.23692688505618908),
    (0.9061798459386640, 0.23692688505618908),
)
_PARTS = 4  # least number of parts between two points for measuring the length
_PRECISION = 1e-9  # share of the distance between two points; parts are halved until their length is this precise
_MAX_STEPS = 40  # enough for a bisection alone to find a place to 1e-12 of its part
_LEVEL = 1e-9  # horizontal share below which (vertical, or in a cusp) the turn of the heading is undefined


class Spline:
    """Natural cubic spline through `points` (m, NED).

    Its parameter is the chord length from point to point. Direction and curvature are continuous (de Boor, "A Practical
    Guide to Splines", 2001, chapter IV), except in a cusp where the points lead straight back. `length` m. Raises
    MissionError if there are fewer than two points or two neighbouring points are the same.
    """

    def __init__(self, points: Sequence[Position]) -> None:
        chords = [dist(a, b) for a, b in pairwise(points)]
        if not chords or min(chords) <= 0.0:
            raise MissionError("a spline needs at least two points, each different from the one before")
        axes = [_natural([point[axis] for point in points], chords) for axis in range(3)]
        self._parts = [
            part
            for chord, *cubics in zip(chords, *axes, strict=True)
            for number in range(_PARTS)
            for part in _Part(cubics, chord * number / _PARTS, chord / _PARTS).split(_PRECISION * chord)
        ]
        self._begins = [0.0, *accumulate(part.measure(part.size) for part in self._parts)]
        self.length = self._begins[-1]

    def at(self, along: float) -> PathPoint:
        """Return the place at this distance (m) from the start, 0 to `length`."""
        number = min(max(bisect_right(self._begins, along) - 1, 0), len(self._parts) - 1)
        part = self._parts[number]
        return part.point_at(part.find(along - self._begins[number], self._begins[number + 1] - self._begins[number]))

    def corners(self) -> list[float]:
        """Return an empty list: the direction is continuous."""
        return []


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


class _Part(NamedTuple):
    """A part of the curve: north, east, down as cubics, from the parameter `begin` over `size`."""

    cubics: Sequence[_Cubic]
    begin: float
    size: float

    def speed(self, t: float) -> float:
        return hypot(*(cubic.slope(self.begin + t) for cubic in self.cubics))

    def measure(self, t: float) -> float:
        """Return the length (m) up to the parameter `t` after the beginning."""
        return 0.5 * t * sum(weight * self.speed(0.5 * t * (1.0 + node)) for node, weight in _NODES)

    def split(self, precision: float) -> Iterator["_Part"]:
        """Halve this part until the length of each piece is known to `precision` (m); yield the pieces in order.

        Near a cusp the speed falls to 0 and rises again within a part. No single quadrature rule measures this: two
        that agree may both be wrong. So the speed must not vary much within a piece, unless the piece is shorter than
        the precision.
        """
        half = 0.5 * self.size
        halves = [self._replace(size=half), self._replace(begin=self.begin + half, size=half)]
        length = sum(piece.measure(half) for piece in halves)
        speeds = [self.speed(half * (1.0 + node)) for node in (-1.0, *(node for node, _ in _NODES), 1.0)]
        even = max(speeds) <= 2.0 * min(speeds) and abs(length - self.measure(self.size)) <= precision
        if even or length <= precision:
            yield self
            return
        for piece in halves:
            yield from piece.split(precision)

    def find(self, target_length: float, length: float) -> float:
        """Return the parameter (after the beginning) at which this part, `length` m long, is `target_length` m long.

        It uses Newton's method, which converges at once where the speed hardly changes. A step that leaves the bracket
        of the solution, as near a cusp, is replaced by a bisection.
        """
        low, high = 0.0, self.size
        t = self.size * target_length / length
        for _ in range(_MAX_STEPS):
            excess, speed = self.measure(t) - target_length, self.speed(t)
            low, high = (low, t) if excess > 0.0 else (t, high)
            following = t - excess / speed if speed else -1.0
            if not low <= following <= high:
                following = 0.5 * (low + high)
            if abs(following - t) <= 1e-12 * self.size:
                return following
            t = following
        return t

    def point_at(self, t: float) -> PathPoint:
        t += self.begin
        position = tuple(cubic.value(t) for cubic in self.cubics)
        north, east, down = (cubic.slope(t) for cubic in self.cubics)
        bend_north, bend_east, _ = (cubic.bend(t) for cubic in self.cubics)
        level, whole = hypot(north, east), hypot(north, east, down)
        turn = (north * bend_east - east * bend_north) / (level * level * whole) if level > _LEVEL else 0.0
        return PathPoint((position[0], position[1], position[2]), atan2(east, north), atan2(down, level), turn)


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

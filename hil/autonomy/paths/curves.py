"""Curves in three dimensions, parametrised by the distance along them, for trajectories.

Curves of circular arcs and straight lines are a `Chain` of `Piece`s: a straight line, a circle, a helix, a Dubins path
(`hil.autonomy.paths.dubins`). A spline (`hil.autonomy.paths.spline`) passes smoothly through given points. The world
frame is NED: headings in rad from north, clockwise seen from above. The slope is the angle of the curve below the
horizontal, so it is positive in a dive.
"""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import atan2, cos, hypot, pi, remainder, sin
from typing import NamedTuple, Protocol

from hil.common.errors import MissionError

Position = tuple[float, float, float]  # north, east, down in m

# A piece with a total turn (rad) below this counts as straight, because the closed form would divide by almost 0.
_STRAIGHT = 1e-9
# Two pieces whose directions differ by more than this (rad) form a corner.
_CORNER = 1e-6


class PathPoint(NamedTuple):
    """A point of a curve.

    `position` m, NED; `heading` and `slope` rad; `heading_rate` rad/m: change of heading along the curve, positive to
    starboard. At v m/s a vehicle turns at v x turn rad/s.
    """

    position: Position
    heading: float
    slope: float
    heading_rate: float


class Curve(Protocol):
    """Interface of a curve: its `length` in m, and the place at each distance; at a corner that of the next piece."""

    @property
    def length(self) -> float:
        """Length in m."""
        ...

    def at(self, along: float) -> PathPoint:
        """Return the place at this distance (m) from the start."""
        ...

    def corners(self) -> list[float]:
        """Return the distances (m) of the corners between its ends, where a vehicle has to stop and turn."""
        ...


class Piece(NamedTuple):
    """Part of a helix: `length` m from `start` on, at a constant `slope` and `heading_rate` (rad/m; 0: straight)."""

    start: Position
    heading: float
    slope: float
    heading_rate: float
    length: float

    def at(self, along: float) -> PathPoint:
        """Return the place at this distance (m) from the start."""
        north, east, down = self.start
        level, angle = along * cos(self.slope), along * self.heading_rate
        # length of the chord: that of the arc times sinc of half the turn; its direction is off by half the turn
        chord = level * (sin(angle / 2.0) / (angle / 2.0) if abs(angle) > _STRAIGHT else 1.0)
        course = self.heading + angle / 2.0
        position = north + chord * cos(course), east + chord * sin(course), down + along * sin(self.slope)
        return PathPoint(position, self.heading + angle, self.slope, self.heading_rate)


class Chain:
    """Pieces one after the other."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        if not pieces:
            raise MissionError("a curve needs at least one piece")
        self.pieces = tuple(pieces)
        self._ends = list(accumulate(piece.length for piece in pieces))
        self.length = self._ends[-1]

    def at(self, along: float) -> PathPoint:
        """Return the place at this distance (m) from the start, 0 to `length`."""
        number = min(bisect_right(self._ends, along), len(self.pieces) - 1)
        begins = self._ends[number - 1] if number else 0.0
        return self.pieces[number].at(along - begins)

    def corners(self) -> list[float]:
        """Return the distances (m) of the corners between its ends."""
        joints = zip(pairwise(self.pieces), self._ends, strict=False)
        return [end for (piece, after), end in joints if _bent(piece.at(piece.length), after)]


def _bent(before: PathPoint, after: Piece) -> bool:
    """Return whether the directions of two pieces differ where they join."""
    heading = abs(remainder(after.heading - before.heading, 2.0 * pi))
    return max(heading, abs(after.slope - before.slope)) > _CORNER


def straight(start: Position, end: Position, heading: float = 0.0) -> Piece:
    """Return the straight line between two points (m, NED). `heading` (rad) is used for a vertical line only."""
    north, east, down = (b - a for a, b in zip(start, end, strict=True))
    level = hypot(north, east)
    if level > 0.0:
        heading = atan2(east, north)
    return Piece(start, heading, atan2(down, level), 0.0, hypot(level, down))


def polyline(points: Sequence[Position]) -> Chain:
    """Return straight lines from point to point (m, NED). Raises MissionError if all points are the same."""
    pieces: list[Piece] = []
    for start, end in pairwise(points):
        if start != end:
            pieces.append(straight(start, end, pieces[-1].heading if pieces else 0.0))
    if not pieces:
        raise MissionError("a path needs at least two different points")
    return Chain(pieces)


def helix(centre: Position, radius: float, turns: float, dive: float = 0.0, bearing: float = 0.0) -> Chain:
    """Return a helix of `turns` turns around `centre` (m, NED, of the first turn), which ends `dive` m deeper.

    `radius` m. It starts at `bearing` (rad from north) seen from the centre and goes clockwise seen from above, with
    negative `turns` counter-clockwise. Raises MissionError if `radius` is not positive or `turns` is 0.
    """
    if not radius > 0.0 or turns == 0.0:
        raise MissionError(f"a radius of {radius:g} m and {turns:g} turns make no helix; neither may be 0")
    side = 1.0 if turns > 0.0 else -1.0
    level = 2.0 * pi * radius * abs(turns)
    length = hypot(level, dive)
    start = centre[0] + radius * cos(bearing), centre[1] + radius * sin(bearing), centre[2]
    return Chain([Piece(start, bearing + side * pi / 2.0, atan2(dive, level), side * level / radius / length, length)])


def circle(centre: Position, radius: float, turns: float = 1.0, bearing: float = 0.0) -> Chain:
    """Return a `helix` without a dive."""
    return helix(centre, radius, turns, 0.0, bearing)

"""Dubins paths with climb: shortest paths of a vehicle that cannot turn on the spot.

In the plane the path is one of six words of three pieces: two arcs of the least radius with a straight line or an arc
between them (Dubins, American Journal of Mathematics 79, 1957; closed forms after Shkel & Lumelsky, Robotics and
Autonomous Systems 34, 2001). The depth changes linearly along the path. If the plane path is too short for the steepest
slope, whole circles to starboard are added at the end, enlarged to fit the slope (Chitsaz & LaValle, CDC 2007, for the
case of high altitude). The result is good, but not always the shortest in three dimensions.
"""

from collections.abc import Callable
from math import acos, atan2, cos, floor, hypot, pi, sin, sqrt, tan
from typing import NamedTuple

from hil.autonomy.paths.curves import Chain, Piece, Position
from hil.common.errors import MissionError

_DUST = 1e-9

Lengths = tuple[float, float, float]  # of the three pieces, in radii


class Pose(NamedTuple):
    """A position (m, NED) and a heading (rad from north, clockwise seen from above)."""

    position: Position
    heading: float


def dubins(start: Pose, end: Pose, radius: float, steepest: float = pi / 6.0) -> Chain:
    """Return the Dubins path from `start` to `end` with turns of `radius` m, nowhere steeper than `steepest` rad.

    Raises MissionError if the radius is not positive, the steepest slope is not between 0 and 90 degrees, or start and
    end have the same horizontal pose.
    """
    if not radius > 0.0 or not 0.0 < steepest < pi / 2.0:
        raise MissionError("a Dubins path needs a turning radius above 0 m and a steepest slope between 0 and 90 deg")
    north, east, dive = (b - a for a, b in zip(start.position, end.position, strict=True))
    turns, lengths = _shortest(start.heading, end.heading, north / radius, east / radius)
    pieces = [(turn / radius, length * radius) for turn, length in zip(turns, lengths, strict=True)]
    level = sum(length for _, length in pieces)
    lacking = abs(dive) / tan(steepest) - level
    if lacking > _DUST:
        rounds = max(1, floor(lacking / (2.0 * pi * radius)))
        pieces.append((1.0 / max(radius, lacking / (2.0 * pi * rounds)), max(lacking, 2.0 * pi * radius * rounds)))
    return _make_chain(start, pieces, atan2(dive, sum(length for _, length in pieces)))


def _make_chain(start: Pose, pieces: list[tuple[float, float]], slope: float) -> Chain:
    """Return a chain of pieces (turn per horizontal metre, horizontal length), all with one slope."""
    laid: list[Piece] = []
    position, heading = start
    for turn, level in pieces:
        if level > _DUST:
            laid.append(Piece(position, heading, slope, turn * cos(slope), level / cos(slope)))
            position, heading = laid[-1].at(laid[-1].length)[:2]
    if not laid:
        raise MissionError("a Dubins path needs two poses that differ by more than their depth")
    return Chain(laid)


def _shortest(heading: float, end_heading: float, north: float, east: float) -> tuple[Lengths, Lengths]:
    """Return the best word: turn of each piece (1 to starboard, -1 to port, 0 straight), and lengths in radii."""
    distance, course = hypot(north, east), atan2(east, north)
    candidates: list[tuple[Lengths, Lengths]] = []
    for side in (1.0, -1.0):  # words that begin to port are mirror images of those that begin to starboard
        a, b = side * (heading - course), side * (end_heading - course)
        for (first, second, third), word in _WORDS:
            lengths = word(a, b, distance)
            if lengths is not None:
                candidates.append(((side * first, side * second, side * third), lengths))
    return min(candidates, key=lambda candidate: sum(candidate[1]))


def _same_turns(a: float, b: float, distance: float) -> Lengths | None:
    """Return the lengths of the word starboard, straight, starboard; None if there is none.

    `a` and `b` are the headings relative to the line from start to end.
    """
    ahead, lateral = distance + sin(a) - sin(b), cos(b) - cos(a)
    course = atan2(lateral, ahead)
    return _round(course - a), hypot(ahead, lateral), _round(b - course)


def _opposite_turns(a: float, b: float, distance: float) -> Lengths | None:
    """Return the lengths of the word starboard, straight, port; None if there is none."""
    ahead, lateral = distance + sin(a) + sin(b), -cos(a) - cos(b)
    square = ahead * ahead + lateral * lateral - 4.0
    if square < 0.0:
        return None
    line = sqrt(square)
    course = atan2(lateral, ahead) + atan2(2.0, line)
    return _round(course - a), line, _round(course - b)


def _three_turns(a: float, b: float, distance: float) -> Lengths | None:
    """Return the lengths of the word starboard, port, starboard; None if the ends are too far from each other."""
    ahead, lateral = distance + sin(a) - sin(b), cos(b) - cos(a)
    cosine = 1.0 - (ahead * ahead + lateral * lateral) / 8.0
    if cosine < -1.0:
        return None
    middle = 2.0 * pi - acos(cosine)
    first = _round(atan2(lateral, ahead) - a + middle / 2.0)
    return first, middle, _round(b - a - first + middle)


def _round(angle: float) -> float:
    """Return `angle` in [0, 2 pi); a value slightly below 2 pi by rounding gives 0, not a whole circle."""
    angle %= 2.0 * pi
    return 0.0 if angle > 2.0 * pi - _DUST else angle


_WORDS: tuple[tuple[Lengths, Callable[[float, float, float], Lengths | None]], ...] = (
    ((1.0, 0.0, 1.0), _same_turns),
    ((1.0, 0.0, -1.0), _opposite_turns),
    ((1.0, -1.0, 1.0), _three_turns),
)

"""Line of sight along Dubins legs: guidance of a vehicle that cannot stop or turn on the spot.

The path is a chain of Dubins legs from the vehicle's own pose on, so that the vehicle can follow it from the start. The
course over ground is led to the path's direction plus atan(-e / lookahead), with the distance e from the path (Fossen
2021, "Handbook of Marine Craft Hydrodynamics and Motion Control", on line-of-sight guidance), and the path's own turn
rate is added. Leading the course instead of the heading balances a current across the path.
"""

from collections.abc import Callable, Iterator, Sequence
from heapq import heappop, heappush
from itertools import count, pairwise
from math import atan2, cos, dist, hypot, inf, pi, sin, tan
from typing import TYPE_CHECKING

from hil.autonomy.control.controller import VelocityCommand, clamp, wrap
from hil.autonomy.paths.curves import Chain, Piece, Position
from hil.autonomy.paths.dubins import Pose, dubins
from hil.autonomy.paths.pursuit import DEPTH_AHEAD_S
from hil.autonomy.paths.trajectory import Limits
from hil.common.errors import MissionError, NoPathError

if TYPE_CHECKING:
    from hil.autonomy.paths.occupancy import OccupancyGrid  # numpy, which a client does not need

Point = tuple[float, float]  # north, east in m
Search = Callable[[Point], list[Point]]  # returns the corners of a way from a point on
Approach = Callable[[Pose], Chain]  # returns the path from a pose on

_SKIPPED = 3  # corners of a way around obstacles that a leg may leave out
_HEADINGS = 12  # directions to try at a waypoint, besides those of the straight legs
_COURSE_GAIN = 1.0  # 1/s; a lower one would let a gyro's turn-on error lead the vehicle metres off the path
_BEND = pi / 12.0  # rad between two points of a curve's outline


def dubins_legs(
    points: Sequence[Position], heading: float, limits: Limits, grid: "OccupancyGrid | None" = None
) -> Chain:
    """Return the shortest chain of Dubins legs from `points[0]` and `heading` (rad) to the last of `points` (m, NED).

    It passes each point in the best of some directions. With a `grid` it stays on free cells, and a leg may leave out
    points, as they are only corners of a way around obstacles. Raises NoPathError if there is no such chain.
    """
    radius, steepest = limits.turn_radius, min(limits.climb_angle, 0.49 * pi)
    order = count()  # so that the heap never compares legs
    heap: list[tuple[float, int, float, int, float, tuple[Piece, ...], int]] = []
    heappush(heap, (0.0, next(order), 0.0, 0, heading, (), 0))
    done: set[tuple[int, float]] = set()
    while heap:
        _, _, length, number, course, pieces, new = heappop(heap)
        if (number, course) in done or (grid and new and not grid.are_free(outline(pieces[-new:], grid.resolution))):
            continue
        if number == len(points) - 1:
            return Chain(pieces)
        done.add((number, course))
        for after in range(number + 1, min(number + 2 + (_SKIPPED if grid else 0), len(points))):
            for next_course in _courses(points, number, after):
                try:
                    leg = dubins(Pose(points[number], course), Pose(points[after], next_course), radius, steepest)
                except MissionError:  # the two poses are the same
                    continue
                total = length + leg.length
                left = total + sum(dist(a[:2], b[:2]) for a, b in pairwise(points[after:]))
                legs = (*pieces, *leg.pieces)
                heappush(heap, (left, next(order), total, after, next_course, legs, len(leg.pieces)))
    remedy = "lessen the margin or the speed, or start with another heading or in more room"
    raise NoPathError(f"no free path with turns of {radius:.1f} m leads to the goal: {remedy}")


def approach_on(grid: "OccupancyGrid", search: Search, pose: Pose, goal: Position, limits: Limits) -> Chain:
    """Return Dubins legs over free cells of `grid` from `pose` to `goal` (m, NED).

    Where no direct leg is free, `search` returns the corners of a way from a point. Raises MissionError.
    """

    def legs(corners: Sequence[Point]) -> Chain:
        points = depths_along(corners, pose.position, goal, limits.climb_angle)
        return dubins_legs(points, pose.heading, limits, grid)

    here = pose.position[:2]
    try:
        return legs([here, goal[:2]])
    except NoPathError:
        return legs(search(here))


def _courses(points: Sequence[Position], before: int, number: int) -> Iterator[float]:
    """Yield directions (rad) in which the vehicle may pass a point that it comes to from point `before`."""
    ends = [(points[before], points[number])]
    ends += [(points[number], points[number + 1]), (points[before], points[number + 1])] if points[number + 1 :] else []
    yield from (atan2(b[1] - a[1], b[0] - a[0]) for a, b in ends)
    yield from (2.0 * pi * turn / _HEADINGS for turn in range(_HEADINGS))


def outline(pieces: Sequence[Piece], spacing: float = inf) -> list[Position]:
    """Return points along a curve (m, NED): its bends as short lines, and all at most `spacing` m apart."""
    points = [pieces[0].start]
    for piece in pieces:
        parts = 1 + int(max(abs(piece.heading_rate) * piece.length / _BEND, piece.length / spacing))
        points += [piece.at(piece.length * part / parts).position for part in range(1, parts + 1)]
    return points


class LineOfSight:
    """Follow the path that `approach` returns, from `start` on, at `speed` m/s within `limits`.

    The end counts as reached when the vehicle passes it abeam within `tolerance` m; otherwise, and if the vehicle has
    left the path, another approach is flown. `path` is the outline of the present path. Raises what `approach` raises.
    """

    def __init__(
        self, approach: Approach, start: Pose, speed: float, limits: Limits, lookahead: float, tolerance: float
    ) -> None:
        self._approach = approach
        self._speed = speed
        self._limits = limits
        self._lookahead = lookahead
        self._tolerance = tolerance
        self.aim = 0.0
        self.progress = 0.0
        self.has_arrived = False
        self.approaches = 0
        self.begin(start)

    def update(self, position: Sequence[float], heading: float, course: float | None = None) -> VelocityCommand:
        """Return the command at `position` (m, NED) and `heading` (rad) with a `course` over ground (rad).

        Sets `aim`, the wanted course (rad), `progress` (0 to 1) and `has_arrived`. Raises what `approach` raises.
        """
        here: Position = position[0], position[1], position[2]
        off, ahead = self._locate(here)
        is_past = self._along >= self._curve.length and ahead >= 0.0
        self.has_arrived |= is_past and abs(off) <= self._tolerance
        if self.has_arrived:
            self.progress = 1.0
            return VelocityCommand(depth=self._curve.at(self._curve.length).position[2])
        if is_past or abs(off) > max(self._limits.turn_radius, self._lookahead):
            self.begin(Pose(here, heading))
            off, _ = self._locate(here)
        self.progress = max(self.progress, self._along / self._curve.length)
        place = self._curve.at(self._along)
        self.aim = place.heading - atan2(off, self._lookahead)
        error = wrap(self.aim - (heading if course is None else course))
        turn = self._speed * place.heading_rate + _COURSE_GAIN * error
        earlier = min(self._along + DEPTH_AHEAD_S * self._speed, self._curve.length)
        return VelocityCommand(
            self._speed, yaw_rate=clamp(turn, self._limits.yaw_rate), depth=self._curve.at(earlier).position[2]
        )

    @property
    def end(self) -> Pose:
        """Position and heading at the end of the present path."""
        return Pose(*self._curve.at(self._curve.length)[:2])

    def begin(self, start: Pose) -> None:
        """Plan an approach from `start`."""
        self._curve, self._along = self._approach(start), 0.0
        self.path = outline(self._curve.pieces)
        self.approaches += 1

    def _locate(self, point: Position) -> tuple[float, float]:
        """Move to the nearest place on the path; return the distance to starboard of it and what is left ahead (m)."""
        for _ in range(2):
            place = self._curve.at(self._along)
            north, east = point[0] - place.position[0], point[1] - place.position[1]
            ahead = north * cos(place.heading) + east * sin(place.heading)
            self._along = min(max(self._along + clamp(ahead, self._lookahead), 0.0), self._curve.length)
        place = self._curve.at(self._along)
        north, east = point[0] - place.position[0], point[1] - place.position[1]
        ahead = north * cos(place.heading) + east * sin(place.heading)
        return east * cos(place.heading) - north * sin(place.heading), ahead


def circle_around(
    centre: Point, position: Sequence[float], course: float, speed: float, limits: Limits, lookahead: float
) -> VelocityCommand:
    """Return the command for circles clockwise around `centre` (m north, m east), for a vehicle that cannot stay there.

    The vehicle at `position` (m) moves with a `course` (rad) over ground.
    """
    north, east = position[0] - centre[0], position[1] - centre[1]
    aim = atan2(east, north) + pi / 2.0 + atan2(hypot(north, east) - limits.turn_radius, lookahead)
    turn = speed / limits.turn_radius + _COURSE_GAIN * wrap(aim - course)
    return VelocityCommand(speed, yaw_rate=clamp(turn, limits.yaw_rate))


def depths_along(points: Sequence[Point], start: Position, goal: Position, steepest: float) -> list[Position]:
    """Return `points` with the depths (m) of the straight line from `start` to `goal` beside them.

    They are nowhere steeper than `steepest` rad, except before the last one, which is at the depth of the goal.
    """
    from hil.autonomy.paths.occupancy import depths_near

    deep = [start]
    for point in points[1:]:
        reach = hypot(point[0] - deep[-1][0], point[1] - deep[-1][1]) * tan(steepest)
        wanted = float(depths_near([start, goal], *point))
        deep.append((*point, deep[-1][2] + clamp(wanted - deep[-1][2], reach)))
    return [*deep[:-1], (*points[-1], goal[2])]

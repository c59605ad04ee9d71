"""Pure pursuit: follow a path by steering toward a point ahead on it (Coulter 1992, CMU-RI-TR-92-01).

Coulter's curvature 2 sin(error) / lookahead at cruising speed is a turn rate of 2 speed / lookahead for each radian of
heading error. This gain stays the same while the vehicle slows down, so it turns on the spot at sharp bends. Currents
are not modelled: the velocity controller controls the speed over ground.

Where the depth of the path changes, the vehicle waits for it: the speed falls with the depth error, to 0 at the
tolerance. So the path may have any slope, and vertical parts.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import atan2, cos, dist, hypot, pi
from typing import NamedTuple

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.common.errors import MissionError

Point = tuple[float, float]  # north, east in m
Place = Sequence[float]  # north, east in m, and perhaps the depth

DEPTH_AHEAD_S = 1.25  # s; the depth of the path is commanded so much earlier: 1 / gain of the depth hold

# A bend sharper than this angle is a place to stop and turn; other bends are cut.
_SHARP = 100.0 * pi / 180.0
_BEFORE = 1e-6  # m; so far before a stop, the depth is still that before a vertical part


class PurePursuit:
    """Path follower along `path` (m north, m east, and perhaps depth); the vehicle stops at the end.

    `lookahead` m: distance ahead on the path of the point to steer toward; corners are cut by up to about a third of
    it. `speed` m/s is reduced by the heading error, and within one lookahead of a stop. The turn rate is limited to
    `max_yaw_rate` rad/s. A stop, and the end, counts as reached within `tolerance` m, in depth too if that changes
    along the path. Raises MissionError if the path is empty or a parameter is not positive.
    """

    def __init__(
        self,
        path: Sequence[Place],
        lookahead: float,
        speed: float,
        max_yaw_rate: float = 0.5,
        tolerance: float = 0.5,
    ) -> None:
        if not path:
            raise MissionError("the path to follow is empty; plan one first")
        if not min(lookahead, speed, max_yaw_rate, tolerance) > 0.0:
            raise MissionError("path following needs a lookahead, speed, turn rate and tolerance above 0")
        self._lookahead = lookahead
        self._speed = speed
        self._max_yaw_rate = max_yaw_rate
        self._tolerance = tolerance
        self._path = _Path(path)
        self._dives = len({place[2] for place in path if len(place) > 2}) > 1
        self._surge = 0.0
        self._is_at_stop = False
        self._stops = self._path.stops()
        self._begin_stop(self._stops.pop(0))
        self._passed = 0.0  # distance along the path of the last stop
        self._along = 0.0
        self.aim = 0.0
        self.progress = 0.0
        self.has_arrived = False

    def update(self, position: Sequence[float], heading: float, course: float | None = None) -> VelocityCommand:
        """Return the command at `position` (m north, m east, depth if the path has one) and `heading` (rad from north).

        The `course` over ground is for a `LineOfSight`; here it is not used.

        Sets `aim`, the heading (rad) to the point ahead; `progress`, the share of the path that is done, 0 to 1; and
        `has_arrived`, which stays true once the end is reached.
        """
        point = position[0], position[1]
        self._locate(point)
        self._is_at_stop |= self._is_near_stop(point)
        if self._is_at_stop and not self.has_arrived:
            while self._dives and self._holds:
                if abs(position[2] - self._holds[0]) > self._tolerance:
                    return VelocityCommand(depth=self._holds[0])
                self._holds.pop(0)
            self._is_at_stop = False
            self._passed = self._along = self._stop
            self.has_arrived = not self._stops
            self._begin_stop(self._stops.pop(0) if self._stops else self._stop)
        if self.has_arrived:
            self.progress = 1.0
            return VelocityCommand(depth=self._path.depth(self._stop))
        self.progress = max(self.progress, self._along / self._path.length if self._path.length else 0.0)
        aim_north, aim_east = self._path.at(min(self._along + self._lookahead, self._stop))
        self.aim = atan2(aim_east - point[1], aim_north - point[0])
        error = wrap(self.aim - heading)
        gain = 2.0 * self._speed / self._lookahead
        turn = min(self._max_yaw_rate, max(-self._max_yaw_rate, gain * error))
        error_of_depth = abs(position[2] - (self._path.depth(self._along) or 0.0)) if self._dives else 0.0
        slower = max(0.0, 1.0 - error_of_depth / self._tolerance)
        self._surge = slower * self._surge_along(point, error)
        ahead = min(self._along + DEPTH_AHEAD_S * self._surge, self._stop - _BEFORE)
        return VelocityCommand(surge=self._surge, yaw_rate=turn, depth=self._path.depth(ahead))

    def _locate(self, position: Point) -> None:
        """Find the nearest point of the path, not far from the last one, as a path may come near itself."""
        low = max(self._passed, self._along - self._lookahead)
        high = min(self._stop, self._along + self._lookahead)
        self._along = self._path.nearest(position, low, high)

    def _is_near_stop(self, position: Point) -> bool:
        near_in_path = self._along >= self._stop - max(self._lookahead, self._tolerance)
        return near_in_path and dist(position, self._path.at(self._stop)) <= self._tolerance

    def _begin_stop(self, along: float) -> None:
        self._stop, self._holds = along, list(self._path.holds.get(along, ()))

    def _surge_along(self, position: Point, error: float) -> float:
        remaining = max(self._stop - self._along, dist(position, self._path.at(self._stop)))
        return self._speed * max(0.0, cos(error)) * min(1.0, remaining / self._lookahead)


class _Leg(NamedTuple):
    """A straight leg of the path: start, direction as a unit vector, and its begin and end along the path (m).

    `depths` (m) are those of its ends, if the path has any.
    """

    start: Point
    direction: Point
    begins: float
    ends: float
    depths: Sequence[float] = ()

    def at(self, along: float) -> Point:
        """Return the point at this distance (m) along the path."""
        distance = along - self.begins
        return self.start[0] + distance * self.direction[0], self.start[1] + distance * self.direction[1]


class _Path:
    """A path parametrised by the distance along it, in m from its start.

    `holds` are the depths (m) at the ends of its legs: several, one after the other, at vertical parts.
    """

    def __init__(self, points: Sequence[Place]) -> None:
        self._legs: list[_Leg] = []
        self.length = 0.0
        self.holds: dict[float, list[float]] = {}
        for (north, east, *deep), (to_north, to_east, *to_deep) in pairwise(points):
            size = hypot(to_north - north, to_east - east)
            if size > 0.0:
                direction = (to_north - north) / size, (to_east - east) / size
                ends = self.length + size
                self._legs.append(_Leg((north, east), direction, self.length, ends, (*deep, *to_deep)))
                self.length = ends
            self.holds.setdefault(self.length, []).extend(to_deep)
        if not self._legs:
            self._legs.append(_Leg((points[0][0], points[0][1]), (1.0, 0.0), 0.0, 0.0))
        self._last = points[-1]

    def stops(self) -> list[float]:
        """Return where to stop: at sharp bends, at vertical parts, and at the end."""
        bends = [
            leg.ends
            for leg, after in pairwise(self._legs)
            if leg.direction[0] * after.direction[0] + leg.direction[1] * after.direction[1] < cos(_SHARP)
            or len(set(self.holds[leg.ends])) > 1
        ]
        return [*bends, self.length]

    def at(self, along: float) -> Point:
        """Return the point at this distance (m) along the path."""
        leg = next((leg for leg in self._legs if along < leg.ends), self._legs[-1])
        return leg.at(along)

    def depth(self, along: float) -> float | None:
        """Return the depth (m) at this distance (m) along the path, below a step; None if the path has no depths."""
        leg = next((leg for leg in self._legs if along < leg.ends), None)
        if leg is None or not leg.depths:
            return self._last[2] if len(self._last) > 2 else None
        share = (along - leg.begins) / (leg.ends - leg.begins)
        return leg.depths[0] + share * (leg.depths[1] - leg.depths[0])

    def nearest(self, point: Point, low: float, high: float) -> float:
        """Return the place (m along) nearest to `point` between `low` and `high`."""
        best, least = low, float("inf")
        for leg in self._legs:
            if leg.begins > high or leg.ends < low:
                continue
            north, east = point[0] - leg.start[0], point[1] - leg.start[1]
            ahead = leg.begins + north * leg.direction[0] + east * leg.direction[1]
            along = min(max(ahead, low, leg.begins), high, leg.ends)
            distance = dist(point, leg.at(along))
            if distance < least:
                best, least = along, distance
        return best

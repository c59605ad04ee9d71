"""Travel to a goal on a partly known map: plan a path, follow it, avoid obstacles, replan.

A* finds the path on the map, pure pursuit follows it, and VFH+ changes heading and speed to avoid what the scan shows.
The scans also update the map; if an obstacle appears on the path, the rest is replanned. With a map of the world this
is the map-known mode; with an incomplete or empty map (`OccupancyGrid.empty`) it is the obstacle-unknown mode. Nothing
else differs.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import cos, dist, sin
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.autonomy.paths.astar import plan, smooth
from hil.autonomy.paths.dubins import Pose
from hil.autonomy.paths.laser_map import LaserMap
from hil.autonomy.paths.line_of_sight import LineOfSight, approach_on
from hil.autonomy.paths.occupancy import OccupancyGrid, Point
from hil.autonomy.paths.pursuit import PurePursuit
from hil.autonomy.paths.retreat import Retreat
from hil.autonomy.paths.trajectory import Limits
from hil.autonomy.paths.vfh import Scan, Vfh, VfhSettings
from hil.common.errors import MissionError
from hil.common.schema import Range

Search = Callable[[OccupancyGrid, Point, Point], list[Point]]

_SCANS_TO_REPLAN = 10  # scans between two attempts while there is no path


class GuideSettings(NamedTuple):
    """Settings of a `Guide` in m, m/s and rad/s. Paths keep `margin` from obstacles besides the vehicle's radius.

    With a turning radius in `limits`, the vehicle cannot stop: its paths are Dubins legs, followed with line of sight.
    """

    vfh: VfhSettings
    speed: Annotated[float, Range(0.01, 5.0, "m/s")] = 0.5
    lookahead: Annotated[float, Range(0.1, 50.0, "m")] = 2.0
    max_yaw_rate: Annotated[float, Range(0.01, 3.0, "rad/s")] = 0.5
    tolerance: Annotated[float, Range(0.05, 10.0, "m")] = 0.5
    margin: Annotated[float, Range(0.0, 10.0, "m")] = 0.5
    limits: Limits = Limits()


class Guide:
    """Guidance of a vehicle from `start` to `goal` (m north, m east), scan by scan.

    `heading` (rad) is that at the start. `search` finds the path on an inflated map: `astar.plan` or
    `any_angle.plan_any_angle`. Raises MissionError if the map at the start shows no path. Attributes: `path`: the
    present path; `plans`: number of plans made; `progress`: share of the path covered; `has_arrived`: whether the goal
    is reached; `stuck`: why there is no path any more, else "". While stuck, it replans as the map changes. A vehicle
    that can stop backs out along its track when it makes no progress, and plans a path that avoids the place.
    """

    def __init__(
        self,
        known: OccupancyGrid,
        start: Point,
        goal: Point,
        settings: GuideSettings,
        search: Search = plan,
        heading: float = 0.0,
    ) -> None:
        self.map = LaserMap(known, settings.vfh.range)
        self.plans = 0
        self.has_arrived = False
        self.stuck = ""
        self._settings = settings
        self._goal = goal
        self._search = search
        self._waited = 0
        self._vfh = Vfh(settings.vfh)
        self._heading = heading
        self.retreat = Retreat(4.0 * settings.vfh.radius, 2.0 * settings.vfh.block_within, settings.speed)
        self._plan(start)

    def update(
        self, position: Sequence[float], heading: float, scan: Scan, course: float | None = None, time: float = 0.0
    ) -> VelocityCommand:
        """Return the command at `position` (m north, m east) and `heading` (rad), where the vehicle measured `scan`.

        `course` (rad) is that over ground, which a vehicle that cannot stop needs in a current. `time` is in s.
        """
        point, self._heading = (position[0], position[1]), heading
        fresh = self.map.add(point, heading, scan)
        if (len(fresh) and self._is_blocked_by(fresh)) or self._may_be_free():
            self._replan(point)
        off_bow = 0.0 if course is None else wrap(course - heading)
        try:
            self._pursuit.update((*point, 0.0), heading, course)
        except MissionError as error:  # another approach has no free path
            self.stuck = str(error)
        self.has_arrived = self._pursuit.has_arrived
        if self.has_arrived or self.stuck:
            return VelocityCommand()
        if not self._settings.limits.turn_radius and self._retreats(point, heading, time):
            return self.retreat.command(point, heading)
        left = dist(point, self._goal)
        slower = 1.0 if self._settings.limits.turn_radius else min(1.0, left / self._settings.lookahead)
        speed = self._settings.speed * slower
        reach = left + self._settings.vfh.radius
        aim = self._pursuit.aim - off_bow
        return self._vfh.command(scan, heading, aim, speed, self._settings.max_yaw_rate, reach)

    @property
    def progress(self) -> float:
        """Share of the present path that is done, 0 to 1."""
        return self._pursuit.progress

    def _retreats(self, point: Point, heading: float, time: float) -> bool:
        """Return whether the vehicle has to go back; plan a path that avoids the dead end when it begins to."""
        if not self.retreat.is_active and not self.retreat.makes_progress(time, point):
            self.retreat.begin()
            self.map.block(self._tight_place(point), self._settings.vfh.radius + self._settings.vfh.safety)
            self._replan(point)
        return self.retreat.is_active

    def _tight_place(self, point: Point) -> Point:
        """Return the first place on the path ahead that is too narrow for VFH; that next to `point` if none is."""
        clearance = self._settings.vfh.radius + self._settings.vfh.safety
        free, step = self.map.grid.inflate(clearance), self.map.grid.resolution
        for (north, east), end in pairwise([point, *self.path[1:]]):
            way = max(1e-9, dist((north, east), end))
            for number in range(int(way / step)):
                share = number * step / way
                place = north + share * (end[0] - north), east + share * (end[1] - east)
                if dist(place, point) > clearance and not free.is_free(place):
                    return place
        aim = self._pursuit.aim
        return point[0] + 2.0 * clearance * cos(aim), point[1] + 2.0 * clearance * sin(aim)

    def _may_be_free(self) -> bool:
        """Return whether to replan now, after no path was found."""
        self._waited = self._waited + 1 if self.stuck else 0
        return self._waited > 0 and self._waited % _SCANS_TO_REPLAN == 0

    def _plan(self, start: Point, clearance: float | None = None) -> None:
        """Plan a path from `start` on the present map, `clearance` m from obstacles, and start to follow it."""
        vfh, margin = self._settings.vfh, self._settings.margin
        inflated = self.map.grid.inflate(vfh.radius + margin if clearance is None else clearance)
        if clearance is not None:  # the vehicle may be nearer to an obstacle than the clearance
            start = inflated.nearest_free(start) or start
        settings = self._settings

        def search(start: Point) -> list[Point]:
            return smooth(inflated, self._search(inflated, start, self._goal))

        self._pursuit: PurePursuit | LineOfSight
        if settings.limits.turn_radius:
            goal, limits = (*self._goal, 0.0), settings.limits
            self._pursuit = LineOfSight(
                lambda pose: approach_on(inflated, search, pose, goal, limits),
                Pose((*start, 0.0), self._heading), settings.speed, limits, settings.lookahead, settings.tolerance,
            )  # fmt: skip
            self.path = [(north, east) for north, east, _ in self._pursuit.path]
        else:
            self.path = search(start)
            self._pursuit = PurePursuit(
                self.path, settings.lookahead, settings.speed, settings.max_yaw_rate, settings.tolerance
            )
        self.plans += 1

    def _replan(self, position: Point) -> None:
        """Replan, with a smaller margin if there is no path with the full one; without any path the vehicle stops."""
        vfh, margin = self._settings.vfh, self._settings.margin
        for clearance in (vfh.radius + margin, vfh.radius + 0.5 * margin):
            try:
                self._plan(position, clearance)
            except MissionError as error:
                self.stuck = str(error)
            else:
                self.stuck = ""
                return

    def _is_blocked_by(self, cells: NDArray[np.intp]) -> bool:
        """Return whether one of these cells is nearer to the path than the radius plus half the margin."""
        grid, settings = self.map.grid, self._settings
        centres = (cells + 0.5) * grid.resolution + grid.origin
        allowed = settings.vfh.radius + 0.5 * settings.margin
        return any(distances_from_leg(centres, *leg).min() < allowed for leg in pairwise(self.path))


def distances_from_leg(points: NDArray[np.floating], start: Point, end: Point) -> NDArray[np.float64]:
    """Return the distance (m) of each of `points` from the straight line between `start` and `end`."""
    leg = np.subtract(end, start)
    share = np.clip((points - start) @ leg / max(leg @ leg, 1e-12), 0.0, 1.0)
    distances: NDArray[np.float64] = np.linalg.norm(points - start - share[:, None] * leg, axis=1)
    return distances

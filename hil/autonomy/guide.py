"""Getting to a goal past what the map knows and what it lacks: a global way, a local eye, a new way if need be.

A* finds the way on the map, pure pursuit follows it, VFH+ bends the heading and the speed round whatever the scan
shows. The scans go into the map as well; when an obstacle turns up on the way, the rest is planned anew. With a map of
the world this is the map-known mode, with one that lacks obstacles or is empty (`OccupancyGrid.empty`) the
obstacle-unknown mode: nothing else differs.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import dist
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.astar import plan, smooth
from hil.autonomy.control import VelocityCommand
from hil.autonomy.laser_map import LaserMap
from hil.autonomy.occupancy import OccupancyGrid, Point
from hil.autonomy.pursuit import PurePursuit
from hil.autonomy.vfh import Scan, Vfh, VfhSettings
from hil.errors import MissionError
from hil.schema import Range

Search = Callable[[OccupancyGrid, Point, Point], list[Point]]

_LOOK_AGAIN = 10  # scans between two looks for a way where there was none


class GuideSettings(NamedTuple):
    """How to travel: m/s, m, rad/s. `margin` m is kept from obstacles when planning, beyond the vehicle's radius."""

    vfh: VfhSettings
    speed: Annotated[float, Range(0.01, 5.0, "m/s")] = 0.5
    lookahead: Annotated[float, Range(0.1, 50.0, "m")] = 2.0
    max_yaw_rate: Annotated[float, Range(0.01, 3.0, "rad/s")] = 0.5
    tolerance: Annotated[float, Range(0.05, 10.0, "m")] = 0.5
    margin: Annotated[float, Range(0.0, 10.0, "m")] = 0.5


class Guide:
    """Leads a vehicle from `start` to `goal` (m north, m east), scan by scan.

    `search` finds the way on an inflated map: `astar.plan`, `any_angle.plan_any_angle` or the `plan` of a
    `dstar.DStarLite`. Raises MissionError if the map at the start shows no way. Afterwards `path` is the way,
    `plans` how many were made, `progress` the share of the way that lies behind, `done` whether the goal is reached,
    `stuck` why there is no way any more; it looks for one again as the map changes.
    """

    def __init__(
        self, known: OccupancyGrid, start: Point, goal: Point, settings: GuideSettings, search: Search = plan
    ) -> None:
        self.map = LaserMap(known, settings.vfh.range)
        self.plans = 0
        self.done = False
        self.stuck = ""
        self._settings = settings
        self._goal = goal
        self._search = search
        self._waited = 0
        self._vfh = Vfh(settings.vfh)
        self._plan(start)

    def update(self, position: Sequence[float], heading: float, scan: Scan) -> VelocityCommand:
        """The command at `position` (m north, m east) and `heading` (rad), where the vehicle sees `scan`."""
        here = position[0], position[1]
        fresh = self.map.add(here, heading, scan)
        if (len(fresh) and self._in_the_way(fresh)) or self._may_be_free():
            self._plan_again(here)
        self._pursuit.update(here, heading)
        self.done = self._pursuit.done
        if self.done or self.stuck:
            return VelocityCommand()
        left = dist(here, self._goal)
        speed = self._settings.speed * min(1.0, left / self._settings.lookahead)
        reach = left + self._settings.vfh.radius
        return self._vfh.command(scan, heading, self._pursuit.aim, speed, self._settings.max_yaw_rate, reach)

    @property
    def progress(self) -> float:
        """The share of the present way that lies behind, 0 to 1."""
        return self._pursuit.progress

    def _may_be_free(self) -> bool:
        """Whether it is time to look again where there was no way."""
        self._waited = self._waited + 1 if self.stuck else 0
        return self._waited > 0 and self._waited % _LOOK_AGAIN == 0

    def _plan(self, start: Point, clearance: float | None = None) -> None:
        """A way from `start` on the map so far, at least `clearance` m from what stands there."""
        vfh, margin = self._settings.vfh, self._settings.margin
        inflated = self.map.grid.inflate(vfh.radius + margin if clearance is None else clearance)
        if clearance is not None:  # the vehicle may be nearer to an obstacle than it would plan to go
            start = inflated.nearest_free(start) or start
        self.path = smooth(inflated, self._search(inflated, start, self._goal))
        self.plans += 1
        self._pursuit = PurePursuit(
            self.path,
            self._settings.lookahead,
            self._settings.speed,
            self._settings.max_yaw_rate,
            self._settings.tolerance,
        )

    def _plan_again(self, here: Point) -> None:
        """With less room where there is no way with the whole margin; without any way the vehicle stays."""
        vfh, margin = self._settings.vfh, self._settings.margin
        for clearance in (vfh.radius + margin, vfh.radius + 0.5 * margin):
            try:
                self._plan(here, clearance)
            except MissionError as error:
                self.stuck = str(error)
            else:
                self.stuck = ""
                return

    def _in_the_way(self, cells: NDArray[np.intp]) -> bool:
        """Whether one of these cells is nearer to the way than half the margin allows."""
        grid, settings = self.map.grid, self._settings
        centres = (cells + 0.5) * grid.resolution + grid.origin
        allowed = settings.vfh.radius + 0.5 * settings.margin
        return any(_distance(centres, *leg) < allowed for leg in pairwise(self.path))


def _distance(points: NDArray[np.floating], start: Point, end: Point) -> float:
    """The distance of the nearest of `points` from the straight line between `start` and `end`, m."""
    leg = np.subtract(end, start)
    share = np.clip((points - start) @ leg / (leg @ leg), 0.0, 1.0)
    return float(np.min(np.linalg.norm(points - start - share[:, None] * leg, axis=1)))

"""The default planner: it plans a path on the map and follows it.

A vehicle that can stop follows it with pure pursuit, one that steers by fins along Dubins legs with line of sight.
"""

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from math import atan2

from hil.autonomy.control.controller import VelocityCommand, heading_of
from hil.autonomy.paths.astar import check_ends, plan, smooth
from hil.autonomy.paths.curves import Chain, Position
from hil.autonomy.paths.dubins import Pose
from hil.autonomy.paths.line_of_sight import LineOfSight, approach_on
from hil.autonomy.paths.occupancy import OccupancyGrid, depths_near
from hil.autonomy.paths.pursuit import PurePursuit
from hil.common.errors import ConfigError, MissionError
from hil.master.planner import Done, Planner, PlanRequest, Point, Samples
from sim.sensors.samples import OdometrySample


class Follow(Planner):
    """Plan with A* on the map, obstacles widened by the vehicle's size and the margin; follow the smoothed path.

    It leads through the scenario's waypoints. Each leg is planned on a map of the depths that the vehicle has on it.
    """

    subscriptions = ()
    passes_waypoints = True

    def begin(self, request: PlanRequest) -> None:
        """Plan the path. Raises MissionError, ConfigError."""
        goal_of(request)
        self._request, master, limits, course = request, request.master, request.limits, request.course
        self._sights: list[LineOfSight] = []  # the pursuits of the legs of a vehicle that cannot stop
        self._pursuit: PurePursuit | LineOfSight
        if not limits.turn_radius:
            self.path = [place for leg in range(len(course) - 1) for place in self._way(leg)]
            self._pursuit = PurePursuit(self.path, master.lookahead, master.speed, tolerance=master.tolerance)
            return
        pose = Pose(course[0], request.start.heading)
        for leg, (start, goal) in enumerate(pairwise(course)):
            if start != goal or len(course) == 2:
                approach = partial(self._approach, leg)
                sight = LineOfSight(approach, pose, master.speed, limits, master.lookahead, master.tolerance)
                self._sights.append(sight)
                pose = sight.end
        self._pursuit, self._number = self._sights[0], 0
        self._show_approach()

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Steer along the path, at its depth."""
        odometry = samples["odom"]
        state = odometry.position, heading_of(odometry.orientation), course_of(odometry)
        try:
            command = self._pursuit.update(*state)
            while self._pursuit.has_arrived and self._pursuit in self._sights[:-1]:
                self._begin_leg(Pose(*state[:2]))
                command = self._pursuit.update(*state)
        except MissionError as error:  # the vehicle has missed a place, and no other approach is free
            return Done(str(error), reached=False)
        self.progress = self._pursuit.progress
        if self._sights:
            self.progress = (self._number + self.progress) / len(self._sights)
            self._show_approach()
        return Done("goal reached") if self._pursuit.has_arrived else command

    def _begin_leg(self, pose: Pose) -> None:
        """Follow the next leg; from `pose` on, if the vehicle has not come to it as planned."""
        is_planned = self._sights[self._number].approaches == 1
        self._number += 1
        self._pursuit = self._sights[self._number]
        if not is_planned:
            self._pursuit.begin(pose)

    def _way(self, leg: int) -> Sequence[Position]:
        """Return the path of a leg (m, NED) for a vehicle that can stop."""
        ends = self._request.course[leg : leg + 2]
        (*start, _), (*goal, _) = ends
        if start == goal:
            return ends
        grid = self._map_of(leg, ends)
        way = smooth(grid, plan(grid, ends[0][:2], ends[1][:2]))
        return [(*corner, float(depths_near(ends, *corner))) for corner in way]

    def _approach(self, leg: int, pose: Pose) -> Chain:
        """Return the path from `pose` to the end of a leg, for a vehicle that cannot stop."""
        goal = self._request.course[leg + 1]
        grid = self._map_of(leg, [pose.position, goal])

        def search(point: Point) -> list[Point]:
            return smooth(grid, plan(grid, point, goal[:2]))

        return approach_on(grid, search, pose, goal, self._request.limits)

    def _map_of(self, leg: int, ends: Sequence[Position]) -> OccupancyGrid:
        """Return the map of a leg with widened obstacles. Raises MissionError if one of its ends is not free."""
        request = self._request
        only = len(request.course) == 2 and ends[0] == request.course[0]
        grid = (request.map if only else request.map_along(ends)).inflate(request.clearance)
        names = ["start", *(f"waypoint[{number}]" for number in range(len(request.master.waypoint))), "goal"]
        check_ends(grid, ends[0][:2], ends[1][:2], names[leg : leg + 2])
        return grid

    def _show_approach(self) -> None:
        """Show the path of the present approaches of a vehicle that cannot stop."""
        status = f"approach {self._sights[self._number].approaches}"
        if len(self._sights) > 1:
            status = f"leg {self._number + 1} of {len(self._sights)}, {status}"
        if status != self.status:  # else the path is the same, and displays know it by its identity
            self.status, self.path = status, [place for sight in self._sights for place in sight.path]


def goal_of(request: PlanRequest) -> Point:
    """Return the scenario's goal (m north, m east). Raises ConfigError if it has none."""
    if request.master.goal is None:
        raise ConfigError("master: key 'goal' is missing: this planner goes to one")
    return request.master.goal


def course_of(odometry: OdometrySample) -> float:
    """Return the course over ground (rad) of a vehicle that moves, with little roll and pitch."""
    return heading_of(odometry.orientation) + atan2(odometry.nu[1], odometry.nu[0])

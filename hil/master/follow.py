"""The default planner: it plans a path on the map and follows it.

A vehicle that can stop follows it with pure pursuit, one that steers by fins along Dubins legs with line of sight.
"""

from math import atan2

from hil.autonomy.control.controller import VelocityCommand, heading_of
from hil.autonomy.paths.astar import check_ends, plan, smooth
from hil.autonomy.paths.dubins import Pose
from hil.autonomy.paths.line_of_sight import LineOfSight, approach_on
from hil.autonomy.paths.pursuit import PurePursuit
from hil.common.errors import ConfigError, MissionError
from hil.master.planner import Done, Planner, PlanRequest, Point, Samples
from sim.sensors.samples import OdometrySample


class Follow(Planner):
    """Plan with A* on the map, obstacles widened by the vehicle's size and the margin; follow the smoothed path."""

    subscriptions = ()

    def begin(self, request: PlanRequest) -> None:
        """Plan the path. Raises MissionError, ConfigError."""
        master, start = request.master, request.start
        inflated = request.map.inflate(request.clearance)
        goal = goal_of(request)

        def search(point: Point) -> list[Point]:
            return smooth(inflated, plan(inflated, point, goal))

        self._pursuit: PurePursuit | LineOfSight
        if not request.limits.turn_radius:
            self.path = search((start.north, start.east))
            self._pursuit = PurePursuit(
                self.path, master.lookahead, master.speed, tolerance=master.tolerance, depth=master.depth
            )
            return
        check_ends(inflated, (start.north, start.east), goal)
        approach = approach_on(inflated, search, goal, master.depth, request.limits)
        pose = Pose((start.north, start.east, start.depth), start.heading)
        self._pursuit = LineOfSight(approach, pose, master.speed, request.limits, master.lookahead, master.tolerance)
        self.path = self._pursuit.path

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Steer along the path, to the depth of the scenario."""
        odometry = samples["odom"]
        try:
            command = self._pursuit.update(odometry.position, heading_of(odometry.orientation), course_of(odometry))
        except MissionError as error:  # the vehicle has missed the goal, and no other approach is free
            return Done(str(error), reached=False)
        self.progress = self._pursuit.progress
        if isinstance(self._pursuit, LineOfSight):
            self.path, self.status = self._pursuit.path, f"approach {self._pursuit.approaches}"
        return Done("goal reached") if self._pursuit.has_arrived else command


def goal_of(request: PlanRequest) -> Point:
    """Return the scenario's goal (m north, m east). Raises ConfigError if it has none."""
    if request.master.goal is None:
        raise ConfigError("master: key 'goal' is missing: this planner goes to one")
    return request.master.goal


def course_of(odometry: OdometrySample) -> float:
    """Return the course over ground (rad) of a vehicle that moves, with little roll and pitch."""
    return heading_of(odometry.orientation) + atan2(odometry.nu[1], odometry.nu[0])

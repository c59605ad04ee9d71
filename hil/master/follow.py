"""The default planner: it plans a path on the map and follows it with pure pursuit."""

from hil.autonomy.control.controller import VelocityCommand, heading_of
from hil.autonomy.paths.astar import plan, smooth
from hil.autonomy.paths.pursuit import PurePursuit
from hil.common.errors import ConfigError
from hil.master.planner import Done, Planner, PlanRequest, Point, Samples


class Follow(Planner):
    """Plan with A* on the map, obstacles widened by the vehicle's size and the margin; follow the smoothed path."""

    subscriptions = ()

    def begin(self, request: PlanRequest) -> None:
        """Plan the path. Raises MissionError, ConfigError."""
        master = request.master
        inflated = request.map.inflate(request.clearance)
        start = request.start.north, request.start.east
        self.path = smooth(inflated, plan(inflated, start, goal_of(request)))
        self._depth = master.depth
        self._pursuit = PurePursuit(
            self.path, lookahead=master.lookahead, speed=master.speed, tolerance=master.tolerance
        )

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Steer towards a point ahead on the path, at the depth of the scenario."""
        odometry = samples["odom"]
        command = self._pursuit.update(odometry.position, heading_of(odometry.orientation))
        self.progress = self._pursuit.progress
        if self._pursuit.has_arrived:
            return Done("goal reached")
        return command._replace(depth=self._depth)


def goal_of(request: PlanRequest) -> Point:
    """Return the scenario's goal (m north, m east). Raises ConfigError if it has none."""
    if request.master.goal is None:
        raise ConfigError("master: key 'goal' is missing: this planner goes to one")
    return request.master.goal

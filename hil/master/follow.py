"""The default planner: a way on the map, and pure pursuit along it."""

from hil.autonomy.astar import plan, smooth
from hil.autonomy.control import VelocityCommand, heading_of
from hil.autonomy.pursuit import PurePursuit
from hil.errors import ConfigError
from hil.master.planner import Brief, Done, Planner, Point, Samples


class Follow(Planner):
    """A* on the map, obstacles widened by the vehicle's size and the margin, smoothed; pure pursuit to the goal."""

    listens = ()

    def begin(self, brief: Brief) -> None:
        """Plan the way. Raises MissionError, ConfigError."""
        master = brief.master
        inflated = brief.map.inflate(brief.clearance)
        start = brief.start.north, brief.start.east
        self.path = smooth(inflated, plan(inflated, start, goal_of(brief)))
        self._depth = master.depth
        self._pursuit = PurePursuit(
            self.path, lookahead=master.lookahead, speed=master.speed, tolerance=master.tolerance
        )

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Towards a point a little ahead on the way, at the depth of the scenario."""
        odometry = samples["odom"]
        command = self._pursuit.update(odometry.position, heading_of(odometry.orientation))
        self.progress = self._pursuit.progress
        if self._pursuit.done:
            return Done("goal reached")
        return command._replace(depth=self._depth)


def goal_of(brief: Brief) -> Point:
    """The scenario's goal. Raises ConfigError if it names none."""
    if brief.master.goal is None:
        raise ConfigError("master: key 'goal' is missing: this planner goes to one")
    return brief.master.goal

"""Do tasks in the scheduler's order, on paths that avoid obstacles.

    [planner]
    class = "hil.master.tasks:Tasks"
    home = [0.0, 0.0]

    [[planner.task]]
    name = "charging"
    at = [5.0, 5.0]
    duration = "20 s"

`hil.autonomy.tasks.scheduler` defines a task, `hil.master.avoid` the other keys of the section. A task may wait for
these signals, if the vehicle has the sensors: `battery` (share of its charge), `voltage`, `depth`, `altitude`, `leak`.
"""

from collections.abc import Mapping
from math import cos, dist, sin
from typing import Any

from hil.autonomy.control.controller import VelocityCommand, clamp, heading_of
from hil.autonomy.paths.line_of_sight import circle_around
from hil.autonomy.paths.occupancy import Point
from hil.autonomy.tasks.scheduler import Mission, Scheduler
from hil.common.errors import MissionError
from hil.common.schema import parse
from hil.master.avoid import AvoidSettings, Sight
from hil.master.follow import course_of
from hil.master.planner import Done, Planner, PlanRequest, Samples
from sim.sensors.samples import OdometrySample

_NS_PER_S = 1_000_000_000
SIGNALS = ("battery", "dvl", "leak")  # topics of the signals that tasks may wait for
_HOLD_GAIN = 0.4  # 1/s, gain of station keeping
_HOLD_LIMIT = 0.2  # m/s, its greatest speed


class Tasks(Planner):
    """Guide a vehicle through the tasks of a mission and home. `log` has each state with its time of entry (s).

    A vehicle that steers by fins works in circles around the place of the task.
    """

    hovers = "holds a place during a task"

    def __init__(self, vfh: dict[str, Any] | None = None, **keys: Any) -> None:
        mission = {key: keys.pop(key) for key in Mission._fields if key in keys}
        self._has_tolerance = "tolerance" in mission
        self._settings = parse(keys, AvoidSettings, "Tasks")
        self.mission = parse(mission, Mission, "Tasks")
        self._scheduler = Scheduler(self.mission, "Tasks")
        self.subscriptions = (self._settings.scan, *SIGNALS)
        self.destinations = (self.mission.home, *(task.at for task in self.mission.task))
        self._vfh = vfh or {}
        self._goal: Point | None = None

    @property
    def log(self) -> list[tuple[float, str]]:
        """Pairs of a time (s) and the state that was entered at it."""
        return [(time / _NS_PER_S, state) for time, state in self._scheduler.log]

    @property
    def finished(self) -> list[str]:
        """Names of the finished tasks, in the order of their completion."""
        return self._scheduler.finished

    def begin(self, request: PlanRequest) -> None:
        """Prepare the map. Raises ConfigError."""
        self._sight = Sight(self._settings, self._vfh, request)
        self._master, self._limits = request.master, request.limits
        if self._limits.turn_radius and not self._has_tolerance:
            self.mission = self.mission._replace(tolerance=request.master.tolerance)
            self._scheduler = Scheduler(self.mission, "Tasks")
        self._depth = request.master.depth

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Return the command to the place of the present task, or to hold station there during the work."""
        odometry = samples["odom"]
        point = odometry.position[0], odometry.position[1]
        task_goal = self._scheduler.step(round(time * _NS_PER_S), point, signals_of(samples))
        self.status = task_goal.state
        if self._scheduler.is_finished:
            return Done(f"home after {', '.join(self.finished)}")
        self.progress = len(self.finished) / (len(self.mission.task) + 1)
        if task_goal.goal is not None and task_goal.goal != self._goal:
            try:
                self._sight.begin(point, task_goal.goal, heading_of(odometry.orientation))
            except MissionError as error:
                return Done(f"{task_goal.state}: {error}", reached=False)
            self._goal = task_goal.goal
        guide = self._sight.guide
        if task_goal.goal is None or guide is None:
            return VelocityCommand(depth=self._depth)
        self.path = guide.path
        works = task_goal.state.endswith(" work")
        if guide.has_arrived and self._limits.turn_radius and not works:
            self._goal = None  # it passed the place, but not near enough: another approach follows
        if guide.has_arrived or works:
            return self._stay(task_goal.goal, odometry)._replace(depth=self._depth)
        return self._sight.command(samples)

    def _stay(self, place: Point, odometry: OdometrySample) -> VelocityCommand:
        """Return the command to hold station, or with fins to circle around the place."""
        if not self._limits.turn_radius:
            return hold_position(odometry.position[:2], heading_of(odometry.orientation), place)
        return circle_around(
            place, odometry.position, course_of(odometry), self._master.speed, self._limits, self._master.lookahead
        )


def hold_position(position: Point, heading: float, target: Point) -> VelocityCommand:
    """Return the velocity that holds a vehicle at a place (m north, m east). The vehicle must be able to sway."""
    away = max(dist(position, target), 1e-9)
    speed = clamp(_HOLD_GAIN * away, _HOLD_LIMIT) / away
    north, east = speed * (target[0] - position[0]), speed * (target[1] - position[1])
    c, s = cos(heading), sin(heading)
    return VelocityCommand(surge=c * north + s * east, sway=c * east - s * north)


def signals_of(samples: Samples) -> Mapping[str, float]:
    """Return the signals that tasks may wait for, of the sensors that the vehicle has."""
    signals: dict[str, float] = {"depth": samples["odom"].position[2]}
    battery, dvl, leak = samples.get("battery"), samples.get("dvl"), samples.get("leak")
    if battery:
        signals |= {"battery": battery.charge / battery.capacity, "voltage": battery.voltage}
    if dvl and dvl.locked:
        signals["altitude"] = dvl.altitude
    if leak:
        signals["leak"] = float(leak.on)
    return signals

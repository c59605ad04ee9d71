"""Tasks in the order of the scheduler, with the ways between them past what stands there.

    [planner]
    class = "hil.master.tasks:Tasks"
    home = [0.0, 0.0]

    [[planner.task]]
    name = "charging"
    at = [5.0, 5.0]
    duration = "20 s"

`hil.autonomy.scheduler` says what a task is, `hil.master.avoid` what else the section takes. The signals that a task
may wait for: `battery` (share of its charge), `voltage`, `depth`, `altitude`, `leak`, as the vehicle's sensors say.
"""

from collections.abc import Mapping
from math import cos, dist, sin
from typing import Any

from hil.autonomy.control import VelocityCommand, clamp, heading_of
from hil.autonomy.occupancy import Point
from hil.autonomy.scheduler import Mission, Scheduler
from hil.errors import MissionError
from hil.master.avoid import AvoidSettings, Sight
from hil.master.planner import Brief, Done, Planner, Samples
from hil.schema import parse

_NS_PER_S = 1_000_000_000
SIGNALS = ("battery", "dvl", "leak")  # topics that tell what tasks may wait for
_KEEP = 0.4  # 1/s, of station keeping
_KEEP_LIMIT = 0.2  # m/s


class Tasks(Planner):
    """Leads a vehicle through the tasks of a mission and home. `log` has each state entered and when (s)."""

    def __init__(self, vfh: dict[str, Any] | None = None, **keys: Any) -> None:
        mission = {key: keys.pop(key) for key in Mission._fields if key in keys}
        self._settings = parse(keys, AvoidSettings, "Tasks")
        self.mission = parse(mission, Mission, "Tasks")
        self._scheduler = Scheduler(self.mission, "Tasks")
        self.listens = (self._settings.scan, *SIGNALS)
        self._vfh = vfh or {}
        self._goal: Point | None = None

    @property
    def log(self) -> list[tuple[float, str]]:
        """When (s) each state was entered."""
        return [(time / _NS_PER_S, state) for time, state in self._scheduler.log]

    @property
    def finished(self) -> list[str]:
        """The tasks that are done, in their order."""
        return self._scheduler.finished

    def begin(self, brief: Brief) -> None:
        """Take the map. Raises ConfigError."""
        self._sight = Sight(self._settings, self._vfh, brief)
        self._depth = brief.master.depth

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """On the way to the place of the present task, or kept there while it is done."""
        odometry = samples["odom"]
        here = odometry.position[0], odometry.position[1]
        order = self._scheduler.step(round(time * _NS_PER_S), here, signals_of(samples))
        self.note = order.state
        if self._scheduler.done:
            return Done(f"home after {', '.join(self.finished)}")
        self.progress = len(self.finished) / (len(self.mission.task) + 1)
        if order.goal is not None and order.goal != self._goal:
            try:
                self._sight.go(here, order.goal)
            except MissionError as error:
                return Done(f"{order.state}: {error}", reached=False)
            self._goal = order.goal
        guide = self._sight.guide
        if order.goal is None or guide is None:
            return VelocityCommand(depth=self._depth)
        self.path = guide.path
        if guide.done or order.state.endswith(" work"):
            return keep(here, heading_of(odometry.orientation), order.goal)._replace(depth=self._depth)
        return self._sight.command(samples)


def keep(here: Point, heading: float, place: Point) -> VelocityCommand:
    """The velocity that keeps a vehicle which can move sideways at a place (m north, m east)."""
    away = max(dist(here, place), 1e-9)
    speed = clamp(_KEEP * away, _KEEP_LIMIT) / away
    north, east = speed * (place[0] - here[0]), speed * (place[1] - here[1])
    c, s = cos(heading), sin(heading)
    return VelocityCommand(surge=c * north + s * east, sway=c * east - s * north)


def signals_of(samples: Samples) -> Mapping[str, float]:
    """What tasks may wait for, of those sensors that the vehicle has."""
    found: dict[str, float] = {"depth": samples["odom"].position[2]}
    battery, dvl, leak = samples.get("battery"), samples.get("dvl"), samples.get("leak")
    if battery:
        found |= {"battery": battery.charge / battery.capacity, "voltage": battery.voltage}
    if dvl and dvl.locked:
        found["altitude"] = dvl.altitude
    if leak:
        found["leak"] = float(leak.on)
    return found

"""The interface of a planner: samples and time in, a command out.

The same planner runs in `uuv-hil sim` (software in the loop), in `uuv-hil master` over the network (hardware in the
loop), and with a real vehicle that takes `cmd_vel`. It gets samples and the time, and returns a command; it has no I/O
and no clock of its own. The scenario names its class and gives the keys that the class takes:

    [planner]
    class = "hil.master.avoid:Avoid"
    safety = "0.3 m"
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.curves import Position
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.autonomy.paths.trajectory import Limits
from hil.common.errors import ConfigError
from hil.common.schema import nearest
from hil.ros.topics import ALL, TOPICS
from hil.scenario.records import Master, Start
from sim.vehicle.vehicle import Vehicle

Point = tuple[float, float]  # north, east in m

# The newest sample of each topic (hil/ros/topics.py): records of sim/sensors in NED and FRD, without the ground truth.
Samples = Mapping[str, Any]


class ReceivedSamples(dict[str, Any]):
    """The samples received so far. A topic without a sample raises an explained KeyError; `get` returns None."""

    def __missing__(self, topic: str) -> Any:
        raise KeyError(
            f"no sample of {topic!r} yet: a sensor's first sample comes with its first period, and only from a "
            f"sensor that is fitted; use samples.get({topic!r}). There are: {', '.join(self)}"
        )


class Done(NamedTuple):
    """Result of a planner that ends: the reason, and whether it has `reached` its goal."""

    reason: str
    reached: bool = True


class PlanRequest(NamedTuple):
    """Input of a planner before the run: the vehicle, its start, the task, and the map.

    `node` is the vehicle's name. `master` is the scenario's section with goal, depth, speed and so on. `course` (m,
    NED) leads from the start through the scenario's waypoints to its goal. `map` shows the known obstacles in their
    true size, at the depth of the nearest place of the course; none if the scenario says `map = "unknown"`. Of a world
    of more than a million cells, it shows only the part around the course and the planner's destinations. If these are
    far apart, its cells are larger than the scenario's, and a cell is occupied if any part of it may be. `map_along`
    returns the map for another course. `clearance` (m) is the distance that the vehicle's centre must keep from
    obstacles: its own size plus the scenario's margin. `limits` are those of a vehicle that steers by fins
    (hil/master/guidance.py); for others their `turn_radius` is 0.
    """

    node: str
    vehicle: Vehicle
    start: Start
    master: Master
    map: OccupancyGrid
    clearance: float
    course: Sequence[Position]
    map_along: Callable[[Sequence[Position]], OccupancyGrid]
    limits: Limits = Limits()


class Planner(ABC):
    """Base class of planners. Your own planner has to define one method, `command`.

    It may set three attributes for display: `path`, the planned path (m north, m east, and perhaps depth); `progress`,
    the share of the path already covered (0 to 1); `status`, a few words on what it is doing. `subscriptions` are the
    sensor topics that it needs besides "odom"; only these are sent and given to it. `ALL` means all topics except
    images. `destinations` (m north, m east) are the places that it goes to besides the scenario's goal: the map of a
    large world shows only their surroundings. `hovers` says for what the planner lets a vehicle stop, which one that
    steers by fins cannot. `passes_waypoints` says that it follows the request's whole `course`.
    """

    subscriptions: Sequence[str] = (ALL,)
    destinations: Sequence[Point] = ()
    path: Sequence[Sequence[float]] = ()
    hovers: str = ""
    passes_waypoints: bool = False
    progress: float = 0.0
    status: str = ""

    @property
    def track(self) -> list[Point]:
        """Horizontal positions of `path`."""
        return [(north, east) for north, east, *_ in self.path]

    def begin(self, request: PlanRequest) -> None:  # noqa: B027 - there may be nothing to prepare
        """Prepare the run, for example plan a path. Raises MissionError if there is no path."""

    @abstractmethod
    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Return the command for the vehicle `time` s after the start, or `Done` to end the run.

        Called every `command_period` of the scenario, once there is odometry: `samples["odom"]` always exists. The
        planner's side holds the `depth` and `heading` of the command; only velocities are sent.
        """


def topics_of(planner: Planner) -> tuple[str, ...]:
    """Return the topics that this planner's mission must subscribe to. Raises ConfigError for an unknown topic."""
    name, subscriptions = type(planner).__name__, planner.subscriptions
    if isinstance(subscriptions, str):
        raise ConfigError(
            f"{name}: subscriptions = {subscriptions!r}: expected a tuple of topics, such as ({subscriptions!r},)"
        )
    for topic in subscriptions:
        if topic != ALL and topic not in TOPICS:
            raise ConfigError(f"{name}: subscriptions: no topic {topic!r}{nearest(topic, list(TOPICS))}")
    return ("odom", "ground_truth", *subscriptions)

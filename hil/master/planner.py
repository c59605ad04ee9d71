"""The interface of a planner: samples and time in, a command out.

The same object runs in `uuv-hil sim` (software in the loop), in `uuv-hil master` over the network (hardware in the
loop), and before a real vehicle that takes `cmd_vel`: it gets samples and the time, and returns a command. It has
no I/O and no clock of its own. The scenario names it, with the keys its class takes:

    [planner]
    class = "hil.master.avoid:Avoid"
    safety = "0.3 m"
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.common.errors import ConfigError
from hil.common.schema import nearest
from hil.ros.topics import ALL, TOPICS
from hil.scenario.records import Master, Start
from sim.vehicle.vehicle import Vehicle

Point = tuple[float, float]  # north, east in m

# The newest sample of each topic (hil/ros/topics.py), records of sim/sensors in NED and FRD. The truth is not among
# them.
Samples = Mapping[str, Any]


class ReceivedSamples(dict[str, Any]):
    """The samples received so far. A topic of which nothing came yet is a KeyError that names it; `get` gives None."""

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

    `master` is the scenario's section: goal, depth, speed and so on. `map` shows what is known of the world at that
    depth, obstacles in their true size: nothing if the scenario says `map = "unknown"`. Of a world of more than a
    million cells it shows the part around start, goal and the planner's places, where they are far apart in cells
    larger than the scenario's, each occupied where any part of it may be. `clearance` m is how far from
    them the vehicle's middle must stay, its own size and the margin of the scenario. `node` is the vehicle's name.
    """

    node: str
    vehicle: Vehicle
    start: Start
    master: Master
    map: OccupancyGrid
    clearance: float


class Planner(ABC):
    """A planner of your own derives from this and has one method to write, `command`.

    It may set three attributes for display: `path`, the planned path (m north, m east); `progress`, the share of it
    already covered (0 to 1); `status`, a few words on what it is doing. `subscriptions` are the topics of sensors that
    it needs besides "odom": only those are sent and given to it. `ALL` are all but pictures. `places` (m north, m east)
    are those that it goes to besides the scenario's goal: of a large world the map shows only what is around them.
    """

    subscriptions: Sequence[str] = (ALL,)
    places: Sequence[Point] = ()
    path: Sequence[Point] = ()
    progress: float = 0.0
    status: str = ""

    def begin(self, request: PlanRequest) -> None:  # noqa: B027 - there may be nothing to prepare
        """Prepare: plan a path. Raises MissionError if there is none."""

    @abstractmethod
    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Return what to ask of the vehicle `time` s after the start, or that it is over.

        Called every `command_period` of the scenario once there is odometry; `samples["odom"]` is always there.
        `depth` and `heading` in the command are held on the planner's side: only velocities travel.
        """


def topics_of(planner: Planner) -> tuple[str, ...]:
    """Return what has to be listened to for a mission with this planner. Raises ConfigError for what is no topic."""
    name, subscriptions = type(planner).__name__, planner.subscriptions
    if isinstance(subscriptions, str):
        raise ConfigError(
            f"{name}: subscriptions = {subscriptions!r}: expected a tuple of topics, such as ({subscriptions!r},)"
        )
    for topic in subscriptions:
        if topic != ALL and topic not in TOPICS:
            raise ConfigError(f"{name}: subscriptions: no topic {topic!r}{nearest(topic, list(TOPICS))}")
    return ("odom", "ground_truth", *subscriptions)

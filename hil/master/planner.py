"""What a planner is: whoever leads a vehicle, by what its sensors say.

The same object runs in `uuv-hil sim` (software in the loop), in `uuv-hil master` over the network (hardware in the
loop), and before a real vehicle that listens to `cmd_vel`: it is told samples and time, and tells a command. It has no
I/O and no clock of its own. The scenario names it, with the keys its class takes:

    [planner]
    class = "hil.master.avoid:Avoid"
    berth = "0.3 m"
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from hil.autonomy.control import VelocityCommand
from hil.autonomy.occupancy import OccupancyGrid
from hil.config import Master, Start
from hil.topics import ALL
from sim.vehicle import Vehicle

Point = tuple[float, float]  # north, east in m

# The newest sample of each topic (hil/topics.py), records of sim/sensors in NED and FRD. The truth is not among them.
Samples = Mapping[str, Any]


class Done(NamedTuple):
    """A planner's last word: why it is over, and whether it has `reached` what it was asked for."""

    reason: str
    reached: bool = True


class Brief(NamedTuple):
    """What a planner is told before the dive: the vehicle, where it starts, what is asked, and the map.

    `master` is the scenario's section: goal, depth, speed and so on. `map` shows what is known of the world at that
    depth, obstacles in their true size: nothing if the scenario says `map = "unknown"`. `clearance` m is how far from
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

    It may keep three figures up to date for others to show: `path`, the way it means to go (m north, m east);
    `progress`, the share of it that lies behind (0 to 1); `note`, a few words on what it is doing. `listens` are the
    topics of the sensors it looks at besides "odom": only those are sent and given to it. `ALL` are all but pictures.
    """

    listens: Sequence[str] = (ALL,)
    path: Sequence[Point] = ()
    progress: float = 0.0
    note: str = ""

    def begin(self, brief: Brief) -> None:  # noqa: B027 - there may be nothing to prepare
        """Prepare: plan a way. Raises MissionError if there is none."""

    @abstractmethod
    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """What to ask of the vehicle `time` s after the start, or that it is over.

        Called every `command_period` of the scenario once there is odometry; `samples["odom"]` is always there.
        `depth` and `heading` in the command are held on the planner's side: only velocities travel.
        """

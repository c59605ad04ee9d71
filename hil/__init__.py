"""The bridge: every byte between a single-board computer, a planner and the simulator.

Public: the names below, each imported on first use. Modules that are not named by a room's docstring may change. It
must not import more than its version, as each process of ours begins here.
"""

import os
import sys

from hil.common import __version__ as __version__
from hil.common.public import public_name

TYPE_CHECKING = False  # as typing has it, which a lean process does not load for this
if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec
    from typing import Any

    from hil.autonomy.control.controller import VelocityCommand as VelocityCommand
    from hil.autonomy.control.families import Controller as Controller
    from hil.autonomy.paths.dubins import Pose as Pose
    from hil.autonomy.paths.dubins import dubins as dubins
    from hil.autonomy.paths.occupancy import OccupancyGrid as OccupancyGrid
    from hil.autonomy.paths.spline import Spline as Spline
    from hil.autonomy.paths.trajectory import Limits as Limits
    from hil.autonomy.paths.trajectory import Trajectory as Trajectory
    from hil.client.action import Action as Action
    from hil.client.fleet import Fleet as Fleet
    from hil.client.vehicle_handle import Vehicle as Vehicle
    from hil.common.clock import now_ns as now_ns
    from hil.common.errors import ConfigError as ConfigError
    from hil.common.errors import DeviceError as DeviceError
    from hil.common.errors import HilError as HilError
    from hil.common.errors import MissingExtraError as MissingExtraError
    from hil.common.errors import MissionError as MissionError
    from hil.common.errors import NetworkError as NetworkError
    from hil.links.address import open_address as open_address
    from hil.links.contract import Protocol as Protocol
    from hil.links.contract import ThrusterCommand as ThrusterCommand
    from hil.links.contract import ThrusterLink as ThrusterLink
    from hil.links.contract import ThrusterTelemetry as ThrusterTelemetry
    from hil.links.contract import Wire as Wire
    from hil.links.protocols import open_protocol as open_protocol
    from hil.master.planner import Done as Done
    from hil.master.planner import Planner as Planner
    from hil.master.planner import PlanRequest as PlanRequest
    from hil.master.planner import Samples as Samples
    from hil.scenario.config import build_simulation as build_simulation
    from hil.scenario.config import load_scenario as load_scenario

# module -> its public names
PUBLIC = {
    "hil.autonomy.control.controller": ("VelocityCommand",),
    "hil.autonomy.control.families": ("Controller",),
    "hil.autonomy.paths.dubins": ("Pose", "dubins"),
    "hil.autonomy.paths.occupancy": ("OccupancyGrid",),
    "hil.autonomy.paths.spline": ("Spline",),
    "hil.autonomy.paths.trajectory": ("Limits", "Trajectory"),
    "hil.client.action": ("Action",),
    "hil.client.fleet": ("Fleet",),
    "hil.client.vehicle_handle": ("Vehicle",),
    "hil.common.clock": ("now_ns",),
    "hil.common.errors": (
        "ConfigError", "DeviceError", "HilError", "MissingExtraError", "MissionError", "NetworkError",
    ),
    "hil.links.address": ("open_address",),
    "hil.links.contract": ("Protocol", "ThrusterCommand", "ThrusterLink", "ThrusterTelemetry", "Wire"),
    "hil.links.protocols": ("open_protocol",),
    "hil.master.planner": ("Done", "PlanRequest", "Planner", "Samples"),
    "hil.scenario.config": ("build_simulation", "load_scenario"),
}  # fmt: skip


def connect(
    *endpoints: str,
    take_over: bool = False,
    observe: bool = False,
    routed: bool = False,
    keys: str = "",
    wait: float = 5.0,
) -> "Fleet":
    """Return the vehicles at `endpoints`, as objects that give samples and take commands; see docs/how-to/python.md.

    An endpoint is that of a slave, "tcp/192.168.3.116:7447" or "tls/...", or "lan": all that answer by multicast.
    With `routed` it is that of a router, and all vehicles behind it are reached. With `take_over` a vehicle is
    commanded even if another master commands it; with `observe` it is never commanded. `keys` is this machine's folder
    of certificates (`uuv-hil keys add`). The first use of a vehicle waits for it, up to `wait` s. Raises NetworkError.
    """
    from hil.client.fleet import connect as connect_fleet

    return connect_fleet(*endpoints, take_over=take_over, observe=observe, routed=routed, keys=keys, wait=wait)


def __getattr__(name: str) -> "Any":
    return public_name(__name__, PUBLIC, name)


def __dir__() -> list[str]:
    return sorted([*globals(), *[name for names in PUBLIC.values() for name in names]])


class _OwnPackages:
    """Import hook that finds our other packages beside this one, even if the user's folder has one of that name.

    "sim" and "boards" are usual names, and Python searches a script's folder first. Raises ImportError, with the folder
    to rename, if the other one was imported before.
    """

    NAMES = ("boards", "firmware_stub", "sim")
    FOLDER = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

    @classmethod
    def find_spec(cls, name: str, path: "Any" = None, target: "Any" = None) -> "ModuleSpec | None":
        """Return where a module of ours is; None for a module of others. The arguments are those of any such hook."""
        package = name.partition(".")[0]
        if package not in cls.NAMES:
            return None
        if path is None:
            from importlib.machinery import PathFinder

            return PathFinder.find_spec(name, [cls.FOLDER], target)
        if not any(folder.startswith(os.path.join(cls.FOLDER, package)) for folder in path):
            raise ImportError(f"{next(iter(path))} hides the package {package!r} of uuv-hil; rename that folder")
        return None


sys.meta_path.insert(0, _OwnPackages)

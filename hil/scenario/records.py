"""Records of the sections of a scenario file: link, slave, start, master, recording, ros.

`hil.scenario.config.load_scenario` reads a file into them. The records of fleets and modems, in
`hil.scenario.fleet_records` and `hil.scenario.modem_records`, are not loaded by most runs.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from hil.common.endpoint import validate_endpoint
from hil.common.schema import Range, shortened
from hil.links.address import incompatibility
from hil.ros import dialect
from sim.environment.obstacles import ZoneKind
from sim.run_events import DEPTH_MARGIN_M, EventKind

if TYPE_CHECKING:  # imported at run time only for a scenario with faults
    from hil.links.wires.faults import Faults

VECTOR_M = tuple[Annotated[float, Range(-1e5, 1e5, "m")], Annotated[float, Range(-1e5, 1e5, "m")]]


class Link(NamedTuple):
    """Thruster link between the vehicle's computer and its STM32.

    `port` is its address in the form of hil/links/address.py: "pty:" makes a pseudo terminal, "pty:/tmp/name" one with
    a name for other programs; a real STM32 is at "/dev/ttyUSB0" or similar, by default the board's UART. `baud` (bit/s)
    is for a serial device, `bitrate` (bit/s) for a CAN bus whose speed the system does not set. `frame` is the name or
    file of the layout if the `protocol` is "frame"; the others are "mavlink", "dronecan", "vesc", one that another
    package adds, or "module:function" (`hil.links.protocols`), and `options` are their settings. `watchdog` is the
    STM32's timeout. `faults` are injected into the link.
    """

    port: str = "pty:"
    protocol: str = "frame"
    frame: str = "uuv_hil"
    baud: Annotated[int, Range(1200, 12_000_000, "bit/s")] = 115_200
    bitrate: Annotated[int, Range(10_000, 1_000_000, "bit/s")] = 1_000_000
    watchdog: Annotated[float, Range(0.02, 10.0, "s")] = 0.2
    options: Mapping[str, Any] = MappingProxyType({})  # these two are read by load_scenario
    faults: "Faults | None" = None

    def validate(self) -> str | None:
        """Return why the address is invalid or cannot carry the protocol; None if it can."""
        return incompatibility(self.protocol, self.port)


class Slave(NamedTuple):
    """Daemon on the single-board computer.

    `step` is the integration step, `control_period` the period of the controller. Without a new command for `deadman`
    the thrusters go to neutral. A command older than `command_age_limit` is dropped. With `realtime` the loop has
    priority over other programs; with `stay_awake` idle processors do not enter deep sleep states. With `instruments`
    it starts the process of those that the sensors name (hil/scenario/instrument_records.py), else run `uuv-hil
    instruments`.
    """

    node: str = "uuv1"
    listen: str = "tcp/127.0.0.1:7447"
    step: Annotated[float, Range(0.0002, 0.02, "s")] = 0.0025
    control_period: Annotated[float, Range(0.001, 0.2, "s")] = 0.02
    deadman: Annotated[float, Range(0.05, 10.0, "s")] = 0.5
    command_age_limit: Annotated[float, Range(0.01, 10.0, "s")] = 0.5
    realtime: bool = True
    stay_awake: bool = True
    instruments: bool = True

    def validate(self) -> str | None:
        """Return why the name, a part of network keys, or the endpoint is invalid; None if both are valid."""
        if not (self.node.replace("_", "").isalnum() and self.node.isascii() and not self.node[0].isdigit()):
            return f"node: {self.node!r} must be letters, digits and _, not starting with a digit"
        return validate_endpoint("listen", self.listen)


class Start(NamedTuple):
    """Start pose of the vehicle, NED."""

    north: Annotated[float, Range(-1e5, 1e5, "m")] = 0.0
    east: Annotated[float, Range(-1e5, 1e5, "m")] = 0.0
    depth: Annotated[float, Range(0.0, 11_000.0, "m")] = 5.0
    heading: Annotated[float, Range(-6.3, 6.3, "rad")] = 0.0


class Waypoint(NamedTuple):
    """A place that the vehicle passes on its way, NED; without a `depth` at that of [master]."""

    north: Annotated[float, Range(-1e5, 1e5, "m")]
    east: Annotated[float, Range(-1e5, 1e5, "m")]
    depth: Annotated[float, Range(0.0, 11_000.0, "m")] | None = None


class Master(NamedTuple):
    """Task of the planner: go to `goal` (north, east) at `depth`, with `speed`.

    Each [[master.waypoint]] is passed on the way, in their order. From one to the next, the depth changes linearly.
    `map` is the map at the start: "known" is the world without its hidden obstacles, "unknown" an empty map,
    "NAME.yaml" a map of map_server. Its cells have size `resolution`. Obstacles are enlarged by half the vehicle's
    horizontal diagonal plus `margin`. The seabed counts as an obstacle if it leaves less than `seabed_margin` below the
    vehicle. A known map shows the world's zones of the kinds in `avoid_zones` as obstacles. `lookahead` and `tolerance`
    are those of path following. For a vehicle that steers by fins, `speed`, `lookahead`, `tolerance` and `margin` are
    derived from its turning circle where they are left out (hil/master/guidance.py). A command is sent every
    `command_period`. The run fails if the planner is not done within `time_limit`, and for each event of
    sim/run_events.py that is not in `allow`; the event "too deep" means more than `depth_margin` below the deepest
    commanded depth.
    """

    goal: VECTOR_M | None = None
    waypoint: tuple[Waypoint, ...] = ()
    depth: Annotated[float, Range(0.0, 11_000.0, "m")] = 5.0
    speed: Annotated[float, Range(0.05, 5.0, "m/s")] = 0.5
    lookahead: Annotated[float, Range(0.2, 50.0, "m")] = 1.5
    tolerance: Annotated[float, Range(0.05, 10.0, "m")] = 0.5
    resolution: Annotated[float, Range(0.02, 10.0, "m")] = 0.25
    margin: Annotated[float, Range(0.0, 20.0, "m")] = 0.6
    seabed_margin: Annotated[float, Range(0.0, 100.0, "m")] = 0.3
    map: str = "known"
    command_period: Annotated[float, Range(0.01, 1.0, "s")] = 0.05
    time_limit: Annotated[float, Range(1.0, 86_400.0, "s")] = 300.0
    depth_margin: Annotated[float, Range(0.0, 1000.0, "m")] = DEPTH_MARGIN_M
    allow: tuple[EventKind, ...] = ()
    avoid_zones: tuple[ZoneKind, ...] = ()

    def validate(self) -> str | None:
        """Return why the map is invalid, or what is missing; None if all is valid."""
        if self.waypoint and not self.goal:
            return "goal: is missing: the waypoints lead to it: make the last of them the goal"
        known = self.map in ("known", "unknown") or self.map.endswith(".yaml")
        return None if known else f'map: {self.map!r} is neither "known", "unknown" nor a file that ends in .yaml'

    def places(self) -> list[tuple[float, float, float]]:
        """Return the waypoints and the goal (m, NED)."""
        points = [*self.waypoint, *([Waypoint(*self.goal)] if self.goal else [])]
        return [(place[0], place[1], self.depth if place[2] is None else place[2]) for place in points]


class Recording(NamedTuple):
    """Recording of a run, and its limits on the disk.

    `slave` and `master` select who records: the slave into `folder`, with the inputs that make its run repeatable to
    the bit (`uuv-hil recording replay --check`), the master into the folder of the run. A new file begins at
    `file_size`. Beyond `total_size` the oldest files of the recording are removed; without the first one the run cannot
    be repeated. Recording ends if less than `keep_free` is left on the disk.
    """

    slave: bool = False
    master: bool = False
    folder: str = "recordings"
    file_size: Annotated[float, Range(1.0, 1e6, "MiB")] = 256.0
    total_size: Annotated[float, Range(2.0, 1e7, "MiB")] = 4096.0
    keep_free: Annotated[float, Range(0.0, 1e7, "MiB")] = 256.0
    compression: Literal["zstd", "lz4", "none"] = "zstd"

    def validate(self) -> str | None:
        """Return why the sizes contradict each other, or None."""
        if self.total_size < 2.0 * self.file_size:
            return "total_size must be at least twice file_size: the file that is being written, and one more"
        return None


class Ros(NamedTuple):
    """Interface to ROS 2 beyond the sensors: transforms, clock, services, image format.

    `transforms`: publish /tf, for every odometry sample, and /tf_static, for the sensors' positions. `clock`, `wrench`
    and `joints` are the rates of /clock, of the thrusters' wrench, and of joint_states and motors; 0: off. `services`:
    arm, reset, set_pose, failures of thrusters. `frame_prefix` ("uuv1/") separates the frames of vehicles that share
    one /tf; only one of several vehicles should have a `clock`. `images` is the format of camera pictures,
    `jpeg_quality` (of libjpeg, 1 to 95) the quality of JPEG. `domain` is the ROS domain; by default (-1) it is the
    variable ROS_DOMAIN_ID, or 0. `distro` is the ROS release; an
    unknown later one acts as rolling.
    """

    transforms: bool = True
    services: bool = True
    frame_prefix: str = ""
    clock: Annotated[float, Range(0.0, 1000.0, "Hz")] = 20.0
    wrench: Annotated[float, Range(0.0, 1000.0, "Hz")] = 0.0
    joints: Annotated[float, Range(0.0, 1000.0, "Hz")] = 10.0
    images: Literal["jpeg", "raw", "both"] = "jpeg"
    jpeg_quality: Annotated[int, Range(1, 95)] = 80
    domain: Annotated[int, Range(dialect.FROM_ENVIRONMENT, dialect.MAX_DOMAIN)] = dialect.FROM_ENVIRONMENT
    distro: str = "jazzy"

    def validate(self) -> str | None:
        """Return that the release is unknown, or None."""
        if self.distro in dialect.RELEASES or dialect.is_newer(self.distro):
            return None
        return f"distro: {shortened(self.distro)} is none of {', '.join(dialect.RELEASES)}, nor a later release"

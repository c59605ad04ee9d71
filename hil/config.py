"""The scenario file: what is flown, where, over which link, by whom."""

import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from hil.clock import seconds_ns
from hil.errors import ConfigError
from hil.links.address import misfit
from hil.schema import Range, find_preset, parse, preset_names
from hil.tables import read_table
from hil.transport.settings import Network
from sim.sensors.suite import Suite, read_suite
from sim.simulation import Simulation
from sim.vehicle import Vehicle
from sim.world import World

if TYPE_CHECKING:
    from hil.fleet import Hunting, Member
    from hil.links.wires.faults import Faults
    from hil.modem import Modem
    from hil.transport.security import Security
    from sim.ballast import Release
    from sim.failures import Failure
    from sim.forces import Force

SCENARIOS = "hil/scenarios"
# Sections that most runs do without -> what reads them: a record, a class that theirs follow, or a function.
LAZY = {
    "failure": "sim.failures:Failure",
    "force": "sim.forces:Force",
    "release": "sim.ballast:Release",
    "member": "hil.fleet:read_members",
    "hunting": "hil.fleet:Hunting",
    "modem": "hil.modem:read_modem",
    "security": "hil.transport.security:Security",
    "link.faults": "hil.links.wires.faults:Faults",
}
MANY = ("failure", "force", "release", "member")  # each of them a [[table]]
FEEDBACK = ("imu", "odometry", "pressure")  # what the builtin controller lives on
VECTOR_M = tuple[Annotated[float, Range(-1e5, 1e5, "m")], Annotated[float, Range(-1e5, 1e5, "m")]]


class Link(NamedTuple):
    """The thruster link between the vehicle's computer and its STM32.

    `port` is where it is, as hil/links/address.py writes it: "pty:" makes a pseudo terminal, "pty:/tmp/name" one
    that other programs find there; a real STM32 is on "/dev/ttyUSB0" or the like, by default the board's UART.
    `baud` (bit/s) is that of a serial device, `bitrate` (bit/s) that of a CAN bus where the system does not set
    it. `frame` names the layout if the protocol is "frame", `options` are the settings of any other. `watchdog`
    is the STM32's. `faults` are done to what crosses, on purpose.
    """

    port: str = "pty:"
    protocol: Literal["frame", "mavlink", "dronecan", "vesc"] = "frame"
    frame: str = "uuv_hil"
    baud: Annotated[int, Range(1200, 12_000_000)] = 115_200
    bitrate: Annotated[int, Range(10_000, 1_000_000)] = 1_000_000
    watchdog: Annotated[float, Range(0.02, 10.0, "s")] = 0.2
    options: Mapping[str, Any] = MappingProxyType({})  # these two are read by load_scenario
    faults: "Faults | None" = None

    def problem(self) -> str | None:
        """An address that is none, or that carries something else than the protocol."""
        return misfit(self.protocol, self.port)


class Slave(NamedTuple):
    """The daemon on the card computer.

    `step` is the integration step; `control_period` the controller's. Without a new command for
    `deadman` the thrusters go to neutral. A command older than `command_age_limit` is dropped. With `realtime` the
    loop goes before other programs, and with `stay_awake` too idle processors do not sleep deeply.
    """

    node: str = "uuv1"
    listen: str = "tcp/127.0.0.1:7447"
    step: Annotated[float, Range(0.0002, 0.02, "s")] = 0.0025
    control_period: Annotated[float, Range(0.001, 0.2, "s")] = 0.02
    deadman: Annotated[float, Range(0.05, 10.0, "s")] = 0.5
    command_age_limit: Annotated[float, Range(0.01, 10.0, "s")] = 0.5
    realtime: bool = True
    stay_awake: bool = True

    def problem(self) -> str | None:
        """Names are parts of network keys."""
        ok = self.node.replace("_", "").isalnum() and self.node.isascii() and not self.node[0].isdigit()
        return None if ok else f"node: {self.node!r} must be letters, digits and _, not starting with a digit"


class Start(NamedTuple):
    """Where the vehicle is at the beginning, NED."""

    north: Annotated[float, Range(-1e5, 1e5, "m")] = 0.0
    east: Annotated[float, Range(-1e5, 1e5, "m")] = 0.0
    depth: Annotated[float, Range(0.0, 11_000.0, "m")] = 5.0
    heading: Annotated[float, Range(-6.3, 6.3, "rad")] = 0.0


class Master(NamedTuple):
    """What is asked of the planner: to `goal` (north, east) at `depth`, at `speed`.

    `map` is what it knows before: "known" the world but for what is hidden in it, "unknown" nothing, "NAME.yaml" a map
    of map_server's. It has cells of `resolution`; obstacles are inflated by half the vehicle's horizontal diagonal
    plus `margin`, and the seabed is one where it leaves less than `seabed_margin` under the vehicle. `lookahead` and
    `tolerance` are those of the path. The run fails when the planner is not done within `time_limit`.
    """

    goal: VECTOR_M | None = None
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

    def problem(self) -> str | None:
        """A map that is none."""
        known = self.map in ("known", "unknown") or self.map.endswith(".yaml")
        return None if known else f'map: {self.map!r} is neither "known", "unknown" nor a file that ends in .yaml'


class Recording(NamedTuple):
    """What is recorded of a run, and how much of the disk it may take.

    `slave` and `master` say who records: the slave into `folder`, also what makes its run repeatable to the bit
    (`uuv-hil replay --check`), the master into the folder of the run. A file ends at `file_size`; beyond `total_size`
    the oldest files of the recording go, and with the first one the possibility to repeat it. Recording ends when
    less than `keep_free` is left on the disk.
    """

    slave: bool = False
    master: bool = False
    folder: str = "recordings"
    file_size: Annotated[float, Range(1.0, 1e6, "MiB")] = 256.0
    total_size: Annotated[float, Range(2.0, 1e7, "MiB")] = 4096.0
    keep_free: Annotated[float, Range(0.0, 1e7, "MiB")] = 256.0
    compression: Literal["zstd", "lz4", "none"] = "zstd"

    def problem(self) -> str | None:
        """Sizes that do not go together."""
        if self.total_size < 2.0 * self.file_size:
            return "total_size must be at least twice file_size: the file that is being written, and one more"
        return None


class Ros(NamedTuple):
    """What the vehicle says to ROS 2 beyond its sensors, and lets it ask for.

    `transforms`: /tf, of every odometry sample, and /tf_static, of the sensors' places. `clock` and `wrench` are the
    rates of /clock and of the thrusters' wrench, 0 for none. `services`: arm, reset, set_pose, failures of thrusters.
    `frame_prefix` ("uuv1/") tells the frames of vehicles apart that share one /tf; of several only one has a `clock`.
    `images` says how a camera's pictures travel, `jpeg_quality` (of libjpeg, 1 to 95) how well as JPEG.
    """

    transforms: bool = True
    services: bool = True
    frame_prefix: str = ""
    clock: Annotated[float, Range(0.0, 1000.0, "Hz")] = 20.0
    wrench: Annotated[float, Range(0.0, 1000.0, "Hz")] = 0.0
    images: Literal["jpeg", "raw", "both"] = "jpeg"
    jpeg_quality: Annotated[int, Range(1, 95)] = 80


class Scenario(NamedTuple):
    """One run. `stm32` says who plays the STM32, `controller` who sends it commands.

    stm32: "python" the firmware's twin inside the slave, on its own frame the firmware in C where that was compiled;
    "process" the twin in a process of its own; "native" the firmware in C in one; "unicorn" (inside the slave) and
    "qemu" its image on an emulated processor; "device" a real one. controller: "builtin", or "external": the link's
    host end is left to the user's own vehicle software. Each [[failure]] is one of a thruster, at its time; each
    [[force]] a class of the user's own (sim/forces.py); each [[release]] drops a weight of the vehicle's, at its time
    (sim/ballast.py); each [[member]] is one vehicle of a fleet, [hunting] what the fleet is to do (hil/fleet.py),
    [modem] how it talks (hil/modem.py).
    """

    vehicle: str
    world: str
    master: Master
    description: str = ""
    seed: Annotated[int, Range(0, 2**63 - 1)] = 1
    stm32: Literal["python", "process", "native", "unicorn", "qemu", "device"] = "python"
    controller: Literal["builtin", "external"] = "builtin"
    slave: Slave = Slave()
    link: Link = Link()
    start: Start = Start()
    network: Network = Network()
    ros: Ros = Ros()
    recording: Recording = Recording()
    # These are read by load_scenario, which knows their schemas.
    security: "Security | None" = None
    planner: Mapping[str, Any] = MappingProxyType({})  # class and its keys (hil/master/planner.py); {} the default
    sensors: Suite = MappingProxyType({})
    failure: "tuple[Failure, ...]" = ()
    force: "tuple[Force, ...]" = ()
    release: "tuple[Release, ...]" = ()
    member: "tuple[Member, ...]" = ()
    hunting: "Hunting | None" = None
    modem: "Modem | None" = None
    path: str = ""  # the file it was read from

    def problem(self) -> str | None:
        """The words that do not go together."""
        if self.controller == "external" and self.stm32 not in ("python", "unicorn"):
            return (
                f'controller = "external" needs stm32 = "python" or "unicorn": {self.stm32!r} would hide the thrusters'
            )
        unspoken = self._unspoken()
        if unspoken:
            return f"stm32 = {self.stm32!r} does not speak [link] {unspoken}"
        if self.slave.deadman < 2 * self.slave.control_period:
            return "slave: deadman must be at least twice control_period"
        if self.link.watchdog < 2 * self.slave.control_period:
            return "link: watchdog must be at least twice [slave] control_period"
        return None

    def _unspoken(self) -> str:
        """What of the link the firmware in C has not learnt."""
        link = self.link
        if self.stm32 not in ("native", "unicorn", "qemu"):
            return ""
        if link.protocol == "frame":
            return "" if link.frame == "uuv_hil" else f"frame = {link.frame!r}"
        if link.protocol == "mavlink" or (link.protocol == "vesc" and self.stm32 == "unicorn"):
            return "options" if link.options else ""
        return f"protocol = {link.protocol!r}"


def load_scenario(name: str, changes: dict[str, Any] | None = None) -> Scenario:
    """The scenario at a path ending in `.toml`, or one of the installed ones by its name.

    Paths in it (vehicle, world) are relative to the file. `changes` replace values before they are checked:
    {"master.speed": 0.5}. Raises ConfigError.
    """
    try:
        path = find_preset(SCENARIOS, name)
    except ConfigError as error:
        if os.path.sep in name or os.path.exists(name):
            raise ConfigError(f"{name}: a scenario is a file that ends in .toml, or one of: {_names()}") from None
        raise ConfigError(f"no scenario {name!r}; give a .toml file or one of: {_names()}") from error
    table = read_table(path)
    for key, value in (changes or {}).items():
        _change(table, key, value, path)
    if "path" in table:
        raise ConfigError(f"{path}: no key 'path'")
    sensors = table.pop("sensors", {})
    planner = _planner(table.pop("planner", {}), f"{path}: planner")
    link = table["link"] = _section(table, "link", path)
    options = _section(link, "link.options", path)
    link.pop("options", None)
    lazy = {name: _read(name, table.pop(name), path) for name in LAZY if name in table}
    faults = _read("link.faults", link.pop("faults"), path) if "faults" in link else None
    scenario = parse(table, Scenario, path)
    folder = os.path.dirname(path)
    scenario = scenario._replace(
        path=path,
        vehicle=_relative(scenario.vehicle, folder),
        world=_relative(scenario.world, folder),
        master=scenario.master._replace(map=_relative(scenario.master.map, folder, ".yaml")),
        planner=planner,
        sensors=read_suite(sensors, f"{path}: sensors"),
        link=scenario.link._replace(options=options, faults=faults),
        **lazy,
    )
    if scenario.security:
        scenario = scenario._replace(security=scenario.security.beside(folder))
    if any("class" in section for section in sensors.values()):
        from hil.transport.ros_own import announce  # most vehicles have no sensor of a user's own

        announce(scenario.sensors, f"{path}: sensors")
    blind = [name for name in FEEDBACK if name not in scenario.sensors]
    if blind and scenario.controller == "builtin":
        raise ConfigError(f"{path}: sensors: the builtin controller needs {blind[0]}: its rate must be above 0")
    return scenario


def with_port(scenario: Scenario, port: str) -> Scenario:
    """`scenario` with its thruster link at that address. Raises ConfigError."""
    changed = scenario._replace(link=scenario.link._replace(port=port))
    problem = changed.link.problem()
    if problem:
        raise ConfigError(f"--port: {problem}")
    return changed


def _section(table: dict[str, Any], name: str, path: str) -> dict[str, Any]:
    """A copy of the section of that full name, empty if `table` has none."""
    section = table.get(name.rpartition(".")[2], {})
    if not isinstance(section, dict):
        raise ConfigError(f"{path}: {name}: expected a table: write its keys under [{name}], found {section!r}")
    return dict(section)


def _planner(table: Any, where: str) -> dict[str, Any]:
    if not isinstance(table, dict) or ("class" not in table and table):
        raise ConfigError(f'{where}: expected a table with class = "module:Class" and the keys of that class')
    return table


def _read(section: str, value: Any, path: str) -> Any:
    """A section of LAZY. Its module is loaded now, and a start without it is sooner."""
    where = f"{path}: {section}"
    if section in MANY:
        if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
            raise ConfigError(f"{where}: expected tables, each under [[{section}]]")
    elif not isinstance(value, dict):
        raise ConfigError(f"{where}: expected a table")
    from importlib import import_module

    module, _, name = LAZY[section].partition(":")
    reader = getattr(import_module(module), name)
    if not isinstance(reader, type):
        return reader(value, where)
    if section == "force":
        from hil.plugins import load_class

        return tuple([load_class(row, reader, f"{where}[{i}]") for i, row in enumerate(value)])
    if section in MANY:
        return tuple([parse(row, reader, f"{where}[{i}]") for i, row in enumerate(value)])
    return parse(value, reader, where)


def _change(table: dict[str, Any], key: str, value: Any, path: str) -> None:
    *sections, last = key.split(".")
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"{path}: {key}: {section!r} is a value, not a table")
    table[last] = value


def build_simulation(scenario: Scenario, vehicle: Vehicle, world: World) -> Simulation:
    """The simulation a scenario describes, at time 0. Raises ConfigError."""
    start = scenario.start
    return Simulation(
        vehicle,
        world,
        scenario.sensors,
        scenario.seed,
        seconds_ns(scenario.slave.step),
        (start.north, start.east, start.depth),
        start.heading,
        failures=scenario.failure,
        forces=scenario.force,
        releases=scenario.release,
    )


def _names() -> str:
    return ", ".join(preset_names(SCENARIOS))


def _relative(name: str, folder: str, ending: str = ".toml") -> str:
    return os.path.join(folder, name) if name.endswith(ending) else name

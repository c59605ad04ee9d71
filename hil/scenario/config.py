"""Load the scenario file and build its simulation."""

import os
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from hil.common.clock import seconds_ns
from hil.common.endpoint import no_certificates
from hil.common.errors import ConfigError
from hil.common.schema import (
    Range,
    Reader,
    check_rows,
    check_table,
    convert,
    find_preset,
    parse,
    preset_names,
    read_each,
    reader_of,
    shortened,
)
from hil.common.tables import read_table
from hil.network.settings import Network
from hil.ros import dialect
from hil.scenario.records import Link, Master, Recording, Ros, Slave, Start
from sim.environment.world import World
from sim.sensors.sensor_set import SensorSet, read_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from hil.network.security import Security
    from hil.scenario.autopilot_records import AutopilotSettings
    from hil.scenario.fleet_records import Hunting, Member
    from hil.scenario.mavlink_records import Mavlink
    from hil.scenario.modem_records import Modem
    from sim.forces import Force
    from sim.tether import TetherKeys
    from sim.vehicle.ballast import Release
    from sim.vehicle.failures import Failure

SCENARIOS = "hil/scenario/presets"
FOLDERS = {"vehicle": "sim/vehicles", "world": "sim/worlds", "link.frame": "firmware_stub/frames"}
# Sections that most runs do not have -> what reads them.
READERS = {
    "autopilot": reader_of("hil.scenario.autopilot_records:AutopilotSettings"),
    "failure": reader_of("sim.vehicle.failures:Failure", many=True),
    "force": reader_of("hil.scenario.config:read_forces"),
    "release": reader_of("sim.vehicle.ballast:Release", many=True),
    "tether": reader_of("sim.tether:TetherKeys"),
    "member": reader_of("hil.scenario.fleet_records:read_members"),
    "hunting": reader_of("hil.scenario.fleet_records:Hunting"),
    "modem": reader_of("hil.scenario.modem_records:read_modem"),
    "mavlink": reader_of("hil.scenario.mavlink_records:Mavlink"),
    "security": reader_of("hil.network.security:Security"),
}
AUTOPILOTS = ("ardupilot", "px4")  # controllers that are external programs or boards
HIDDEN = ("path", "derived", "changes")  # fields of a Scenario that are no keys of its file
DERIVED = ("speed", "lookahead", "tolerance", "margin")  # keys of [master] whose defaults a vehicle with fins derives
FEEDBACK = ("imu", "odometry", "pressure")  # sensors that the builtin controller needs


class Scenario(NamedTuple):
    """One run. `stm32` selects what acts as the STM32, `controller` what sends it commands.

    stm32: "python": the firmware in Python inside the slave, or for its own frame the firmware in C, if compiled;
    "process": the firmware in Python in its own process; "native": the firmware in C in its own process; "unicorn":
    its binary image on an emulated processor inside the slave; "device": a real STM32.

    controller: "builtin"; "external": the link's host end is left to the user's own vehicle software; "ardupilot" or
    "px4": a flight controller, with the settings of [autopilot] (hil/scenario/autopilot_records.py).

    Each [[failure]] is a thruster failure at a given time. Each [[force]] is a class of the user's own (sim/forces.py).
    Each [[release]] drops a weight of the vehicle at a given time (sim/vehicle/ballast.py). [tether] ties the vehicle
    (sim/tether.py). Each [[member]] is one vehicle of a fleet, [hunting] the fleet's task
    (hil/scenario/fleet_records.py). [modem] has the modems through which the fleet's vehicles report to each other
    (hil/scenario/modem_records.py). [mavlink] is the MAVLink interface for ground stations
    (hil/scenario/mavlink_records.py).
    """

    vehicle: str
    world: str
    master: Master
    description: str = ""
    seed: Annotated[int, Range(0, 2**63 - 1)] = 1
    stm32: Literal["python", "process", "native", "unicorn", "device"] = "python"
    controller: Literal["builtin", "external", "ardupilot", "px4"] = "builtin"
    slave: Slave = Slave()
    link: Link = Link()
    start: Start = Start()
    network: Network = Network()
    ros: Ros = Ros()
    recording: Recording = Recording()
    # load_scenario reads the following, as their schemas are elsewhere.
    security: "Security | None" = None
    planner: Mapping[str, Any] = MappingProxyType({})  # class and its keys (hil/master/planner.py); {}: the default
    sensors: SensorSet = MappingProxyType({})
    failure: "tuple[Failure, ...]" = ()
    force: "tuple[Force, ...]" = ()
    release: "tuple[Release, ...]" = ()
    tether: "TetherKeys | None" = None
    member: "tuple[Member, ...]" = ()
    hunting: "Hunting | None" = None
    modem: "Modem | None" = None
    autopilot: "AutopilotSettings | None" = None
    mavlink: "Mavlink | None" = None
    path: str = ""  # path of the scenario file
    derived: tuple[str, ...] = ()  # those of DERIVED that the file leaves to the vehicle (hil/master/guidance.py)
    changes: Mapping[str, Any] = MappingProxyType({})  # what `load_scenario` changed, by dotted key

    def validate(self) -> str | None:
        """Return which keys contradict each other, or None."""
        if self.controller == "external" and self.stm32 not in ("python", "unicorn"):
            return (
                f'controller = "external" needs stm32 = "python" or "unicorn": {self.stm32!r} would hide the thrusters'
            )
        unsupported = self._unsupported_link()
        if unsupported:
            return f"stm32 = {self.stm32!r} does not speak [link] {unsupported}"
        if self.slave.deadman < 2 * self.slave.control_period:
            return "slave: deadman must be at least twice control_period"
        if self.link.watchdog < 2 * self.slave.control_period:
            return "link: watchdog must be at least twice [slave] control_period"
        return None

    def for_process(self, sensors: SensorSet) -> "Scenario":
        """Return a copy for a process that only observes, with these sensors, without parts that cannot be pickled."""
        return self._replace(force=(), failure=(), release=(), tether=None, link=Link(options={}), sensors=sensors)

    def _unsupported_link(self) -> str:
        """Return the part of [link] that the firmware in C does not support; "" if it supports all."""
        link = self.link
        if self.stm32 not in ("native", "unicorn"):
            return ""
        if link.protocol == "frame":
            return "" if link.frame == "uuv_hil" else f"frame = {link.frame!r}"
        if link.protocol == "mavlink" or (link.protocol == "vesc" and self.stm32 == "unicorn"):
            return "options" if link.options else ""
        return f"protocol = {link.protocol!r}"


def load_scenario(name: str, changes: dict[str, Any] | None = None, option: str = "--set") -> Scenario:
    """Return the scenario at a path that ends in `.toml`, or an installed one by its name.

    Paths in the file (vehicle, world) are relative to it. `changes` replace values before they are checked:
    {"master.speed": 0.5}; a path in them is first looked for in the current folder. The scenario's ROS domain and
    release become those of this process. Raises ConfigError. If a change causes the error, the error names its key and
    `option`, the option that made the change; with `option` "" it names the file only.
    """
    if not name.endswith(".toml") and (os.path.sep in name or os.path.exists(name)):
        names = ", ".join(preset_names(SCENARIOS))
        raise ConfigError(f"{shortened(name)}: a scenario is a file that ends in .toml, or one of: {names}")
    path = find_preset(SCENARIOS, name)
    try:
        scenario = _load(path, changes or {})
    except ConfigError as error:
        if not (changes and option):
            raise
        raise ConfigError(*[_with_option(problem, path, changes, option) for problem in error.args]) from None
    dialect.select(scenario.ros.domain, scenario.ros.distro)
    return scenario


def _with_option(problem: str, path: str, changes: dict[str, Any], option: str) -> str:
    """Return a problem with `option` and the change that causes it, or all if only several together do."""

    def is_there(some: dict[str, Any]) -> bool:
        try:
            _load(path, some)
        except ConfigError as error:
            return problem in error.args
        return False

    if is_there({}):
        return problem  # it is in the file itself
    alone = [key for key in changes if not is_there({k: v for k, v in changes.items() if k != key})]
    key = ", ".join(alone or changes)
    return f"{option} {key}: {_without(key, problem.removeprefix(f'{path}: '))}"


def _without(key: str, message: str) -> str:
    """Return an error's text without the sections of `key`, which the caller puts before it."""
    message = message.removeprefix(f"{key}: ")
    for part in key.split("."):
        message = message.removeprefix(f"{part}: ")
    return message


def _load(path: str, changes: dict[str, Any]) -> Scenario:
    table = read_table(path)
    for key, value in changes.items():
        _change(table, key, value, path)
    for key in ("sensors", "planner"):  # a process that gets the scenario cannot unpickle their defaults
        table.setdefault(key, {})
    folder = os.path.dirname(path)
    scenario = parse(table, Scenario, path, _readers(path))
    scenario = scenario._replace(
        path=path,
        changes=dict(changes),
        derived=tuple([key for key in DERIVED if key not in table["master"]]),
        master=scenario.master._replace(map=_relative(scenario.master.map, folder, ".yaml")),
        link=scenario.link._replace(options=dict(scenario.link.options)),
        member=tuple([_with_vehicle(member, path) for member in scenario.member]),
    )
    problems = list(_contradictions(scenario))
    if problems:
        raise ConfigError(*[f"{path}: {problem}" for problem in problems])
    if scenario.security:
        scenario = scenario._replace(security=scenario.security.resolve_paths(folder))
    if scenario.autopilot:
        scenario = scenario._replace(autopilot=scenario.autopilot.resolve_paths(folder))
    if any(spec.name or not isinstance(spec.sensor, type) for spec in scenario.sensors.values()):
        from hil.ros.own import announce  # not needed with one sensor of each kind and none of the user's own

        announce(scenario.sensors, f"{path}: sensors")
    return scenario


def _with_vehicle(member: "Member", path: str) -> "Member":
    if not member.vehicle:
        return member
    return member._replace(vehicle=_file_reader("vehicle", path)(member.vehicle, f"{path}: member: vehicle"))


def _readers(path: str) -> dict[str, Reader]:
    """Return the readers of the keys whose schema is elsewhere, for the scenario file at `path`."""
    faults = reader_of("hil.links.wires.faults:Faults")
    link: dict[str, Reader] = {"frame": _file_reader("link.frame", path), "options": check_table, "faults": faults}

    def refuse(_value: Any, where: str) -> Any:
        raise ConfigError(f"{path}: no key {where.rpartition(' ')[2]!r}")

    return {
        **READERS,
        "vehicle": _file_reader("vehicle", path),
        "world": _file_reader("world", path),
        "link": lambda table, where: convert(table, Link, where, link),
        "planner": _planner,
        "sensors": _sensors,
        **dict.fromkeys(HIDDEN, refuse),
    }


def _contradictions(scenario: Scenario) -> Iterator[str]:
    """Yield what is wrong with several sections together, and with what is left out."""
    if not scenario.security:
        yield from _missing_certificates(scenario)
    if scenario.autopilot and scenario.controller not in AUTOPILOTS:
        yield f'autopilot: belongs to controller = "ardupilot" or "px4", not to {scenario.controller!r}'
    positions = scenario.autopilot.positions if scenario.autopilot else "simulated"
    if positions != "simulated" and positions not in scenario.sensors:
        yield f"autopilot: positions: {positions!r} needs that sensor: add [sensors.{positions}]"
    blind = [name for name in FEEDBACK if name not in scenario.sensors]
    if blind and scenario.controller == "builtin":
        yield f"sensors: the builtin controller needs {blind[0]}: its rate must be above 0"


def _missing_certificates(scenario: Scenario) -> Iterator[str]:
    """Yield each TLS endpoint of a scenario without a [security] section."""
    named = {"slave: listen": scenario.slave.listen, "network: router": scenario.network.router}
    for number, member in enumerate(scenario.member):
        named |= {f"member[{number}]: listen": member.listen, f"member[{number}]: agent": member.agent}
    for key, endpoint in named.items():
        if endpoint and (problem := no_certificates(endpoint)):
            yield f"{key}: {problem}"


def load_single(name: str, changes: dict[str, Any] | None = None, remedy: str = "", option: str = "--set") -> Scenario:
    """Return the scenario of a single vehicle; see `load_scenario`.

    Raises ConfigError, also if the scenario is of a fleet; `remedy` replaces the end of that error's text.
    """
    scenario = load_scenario(name, changes, option)
    if not scenario.member:
        return scenario
    nodes = [member.node for member in scenario.member]
    started = " and ".join([f"`uuv-hil {command} {name} --member {nodes[0]}`" for command in ("slave", "fleet agent")])
    all_at_once = "all at once, for the installed fleets: `uuv-hil case target_hunting --hil`"
    remedy = remedy or f"and this command flies one vehicle; start {started}, and so on for each ({all_at_once})"
    raise ConfigError(f"{scenario.path}: member: this is a fleet ({', '.join(nodes)}), {remedy}")


def with_port(scenario: Scenario, port: str) -> Scenario:
    """Return `scenario` with another address of its thruster link. Raises ConfigError."""
    changed = scenario._replace(link=scenario.link._replace(port=port))
    problem = changed.link.validate()
    if problem:
        raise ConfigError(f"--port: {problem}")
    return changed


def _planner(table: Any, where: str) -> dict[str, Any]:
    if not isinstance(table, dict) or ("class" not in table and table):
        raise ConfigError(f'{where}: expected a table with class = "module:Class" and the keys of that class')
    return table


def _sensors(sections: Any, where: str) -> SensorSet:
    """Return the sensors of the `[sensors]` table. Raises ConfigError."""
    tables = sections.values() if isinstance(sections, dict) else ()
    if not any(isinstance(each, dict) and "instrument" in each for each in tables):
        return read_sensors(sections, where)
    from hil.scenario.instrument_records import read_fitted  # few vehicles have instruments at their wire

    return read_fitted(sections, where)


def read_forces(rows: Any, where: str) -> "tuple[Force, ...]":
    """Return an object of each [[force]], a class of the user's own. Raises ConfigError."""
    from hil.common.plugins import load_class
    from sim.forces import Force

    check_rows(rows, where)
    places = [(row, f"{where}[{i}]") for i, row in enumerate(rows)]
    return tuple(read_each(places, lambda row, place: load_class(row, Force, place, "forces")))


def _change(table: dict[str, Any], key: str, value: Any, path: str) -> None:
    *sections, last = key.split(".")
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"{path}: {key}: {section!r} is a value, not a table")
    is_here = isinstance(value, str) and value.endswith((".toml", ".yaml")) and os.path.exists(value)
    table[last] = os.path.abspath(value) if is_here else value


def build_simulation(scenario: Scenario, vehicle: Vehicle, world: World) -> Simulation:
    """Return the simulation that a scenario describes, at time 0. Raises ConfigError."""
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
        tether=scenario.tether,
    )


def _file_reader(key: str, path: str) -> Reader:
    """Return the reader of a preset's name, or of the path of a file beside the scenario; it has to exist."""

    def read(value: Any, where: str) -> str:
        name = _relative(convert(value, str, where), os.path.dirname(path))
        find_preset(FOLDERS[key], name, f"{path}: {key}")
        return name

    return read


def _relative(name: str, folder: str, ending: str = ".toml") -> str:
    return os.path.join(folder, name) if name.endswith(ending) else name

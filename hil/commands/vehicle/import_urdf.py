"""`uuv-hil vehicle --import`: make a vehicle file from a URDF or SDF, also in xacro."""

import sys
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from hil.charts.grid import write_files
from hil.charts.imports.meshes import measure
from hil.commands.vehicle.flight_file import check_files, scenario_of, to_text
from hil.commands.vehicle.xacro_expand import expand, hint, is_xacro
from hil.common.errors import ConfigError
from hil.common.tables import read_bytes, read_table
from hil.doctor.vehicle.finding import exit_code
from hil.doctor.vehicle.rules import HELD_HEADING, check_vehicle
from hil.doctor.vehicle.subject import Subject
from sim.sdf.as_urdf import as_urdf
from sim.vehicle.urdf.importer import Imported, read_robot
from sim.vehicle.urdf.shapes import MeshKey, Solid
from sim.vehicle.urdf.text import read_xml, root_of
from sim.vehicle.vehicle import EQUIPMENT, Vehicle


class Request(NamedTuple):
    """The values of `--import` and its options: the model's file, keys to add, files to write, arguments of xacro.

    With `strict` a warning among the findings is an error, as a problem is.
    """

    file: str
    add: str | None = None
    output: str | None = None
    scenario: str | None = None
    model: str | None = None
    arguments: Sequence[str] = ()
    strict: bool = False


def convert(request: Request) -> int:
    """Write the vehicle of a URDF or SDF file, completed by a TOML file, to its output or the screen; print findings.

    A xacro file is expanded first. A scenario that nothing can fly is not written. Return the exit code. Raises
    ConfigError, MissingExtraError.
    """
    vehicle, sensors, notes = read(request)
    vehicle = _steerable(vehicle, notes)
    subject = Subject(vehicle, {})
    text, findings = to_toml(vehicle, notes), list(check_vehicle(subject))
    if request.output is None:
        print(text, end="")
        print(*findings, sep="\n", end="\n" if findings else "", file=sys.stderr)
        return exit_code(findings, True) if request.strict else 0
    files, code = {request.output: text}, 0
    if request.scenario is not None:
        flight = scenario_of(request.output, request.scenario, subject, sensors, notes)
        found = check_files((text, flight), (request.output, request.scenario))
        findings = [*(each for each in findings if each.level == "note"), *found]
        code = exit_code(findings, False)
        if not code:
            files[request.scenario] = flight
    write_files({path: text.encode() for path, text in files.items()})
    fins = f", {len(vehicle.fins)} fins" if vehicle.fins else ""
    print(f"{request.output}: {vehicle.name}, {vehicle.mass:g} kg, {len(vehicle.thrusters)} thrusters{fins}")
    if request.scenario in files:
        print(f"{request.scenario}: a scenario with it, with {', '.join(sensors) or 'the usual sensors'}")
    elif request.scenario is not None:
        print(f"{request.scenario}: not written, as no flight of it succeeds: see the problems")
    elif sensors:
        names = ", ".join(sensors)
        notes.append(f"It has sensors, which belong in a scenario ({names}): --flight FILE.toml writes one.")
    print("".join([f"note: {note}\n" for note in notes] + [f"{finding}\n" for finding in findings]), end="")
    return exit_code(findings, True) if request.strict else code


def read(request: Request) -> Imported:
    """Read a vehicle from a URDF, an SDF model or a world with a vehicle. Raises ConfigError."""
    path = request.file
    text = expand(path, request.arguments) if is_xacro(path) else None
    given = read_table(request.add) if request.add else {}
    notes: list[str] = []
    data = read_bytes(path) if text is None else text
    robot = as_urdf(path, notes, request.model, data) if root_of(data) == "sdf" else read_xml(path, data)
    solids: dict[MeshKey, Solid | None] = {}

    def measured(meshes: Sequence[MeshKey]) -> dict[MeshKey, Solid]:
        """Measure each mesh once, even if several shapes use it: each measurement starts a process."""
        fresh = [mesh for mesh in meshes if mesh not in solids]
        solids.update(dict.fromkeys(fresh) | dict(measure(fresh, notes)))
        return {mesh: solid for mesh in meshes if (solid := solids[mesh]) is not None}

    try:
        imported = read_robot(robot, path, given, measured)
    except ConfigError as error:
        is_incomplete = text is not None and str(error).endswith("--add it")
        raise ConfigError(f"{error}{hint(path) if is_incomplete else ''}") from None
    return imported._replace(notes=list(dict.fromkeys(notes + imported.notes)))


def _steerable(vehicle: Vehicle, notes: list[str]) -> Vehicle:
    """Return the vehicle without Munk moments of pitch and yaw if its fins hold its heading then, and not with them.

    Simulators fly such models whose Coriolis terms are off, or have the other sign, as in Gazebo before 2026.
    """
    calm = vehicle._replace(munk_share=(vehicle.munk_share[0], 0.0, 0.0))
    if not vehicle.fins or calm == vehicle or Subject(vehicle, {}).controlled.heading <= HELD_HEADING[1]:
        return vehicle
    if Subject(calm, {}).controlled.heading > HELD_HEADING[1]:
        return vehicle
    notes.append("With the whole Munk moment its fins do not hold its heading: munk_share of pitch and yaw is 0.")
    return calm


def to_toml(vehicle: Vehicle, notes: list[str]) -> str:
    """Return `vehicle` as the text of a vehicle file; `notes` become comments at its start."""
    head = [f"# {note}" for note in ("Body axes: x forward, y starboard, z down.", *notes)]
    lines = [*head, *_toml_keys(vehicle, skip=("thrusters", "meshes", *EQUIPMENT))]
    equipment = {key: value for key in EQUIPMENT if (value := getattr(vehicle, key))}
    tables = {
        key: value for key, value in equipment.items() if hasattr(value, "_asdict") or hasattr(value[0], "_asdict")
    }
    lines += [f"{key} = {to_text(value)}" for key, value in equipment.items() if key not in tables]
    for key, value in tables.items():
        single = hasattr(value, "_asdict")
        for record in (value,) if single else value:
            lines += ["", f"[{key}]" if single else f"[[{key}]]", *_toml_keys(record, skip=())]
    for thruster in vehicle.thrusters:
        lines += ["", "[[thrusters]]", *_toml_keys(thruster, skip=())]
    for mesh in vehicle.meshes:
        lines += ["", "[[meshes]]", *_toml_keys(mesh, skip=())]
    return "\n".join(lines) + "\n"


def _toml_keys(record: Any, skip: tuple[str, ...]) -> Iterator[str]:
    defaults = record._field_defaults
    for key, value in record._asdict().items():
        if key not in skip and (key not in defaults or value != defaults[key]):
            yield f"{key} = {to_text(value)}"

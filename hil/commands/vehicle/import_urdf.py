"""`uuv-hil vehicle --import`: make a vehicle file from a URDF or SDF, also in xacro."""

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from hil.charts.grid import write_files
from hil.charts.imports.meshes import measure
from hil.commands.vehicle.xacro_expand import expand, hint, is_xacro
from hil.common.errors import ConfigError
from hil.common.tables import read_bytes, read_table
from hil.common.text import toml_text
from sim.sdf.as_urdf import as_urdf
from sim.vehicle.urdf.importer import Imported, read_robot
from sim.vehicle.urdf.shapes import MeshKey, Solid
from sim.vehicle.urdf.text import read_xml, root_of
from sim.vehicle.vehicle import EQUIPMENT, Vehicle


class Request(NamedTuple):
    """The values of `--import` and its options: the model's file, keys to add, files to write, arguments of xacro."""

    file: str
    add: str | None = None
    output: str | None = None
    scenario: str | None = None
    model: str | None = None
    arguments: Sequence[str] = ()


def convert(request: Request) -> int:
    """Write the vehicle of a URDF or SDF file, completed by a TOML file, to its output or the screen; return 0.

    A xacro file is expanded first. Raises ConfigError, MissingExtraError.
    """
    imported = read(request)
    vehicle, sensors, notes = imported
    if request.output is None:
        print(to_toml(vehicle, notes), end="")
        return 0
    files = {request.output: to_toml(vehicle, notes)}
    if request.scenario is not None:
        files[request.scenario] = scenario_of(request.output, request.scenario, vehicle.name, sensors)
    write_files({path: text.encode() for path, text in files.items()})
    fins = f", {len(vehicle.fins)} fins" if vehicle.fins else ""
    print(f"{request.output}: {vehicle.name}, {vehicle.mass:g} kg, {len(vehicle.thrusters)} thrusters{fins}")
    if request.scenario is not None:
        print(f"{request.scenario}: a scenario with it, with {', '.join(sensors) or 'the usual sensors'}")
    for note in notes:
        print(f"note: {note}")
    if sensors and request.scenario is None:
        print(
            f"note: It has sensors, which belong in a scenario ({', '.join(sensors)}): --flight FILE.toml writes one."
        )
    return 0


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


def scenario_of(vehicle: str, scenario: str, name: str, sensors: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a scenario with the file `vehicle`, whose path is written relative to that of `scenario`."""
    folder = os.path.dirname(os.path.abspath(scenario))
    relative = os.path.relpath(os.path.abspath(vehicle), folder)
    lines = [
        f"description = {_toml(f'{name}, imported')}", f"vehicle = {_toml(relative)}", 'world = "open_water"', "",
        "[start]", 'depth = "5 m"', "", "[master]", "goal = [20.0, 20.0]", 'depth = "5 m"',
    ]  # fmt: skip
    for sensor, keys in sensors.items():
        own = [f"[sensors.{sensor}]"]
        own += [f"{key} = {_toml(value)}" for key, value in keys.items() if not isinstance(value, dict)]
        for key, value in keys.items():
            if isinstance(value, dict):
                own += ["", f"[sensors.{sensor}.{key}]", *(f"{k} = {_toml(v)}" for k, v in value.items())]
        if keys.get("sensor", sensor) == "gps":
            own = ["# It needs a world with an origin:", *(f"# {line}".rstrip() for line in own)]
        lines += ["", *own]
    return "\n".join(lines) + "\n"


def to_toml(vehicle: Vehicle, notes: list[str]) -> str:
    """Return `vehicle` as the text of a vehicle file; `notes` become comments at its start."""
    head = [f"# {note}" for note in ("Body axes: x forward, y starboard, z down.", *notes)]
    lines = [*head, *_toml_keys(vehicle, skip=("thrusters", "meshes", *EQUIPMENT))]
    equipment = {key: value for key in EQUIPMENT if (value := getattr(vehicle, key))}
    tables = {
        key: value for key, value in equipment.items() if hasattr(value, "_asdict") or hasattr(value[0], "_asdict")
    }
    lines += [f"{key} = {_toml(value)}" for key, value in equipment.items() if key not in tables]
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
            yield f"{key} = {_toml(value)}"


def _toml(value: Any) -> str:
    """Return a value as TOML, without the rounding errors of sines and cosines."""
    return toml_text(value, lambda number: repr(round(float(f"{number:.12g}"), 15) + 0.0))

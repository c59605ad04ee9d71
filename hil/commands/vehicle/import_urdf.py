"""`uuv-hil vehicle --import`: make a vehicle file from a URDF or xacro."""

from collections.abc import Iterator, Sequence
from typing import Any

from hil.commands.vehicle.xacro_expand import expand, is_xacro
from hil.common.errors import ConfigError
from hil.common.tables import read_table
from sim.vehicle.urdf.importer import read_urdf
from sim.vehicle.vehicle import EQUIPMENT, Vehicle


def convert(urdf: str, add: str | None, output: str | None, arguments: Sequence[str] = ()) -> int:
    """Write the vehicle of the file `urdf`, completed by the TOML file `add`, to `output` or the screen; 0.

    A xacro file is expanded first, with these `arguments` NAME=VALUE. Raises ConfigError, MissingExtraError.
    """
    text = expand(urdf, arguments) if is_xacro(urdf) else None
    vehicle, notes = read_urdf(urdf, read_table(add) if add else {}, text)
    toml = to_toml(vehicle, notes)
    if output is None:
        print(toml, end="")
        return 0
    try:
        with open(output, "w", encoding="utf-8") as file:
            file.write(toml)
    except OSError as error:
        raise ConfigError(f"{output}: cannot be written: {error.strerror}") from None
    print(f"{output}: {vehicle.name}, {vehicle.mass:g} kg, {len(vehicle.thrusters)} thrusters")
    for note in notes:
        print(f"note: {note}")
    return 0


def to_toml(vehicle: Vehicle, notes: list[str]) -> str:
    """`vehicle` as the text of a vehicle file; `notes` stand at its head as comments."""
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
    if isinstance(value, tuple) and len(value) in (9, 36):  # a matrix, row after row
        size = 3 if len(value) == 9 else 6
        rows = [", ".join(map(_toml, value[start : start + size])) for start in range(0, len(value), size)]
        return "[\n  " + ",\n  ".join(rows) + ",\n]"
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, (bool, int)):
        return str(value).lower()
    return repr(round(float(f"{value:.12g}"), 15) + 0.0)  # without the dust of sines and cosines

"""Read TOML files into immutable records; an error names the file, the key, what was expected and the nearest key.

A record is a `typing.NamedTuple` whose annotations are the schema:

    class Link(NamedTuple):
        baud: Annotated[int, Range(1200, 12_000_000)] = 115_200
        watchdog: Annotated[float, Range(0.02, 10.0, "s")] = 0.2
        wire: Literal["pty", "uart"] = "pty"

A number with a unit may be written as an SI number (`watchdog = 0.2`) or as text with its unit (`watchdog = "200 ms"`).
Text without a unit and numbers outside the range are refused. A record may have a method `validate(self) -> str | None`
for rules between several keys: it returns the problem as text, or None. The reader adds the file and the section and
raises ConfigError.

Records are NamedTuples, not dataclasses, because `import dataclasses` (with `inspect` and `ast`) takes a fifth of a
slave's start-up time.
"""

import math
import os
import sys
import types
from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

from hil.common.errors import ConfigError
from hil.common.tables import read_table

LONGEST = 60  # characters of a value in an error message

Record = TypeVar("Record", bound=tuple[Any, ...])

# unit -> (SI unit of the same quantity, factor to it)
UNITS: dict[str, tuple[str, float]] = {
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "min": ("s", 60.0), "h": ("s", 3600.0),
    "Hz": ("Hz", 1.0), "kHz": ("Hz", 1e3),
    "m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3),
    "m/s": ("m/s", 1.0), "kn": ("m/s", 1852.0 / 3600.0),
    "rad": ("rad", 1.0), "deg": ("rad", math.pi / 180.0),
    "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", math.pi / 180.0),
    "kg": ("kg", 1.0), "g": ("kg", 1e-3),
    "N": ("N", 1.0), "kgf": ("N", 9.80665), "Pa": ("Pa", 1.0), "kPa": ("Pa", 1e3),
    "MiB": ("MiB", 1.0), "GiB": ("MiB", 1024.0),
}  # fmt: skip


class Range(NamedTuple):
    """The closed interval that a number must lie in, and its SI unit ("": a number without a unit)."""

    low: float
    high: float
    unit: str = ""


FINITE = Range(-sys.float_info.max, sys.float_info.max)


def load(path: str, record: type[Record]) -> Record:
    """Return the file at `path` as a `record`. Raises ConfigError naming the file and the key."""
    return parse(read_table(path), record, path)


def parse(table: dict[str, Any], record: type[Record], where: str, other_keys: Sequence[str] = ()) -> Record:
    """Return `table` as a `record`; `where` (file and section) begins every error message.

    `other_keys`: keys that the caller has taken out of the table. An error about an unknown key suggests them too.
    """
    annotations, defaults = _fields(record)
    for key in table:
        if key not in annotations:
            raise ConfigError(f"{where}: no key {shortened(key)}{nearest(key, [*annotations, *other_keys])}")
    values: dict[str, Any] = {}
    for key, annotation in annotations.items():
        if key in table:
            values[key] = _convert(table[key], annotation, f"{where}: {key}")
        elif key not in defaults:
            raise ConfigError(f"{where}: key {key!r} is missing")
    parsed = record(**values)
    validate = getattr(parsed, "validate", None)
    problem = validate() if validate else None
    if problem:
        raise ConfigError(f"{where}: {problem}")
    return parsed


# data folder -> what its presets are called in messages
NOUNS = {
    "hil/scenario/presets": "scenario",
    "sim/vehicles": "vehicle",
    "sim/worlds": "world",
    "sim/sensors/devices": "device",
    "firmware_stub/frames": "frame",
    "boards": "board",
    "hil/autopilots/frames": "autopilot frame",
}


def find_preset(folder: str, name: str, where: str = "") -> str:
    """Return the path of a preset file.

    `name` is a path to a TOML file if it ends in `.toml`, else the name of a preset in the installed `folder`
    ("sim/vehicles"). For an unknown preset, ConfigError lists the known ones. `where` is the file and key with this
    name; if it is given, a missing file also raises ConfigError.
    """
    path, opening = name, f"{where}: " if where else ""
    if not name.endswith(".toml"):
        path = os.path.join(preset_folder(folder), f"{name}.toml")
        if os.path.sep in name or not os.path.exists(path):
            names, noun = preset_names(folder), NOUNS[folder]
            raise ConfigError(
                f"{opening}no {noun} {shortened(name)}{nearest(name, names)}; there are: {', '.join(names)}, or the "
                "path of a .toml file"
            )
    elif where and not os.path.exists(path):
        raise ConfigError(f"{where}: {path}: no such file")
    return path


def shortened(text: str) -> str:
    """Return a text for an error message: quoted, and cut if it is long."""
    return repr(text if len(text) <= LONGEST else f"{text[:LONGEST]}...")


def preset_folder(folder: str) -> str:
    """Return the installed path of one of our data folders, such as "firmware_stub/frames"."""
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    return os.path.join(root, *folder.split("/"))


def preset_names(folder: str) -> list[str]:
    """Return the names of the presets in one of our data folders, sorted."""
    return sorted(entry[:-5] for entry in os.listdir(preset_folder(folder)) if entry.endswith(".toml"))


def _fields(record: type[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    return record.__annotations__, record._field_defaults


def _convert(value: Any, annotation: Any, where: str) -> Any:
    origin = get_origin(annotation)
    if origin is Annotated:
        plain, limit = get_args(annotation)[:2]
        return _number(value, plain, limit, where)
    if origin is Literal:
        return _choice(value, [str(choice) for choice in get_args(annotation)], where)
    if origin in (types.UnionType, Union):
        plain = next(arg for arg in get_args(annotation) if arg is not type(None))
        return _convert(value, plain, where)
    if origin is tuple:
        return _array(value, get_args(annotation), where)
    if origin is dict:
        return _table(value, get_args(annotation)[1], where)
    if isinstance(annotation, type) and issubclass(annotation, tuple):
        if not isinstance(value, dict):
            raise ConfigError(f"{where}: expected a table, found {_describe(value)}")
        return parse(value, annotation, where)
    if annotation in (float, int):
        return _number(value, annotation, FINITE, where)
    if annotation is Any:
        return value
    if not isinstance(value, annotation):
        raise ConfigError(f"{where}: expected {_NAMES[annotation]}, found {_describe(value)}")
    return value


_NAMES = {str: "text", bool: "true or false"}


def _choice(value: Any, choices: list[str], where: str) -> str:
    if not isinstance(value, str):
        raise ConfigError(f"{where}: expected one of {', '.join(choices)}, found {_describe(value)}")
    if value not in choices:
        raise ConfigError(f"{where}: {shortened(value)} is not one of {', '.join(choices)}{nearest(value, choices)}")
    return value


def _table(value: Any, annotation: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ConfigError(f"{where}: expected a table, found {_describe(value)}")
    return {key: _convert(item, annotation, f"{where}.{key}") for key, item in value.items()}


def _array(value: Any, items: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ConfigError(f"{where}: expected an array, found {_describe(value)}")
    if items[-1] is Ellipsis:
        items = (items[0],) * len(value)
    elif len(value) != len(items):
        raise ConfigError(f"{where}: expected {len(items)} values, found {len(value)}")
    return tuple(_convert(item, kind, f"{where}[{i}]") for i, (item, kind) in enumerate(zip(value, items, strict=True)))


def _number(value: Any, kind: Any, limit: Range, where: str) -> Any:
    if isinstance(value, str) and limit.unit:
        value = with_unit(value, limit.unit, where)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        unit = f" in {limit.unit}" if limit.unit else ""
        has_unit = isinstance(value, str) and value[:1].isdigit()
        raise ConfigError(
            f"{where}: expected a number{' without a unit' if has_unit else unit}, found {_describe(value)}"
        )
    if kind is int and not isinstance(value, int):
        raise ConfigError(f"{where}: expected a whole number, found {value!r}")
    if not limit.low <= value <= limit.high:  # also refuses nan
        if limit is FINITE and isinstance(value, float):
            raise ConfigError(f"{where}: expected a finite number, found {value}")
        unit = f" {limit.unit}" if limit.unit else ""
        is_huge = isinstance(value, int) and abs(value) > FINITE.high  # hundreds of digits: not convertible to float
        shown = "a number of hundreds of digits" if is_huge else f"{value:g}"
        raise ConfigError(f"{where}: {shown}{unit} is outside {limit.low:g} to {limit.high:g}{unit}")
    return kind(value)


def with_unit(text: str, si_unit: str, where: str) -> float:
    """Return the number in text with a unit, "200 ms", converted to `si_unit`. Raises ConfigError at `where`."""
    known = [unit for unit, (si, _) in UNITS.items() if si == si_unit]
    number, _, unit = text.strip().partition(" ")
    unit = unit.strip()
    try:
        magnitude = float(number)
    except ValueError:
        raise ConfigError(
            f'{where}: expected a number and a unit like "1 {si_unit}", found {shortened(text)}'
        ) from None
    if unit not in known:
        fault = f"has no unit: {text!r}" if not unit else f"has the unit {unit!r}"
        raise ConfigError(f"{where}: {fault}; expected one of {', '.join(known)}")
    return magnitude * UNITS[unit][1]


def _describe(value: Any) -> str:
    if isinstance(value, (dict, list)):
        return "a table" if isinstance(value, dict) else "an array"
    if isinstance(value, bool):
        return "true" if value else "false"
    return (
        f"the {'text' if isinstance(value, str) else 'value'} {shortened(value) if isinstance(value, str) else value}"
    )


def nearest(name: str, names: list[str]) -> str:
    """Return the end of an error message that suggests the nearest of `names`; "" if none is near."""
    import difflib  # needed only for an error message

    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""

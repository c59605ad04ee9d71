"""Read TOML files into immutable records; an error names the file, the key, what was expected and the nearest key.

A record is a `typing.NamedTuple` whose annotations are the schema:

    class Link(NamedTuple):
        baud: Annotated[int, Range(1200, 12_000_000)] = 115_200
        watchdog: Annotated[float, Range(0.02, 10.0, "s")] = 0.2
        wire: Literal["pty", "uart"] = "pty"

A number with a unit may be written as an SI number (`watchdog = 0.2`) or as text with its unit (`watchdog = "200 ms"`).
Text without a unit and numbers outside the range are refused. One value may stand for an array that has any length. A
record may have a method `validate(self) -> str | None` for rules between several keys: it returns the problem as text,
a line for each if there are several, or None. The reader adds the file and the section and raises ConfigError.

Records are NamedTuples, not dataclasses, because `import dataclasses` (with `inspect` and `ast`) takes a fifth of a
slave's start-up time.
"""

import os
import sys
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

from hil.common.errors import ConfigError
from hil.common.tables import read_table
from hil.common.units import UNITS, units_of, with_unit

LONGEST = 60  # characters of a value in an error message

Record = TypeVar("Record", bound=tuple[Any, ...])

FEW = 16  # keys of a record that an error lists all


class Range(NamedTuple):
    """The closed interval that a number must lie in, and its SI unit ("": a number without a unit)."""

    low: float
    high: float
    unit: str = ""


FINITE = Range(-sys.float_info.max, sys.float_info.max)


def load(path: str, record: type[Record]) -> Record:
    """Return the file at `path` as a `record`. Raises ConfigError naming the file and the key."""
    return parse(read_table(path), record, path)


# Reads one key's value, with the file and key that begin its error messages.
Reader = Callable[[Any, str], Any]
NO_READERS: Mapping[str, Reader] = types.MappingProxyType({})


def parse(
    table: dict[str, Any],
    record: type[Record],
    where: str,
    readers: Mapping[str, Reader] = NO_READERS,
    other_keys: Sequence[str] = (),
) -> Record:
    """Return `table` as a `record`; `where` (file and section) begins every error message.

    `readers`: functions for keys whose schema is elsewhere; what the reader of a key that the record lacks returns is
    dropped. `other_keys`: keys that the caller has taken out of the table; errors about unknown keys suggest them too.
    Raises one ConfigError with all problems, in the table's order.
    """
    annotations, defaults = _fields(record)
    values: dict[str, Any] = {}
    problems: list[str] = []
    meant: list[str] = []  # keys that are misspelled rather than missing
    for key, value in table.items():
        try:
            if key in readers:
                read = readers[key](value, f"{where}: {key}")
                if key in annotations:
                    values[key] = read
            elif key in annotations:
                values[key] = convert(value, annotations[key], f"{where}: {key}")
            else:
                hint, likely = _likely_key(key, value, annotations, [*annotations, *other_keys, *readers])
                meant.append(likely)
                problems.append(f"{where}: no key {shortened(key)}{hint}")
        except ConfigError as error:
            problems += error.args
            meant.append(key)
    if len(values) < len(annotations):
        missing = [key for key in annotations if key not in values and key not in defaults and key not in meant]
        problems += [f"{where}: key {key!r} is missing" for key in missing]
    if problems:
        raise ConfigError(*problems)
    parsed = record(**values)
    validate = getattr(parsed, "validate", None)
    problem = validate() if validate else None
    if problem:
        raise ConfigError(*[f"{where}: {line}" for line in problem.splitlines()])
    return parsed


def parse_rows(
    rows: Any, record: type[Record], where: str, readers: Mapping[str, Reader] = NO_READERS
) -> tuple[Record, ...]:
    """Return an array of tables, `[[name]]`, as records. Raises ConfigError with the problems of all rows."""
    check_rows(rows, where)
    places = [(row, f"{where}[{i}]") for i, row in enumerate(rows)]
    return tuple(read_each(places, lambda row, place: parse(row, record, place, readers)))


def check_table(value: Any, where: str) -> dict[str, Any]:
    """Return `value` if it is a table. Raises ConfigError that begins with `where`, its file and keys."""
    if not isinstance(value, dict):
        section = ".".join(where.split(": ")[1:])
        remedy = f": write its keys under [{section}]" if section and "[" not in section else ""
        raise ConfigError(f"{where}: expected a table{remedy}, found {_describe(value)}")
    return value


def check_rows(rows: Any, where: str) -> None:
    """Raise ConfigError if `rows` is not an array of tables, `[[name]]`."""
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ConfigError(f"{where}: expected tables, each under [[{where.rpartition(' ')[2]}]]")


def parse_split(table: dict[str, Any], common: type[Any], own: type[Any], where: str) -> tuple[Any, Any]:
    """Return the keys of `common` as one record, and all others as a record `own`. Raises ConfigError."""
    keys = {key: value for key, value in table.items() if key in common._fields}
    others = {key: value for key, value in table.items() if key not in keys}
    parts = read_each(
        [((keys, common, ()), where), ((others, own, common._fields), where)],
        lambda part, place: parse(part[0], part[1], place, other_keys=part[2]),
    )
    return parts[0], parts[1]


def parse_kind(table: Any, kinds: Mapping[str, Any], where: str) -> Any:
    """Return the record that the table's key `kind` selects, made of its other keys. Raises ConfigError."""
    record = kinds[kind_in(table, kinds, where)]
    return parse({key: value for key, value in table.items() if key != "kind"}, record, where)


def kind_in(table: Any, kinds: Mapping[str, Any], where: str) -> str:
    """Return the key `kind` of a table, one of `kinds`. Raises ConfigError."""
    if not isinstance(table, dict) or "kind" not in table:
        raise ConfigError(
            f'{where}: expected a table like {{ kind = "{next(iter(kinds))}" }}, found {_describe(table)}'
        )
    return _choice(table["kind"], list(kinds), f"{where}: kind")


def read_each(values: Iterable[tuple[Any, str]], read: Reader) -> list[Any]:
    """Return what `read` makes of each value, which has its file and key. Raises ConfigError with all problems."""
    results: list[Any] = []
    problems: list[str] = []
    for value, where in values:
        try:
            results.append(read(value, where))
        except ConfigError as error:
            problems += error.args
    if problems:
        raise ConfigError(*dict.fromkeys(problems))
    return results


def reader_of(place: str, *, many: bool = False) -> "partial[Any]":
    """Return the reader of the record or function at `place`, "module:Name", imported when it is called.

    `many`: of an array of tables of that record.
    """
    return partial(_read, place, many)


def _read(place: str, many: bool, value: Any, where: str) -> Any:
    target = at_place(place)
    if not isinstance(target, type):
        return target(value, where)
    return parse_rows(value, target, where) if many else convert(value, target, where)


def at_place(place: str) -> Any:
    """Import the record or function at `place`, "module:Name"."""
    from importlib import import_module

    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


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
    ("sim/vehicles") or one that another package adds. For an unknown preset, ConfigError lists the known ones. `where`
    is the file and key with this name; if it is given, a missing file also raises ConfigError.
    """
    path, opening = name, f"{where}: " if where else ""
    if not name.endswith(".toml"):
        path = os.path.join(preset_folder(folder), f"{name}.toml")
        if os.path.sep in name or not os.path.exists(path):
            from hil.common.plugins import installed, installed_file

            noun = NOUNS[folder]
            if added := installed_file(f"{noun}s", name):
                return added
            names = [*preset_names(folder), *sorted(installed(f"{noun}s"))]
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


def convert(value: Any, annotation: Any, where: str, readers: Mapping[str, Reader] = NO_READERS) -> Any:
    """Return a key's value as its annotation says; `readers` as for `parse`. Raises ConfigError at `where`."""
    origin = get_origin(annotation)
    if origin is Annotated:
        plain, limit = get_args(annotation)[:2]
        return _number(value, plain, limit, where)
    if origin is Literal:
        return _choice(value, [str(choice) for choice in get_args(annotation)], where)
    if origin in (types.UnionType, Union):
        plain = next(arg for arg in get_args(annotation) if arg is not type(None))
        return convert(value, plain, where)
    if origin is tuple:
        return _array(value, get_args(annotation), where)
    if origin is dict:
        return _table(value, get_args(annotation)[1], where)
    if isinstance(annotation, type) and issubclass(annotation, tuple):
        return parse(value if isinstance(value, dict) else check_table(value, where), annotation, where, readers)
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
    items = ((item, f"{where}.{key}") for key, item in check_table(value, where).items())
    return dict(zip(value, read_each(items, lambda item, key: convert(item, annotation, key)), strict=True))


def _array(value: Any, items: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        if items[-1] is not Ellipsis or isinstance(value, dict) or is_nested(items[0]):
            raise ConfigError(f"{where}: expected an array, found {_describe(value)}")
        return (convert(value, items[0], where),)
    if items[-1] is Ellipsis:
        items = (items[0],) * len(value)
    elif len(value) != len(items):
        raise ConfigError(f"{where}: expected {len(items)} values, found {len(value)}")
    pairs = zip(value, items, strict=True)
    try:
        return tuple([convert(item, kind, f"{where}[{i}]") for i, (item, kind) in enumerate(pairs)])
    except ConfigError:  # once more, for the problems of all items
        places = [((item, items[i]), f"{where}[{i}]") for i, item in enumerate(value)]
        return tuple(read_each(places, lambda pair, place: convert(pair[0], pair[1], place)))


def is_nested(annotation: Any) -> bool:
    """Return whether a value of this annotation is a table or an array."""
    return get_origin(annotation) is tuple or (isinstance(annotation, type) and issubclass(annotation, tuple))


def _number(value: Any, kind: Any, limit: Range, where: str) -> Any:
    if isinstance(value, str) and limit.unit in UNITS:
        value = with_unit(value, limit.unit, where)
        if kind is int and abs(value - round(value)) < 1e-6:
            value = round(value)
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


def _likely_key(key: str, value: Any, annotations: Mapping[str, Any], keys: list[str]) -> tuple[str, str]:
    """Return what follows the report of an unknown key, and the key that was probably meant; "" if none is near."""
    name, _, suffix = key.rpartition("_")
    limit = next((each for each in getattr(annotations.get(name), "__metadata__", ()) if isinstance(each, Range)), None)
    units = {unit.lower(): unit for unit in units_of(limit.unit)} if limit and limit.unit else {}
    if suffix.lower() in units and isinstance(value, (int, float)):
        return f'; write {name} = "{value} {units[suffix.lower()]}"', name
    near = nearest(key, keys)
    if len(keys) <= FEW:
        listed = f"; there are: {', '.join(keys)}"
    else:
        listed = "" if near else f"; the nearest are: {', '.join(_close(key, keys, 5, 0.0))}"
    return near + listed, near.partition("'")[2].partition("'")[0]


def _describe(value: Any) -> str:
    if isinstance(value, (dict, list)):
        return "an array" if isinstance(value, list) else "a table"
    if isinstance(value, bool):
        return "true" if value else "false"
    return (
        f"the {'text' if isinstance(value, str) else 'value'} {shortened(value) if isinstance(value, str) else value}"
    )


def nearest(name: str, names: list[str]) -> str:
    """Return the end of an error message that suggests the nearest of `names`; "" if none is near."""
    close = _close(name, names, 1, 0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def _close(name: str, names: list[str], most: int, cutoff: float) -> list[str]:
    import difflib  # needed only for an error message

    return difflib.get_close_matches(name, names, n=most, cutoff=cutoff)

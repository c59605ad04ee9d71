"""Convert a record of the schema to a Markdown table: key, type, unit, default, range, meaning."""

import types
from collections.abc import Iterable, Sequence
from math import floor, log10
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from hil.common.schema import FINITE, Range, at_place
from hil.common.tables import read_table
from hil.schemas.meanings import meaning_of, unit_of

HEAD = "| key | type | unit | default | range | meaning |\n|---|---|---|---|---|---|\n"
OWN = read_table(str(Path(__file__).with_suffix(".toml")))  # types and defaults that other code reads or sets
TOP = "Top level"
PLAIN = {str: "text", bool: "true or false", float: "number", int: "whole number", Any: "any"}


class Kind(NamedTuple):
    """Type, unit and range of one key as a page shows them."""

    type: str
    unit: str = ""
    range: str = ""
    inner: Any = None  # the record of a table


def rows(cells: Iterable[Sequence[object]]) -> str:
    """Return the rows of a Markdown table."""
    return "".join(f"| {' | '.join(map(str, row))} |\n" for row in cells)


def keys(path: str, title: str, titles: Sequence[str]) -> str:
    """Return the table of the keys of the record at `path`, "module:Record", below the heading `title`.

    A key whose table has a heading of its own among `titles` links there. Raises KeyError for a key without a meaning.
    """
    record, name = at_place(path), path.partition(":")[2]
    shown, defaults = OWN["types"].get(name, {}), OWN["defaults"].get(name, {})
    table = []
    for key, annotation in record.__annotations__.items():
        inner = key if title == TOP else f"{title}.{key}"
        if shown.get(key) == "":  # not a key of the file
            continue
        if key in shown:
            kind = Kind(shown[key])
        elif inner in titles:
            kind = Kind(f"{'tables' if 'tuple[' in str(annotation) else 'table'}, [`{inner}`](#{anchor(inner)})")
        else:
            kind = kind_of(annotation)
        unit = (unit_of(record, key) if "number" in kind.type else "") or kind.unit
        default = defaults.get(key) or default_of(record, key)
        table.append((f"`{key}`", kind.type, unit, default, kind.range, meaning_of(record, key)))
    return (HEAD + rows(table)).rstrip("\n")


def default_of(record: Any, key: str) -> str:
    """Return the default of a key as the page shows it."""
    defaults = record._field_defaults
    if key not in defaults:
        return "**required**"
    value = defaults[key]
    if _is_record(value):
        return "see there"
    if value is None or value in ((), "") or (hasattr(value, "items") and not value):
        return "none"
    return f"`{toml(value)}`"


def _is_record(value: Any) -> bool:
    return isinstance(value, tuple) and hasattr(value, "_fields")


def toml(value: Any) -> str:
    """Return a value as a TOML file writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else f"{value:.8g}"


def kind_of(annotation: Any) -> Kind:
    """Return type, unit and range of an annotation of the schema."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        plain = kind_of(arguments[0])
        limit = next((extra for extra in arguments[1:] if isinstance(extra, Range)), FINITE)
        return plain._replace(unit=limit.unit, range=_range(limit))
    if origin is Literal:
        return Kind("one of " + ", ".join(f'`"{word}"`' for word in arguments))
    if origin in (types.UnionType, Union):
        return kind_of(next(each for each in arguments if each is not type(None)))
    if origin is tuple:
        return _array(arguments)
    if origin is dict:
        return Kind(f"table of {kind_of(arguments[1]).type}")
    if isinstance(annotation, type) and issubclass(annotation, tuple):
        return Kind(f"table, [{annotation.__name__}](#{anchor(annotation.__name__)})", inner=annotation)
    return Kind(PLAIN[annotation])


def _array(items: tuple[Any, ...]) -> Kind:
    first = kind_of(items[0])
    if first.inner:
        return Kind(f"tables, [{first.inner.__name__}](#{anchor(first.inner.__name__)})", inner=first.inner)
    many = "" if items[-1] is Ellipsis else f"{len(items)} "
    if first.type.startswith("array of "):
        return first._replace(type=f"array of {many}{first.type.replace('array', 'arrays', 1)}")
    kinds = [kind_of(item) for item in items if item is not Ellipsis]
    return first._replace(
        type=f"array of {many}{first.type}{'' if first.type == 'text' else 's'}",
        unit=first.unit if all(kind.unit == first.unit for kind in kinds) else "",  # the meaning names mixed units
        range="; ".join(dict.fromkeys(kind.range for kind in kinds)),
    )


def _range(limit: Range) -> str:
    return "" if limit is FINITE else f"{_end(limit.low, 1)} to {_end(limit.high, -1)}"


def _end(value: float, inwards: int) -> str:
    """Return one end of a range, rounded inwards; the largest whole numbers as powers of two."""
    powers = [bits for bits in (31, 32, 63, 64) if abs(value) in (2**bits, 2**bits - 1)]
    if not powers:
        text = f"{value:.9g}"
        if (float(text) - value) * inwards < 0.0:
            text = f"{value + inwards * 10.0 ** (floor(log10(abs(value))) - 8):.9g}"
        return text
    return f"{'-' * (value < 0)}2^{powers[0]}{' - 1' * (abs(value) == 2 ** powers[0] - 1)}"


def anchor(title: str) -> str:
    """Return the anchor that a heading gets."""
    return "".join(c for c in title.lower().replace(" ", "-") if c.isalnum() or c in "-_")

"""Each form of a value that a schema accepts, the reader of the file accepts too; and what one refuses, both refuse."""

import re
from collections.abc import Iterator, Mapping
from math import pi
from typing import Any

import jsonschema
import pytest

from hil.common.errors import ConfigError
from hil.common.schema import Range, convert
from hil.common.units import SPELLINGS, UNITS, units_of, with_unit
from hil.schemas.convert import Converter, Schema
from hil.schemas.files import KINDS


class RecordingConverter(Converter):
    """A converter that keeps each key whose schema it derives from an annotation."""

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, tuple[Any, Schema]] = {}

    def keys(self, record: Any, overrides: Mapping[str, Schema | None] | None = None) -> dict[str, Schema]:
        schemas = super().keys(record, overrides)
        own = [key for key in schemas if key not in (overrides or {})]
        self.found |= {f"{record.__name__}.{key}": (record.__annotations__[key], schemas[key]) for key in own}
        return schemas


def every_key() -> list[tuple[str, Any, Schema]]:
    """Return name, annotation and schema, with its definitions, of each key of all kinds of files."""
    keys: dict[str, tuple[str, Any, Schema]] = {}
    for kind in KINDS.values():
        converter = RecordingConverter()
        kind(converter)
        for name, (annotation, schema) in converter.found.items():
            keys[name] = name, annotation, {**schema, "definitions": converter.definitions}
    return list(keys.values())


KEYS = every_key()


def forms(schema: Schema) -> Iterator[Any]:
    """Yield a value of each form that a schema permits, of text with a unit one for each unit."""
    for inner in schema.get("anyOf", ()):
        yield from forms(inner)
    yield from schema.get("enum", ())
    kind = schema.get("type")
    if kind in ("number", "integer"):
        yield schema.get("minimum", 1)
        yield schema.get("maximum", 1)
        if kind == "number":
            yield 0.5 * (max(schema.get("minimum", 0), -1e6) + min(schema.get("maximum", 1), 1e6))
    elif kind == "string" and "pattern" not in schema:
        yield "text"
    elif kind == "boolean":
        yield True
    elif kind == "object":
        yield {"key": next(forms(schema["additionalProperties"]))}
    elif kind == "array":
        items = schema["items"]
        count = schema.get("minItems", 3)
        each = items if isinstance(items, list) else [items] * count
        for values in zip(*[list(forms(item)) for item in each], strict=False):
            yield list(values)


def limit_of(annotation: Any) -> Range | None:
    """Return the range of a number, or of a number that may be left out."""
    own = [extra for extra in getattr(annotation, "__metadata__", ()) if isinstance(extra, Range)]
    return next(filter(None, [*own, *map(limit_of, getattr(annotation, "__args__", ()))]), None)


def with_units(schema: Schema, limit: Range) -> Iterator[str]:
    """Yield the middle of the range as text in each unit that the schema's pattern names, without and with a space."""
    pattern = next(form["pattern"] for form in schema["anyOf"] if "pattern" in form)
    units = re.search(r"\(([^()]*)\)\\s\*\$$", pattern)
    assert units
    for unit in re.sub(r"\\(.)", r"\1", units[1]).split("|"):
        value = round(0.5 * (limit.low + limit.high)) or 0.5 * limit.high
        yield from (f"{value / units_of(limit.unit)[unit]!r}{space}{unit}" for space in ("", " ", "  "))


def test_each_form_of_a_key_is_read() -> None:
    assert len(KEYS) > 800
    for name, annotation, schema in KEYS:
        validator = jsonschema.Draft7Validator(schema)
        limit = limit_of(annotation)
        is_number = limit is not None and limit.unit in UNITS and "array" not in str(schema.get("anyOf", "array"))
        values = [*forms(schema), *(with_units(schema, limit) if limit and is_number else ())]
        assert values or "$ref" in str({**schema, "definitions": {}}) or set(schema) <= {"description", "definitions"}
        for value in values:
            assert validator.is_valid(value), f"{name} = {value!r}: the schema"
            convert(value, annotation, name)


def test_what_a_schema_refuses_the_reader_refuses() -> None:
    for name, annotation, schema in KEYS:
        validator = jsonschema.Draft7Validator(schema)
        for value in ("", "1", "1 parsec", "1,5 m", "x m", "m", "1e400 s", {"x": 1}, [[[1]]], True):
            if not validator.is_valid(value):
                with pytest.raises(ConfigError):
                    convert(value, annotation, name)


@pytest.mark.parametrize(("text", "unit", "expected"), [
    ("1ms", "s", 1e-3), ("30deg", "rad", pi / 6), ("30°", "rad", pi / 6), ("2m", "m", 2.0), ("4 kgf", "N", 39.2266),
    ("9lbf", "N", 40.0339936), ("12 V", "V", 12.0), ("1.5kn", "m/s", 0.7716667), ("3 knots", "m/s", 1.5433333),
    ("36 km/h", "m/s", 10.0), ("100 ft", "m", 30.48), ("10in", "m", 0.254), ("22 lb", "kg", 9.97903214),
    ("11.5 L", "m³", 0.0115), ("250 cm3", "m³", 2.5e-4), ("1.5 bar", "Pa", 1.5e5), ("10 psi", "Pa", 68947.57293),
    ("60 rpm", "rad/s", 2 * pi), ("10 dps", "rad/s", pi / 18), ("15 °C", "°C", 15.0), ("500 kbit/s", "bit/s", 5e5),
    ("1.025 g/cm³", "kg/m³", 1025.0), ("-1.5e3mm", "m", -1.5), ("47.5°", "deg", 47.5), ("1.9 ms", "us", 1900.0),
])  # fmt: skip
def test_units_have_their_right_size(text: str, unit: str, expected: float) -> None:
    assert with_unit(text, unit, "here") == pytest.approx(expected, rel=1e-7)


def test_no_spelling_has_two_meanings() -> None:
    spellings = [*UNITS, *(spelling for several in SPELLINGS.values() for spelling in several)]
    assert len(set(spellings)) == len(spellings)
    with pytest.raises(ConfigError, match=r"here: has the unit 'mi'; expected one of m, cm, mm, km, nmi, ft, in"):
        with_unit("2 mi", "m", "here")

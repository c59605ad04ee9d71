"""Convert records of hil.common.schema to JSON Schema, draft 7, which TOML editors support."""

import re
import types
from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from hil.common.schema import FINITE, Range, is_nested
from hil.common.text import json_value
from hil.common.units import UNITS, units_of
from hil.schemas.meanings import meaning_of, unit_of

Schema = dict[str, Any]
PLAIN = {str: {"type": "string"}, bool: {"type": "boolean"}, int: {"type": "integer"}, float: {"type": "number"}}
NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"


class Converter:
    """Converter of records; each record is stored once in `definitions` and referred to from there."""

    def __init__(self) -> None:
        self.definitions: dict[str, Schema] = {}

    def of(self, annotation: Any) -> Schema:
        """Return the schema of an annotation that `hil.common.schema.parse` supports."""
        origin, arguments = get_origin(annotation), get_args(annotation)
        if origin is Annotated:
            limit = next((extra for extra in arguments[1:] if isinstance(extra, Range)), FINITE)
            return number(arguments[0], limit)
        if origin is Literal:
            return {"enum": list(arguments)}
        if origin in (types.UnionType, Union):
            return self.of(next(each for each in arguments if each is not type(None)))
        if origin is tuple:
            return self._array(arguments)
        if origin is dict:
            return {"type": "object", "additionalProperties": self.of(arguments[1])}
        if isinstance(annotation, type) and issubclass(annotation, tuple):
            return self.reference(annotation)
        return {} if annotation is Any else dict(PLAIN[annotation])

    def _array(self, items: tuple[Any, ...]) -> Schema:
        each = [self.of(item) for item in items if item is not Ellipsis]
        many: Schema = {"type": "array", "items": each[0] if each.count(each[0]) == len(each) else each}
        if items[-1] is not Ellipsis:
            return many | {"minItems": len(items), "maxItems": len(items)}
        return many if is_nested(items[0]) else {"anyOf": [many, each[0]]}

    def reference(self, record: Any) -> Schema:
        """Return a reference to a record, which is converted on the first call."""
        name = f"{record.__module__}.{record.__qualname__}"
        if name not in self.definitions:
            self.definitions[name] = {}  # ends the recursion of a record that contains itself
            self.definitions[name] = table(self.keys(record), required(record))
        return {"$ref": f"#/definitions/{name}"}

    def keys(self, record: Any, overrides: Mapping[str, Schema | None] | None = None) -> dict[str, Schema]:
        """Return the schemas of a record's keys; those of `overrides` are used unchanged, and left out if None."""
        overrides = overrides or {}
        schemas: dict[str, Schema] = {}
        for key, annotation in record.__annotations__.items():
            schema = overrides[key] if key in overrides else self.of(annotation)
            if schema is not None:
                unit = unit_of(record, key) or _unit(annotation)
                meaning = meaning_of(record, key) + (f" Unit: {unit}." if unit not in ("", "-") else "")
                schemas[key] = _described(schema, meaning, record._field_defaults.get(key))
        return schemas


def _unit(annotation: Any) -> str:
    """Return the unit of the range of an annotation, or of the items of an array; "" if there is none."""
    own = [extra.unit for extra in getattr(annotation, "__metadata__", ()) if isinstance(extra, Range)]
    return next(filter(None, [*own, *map(_unit, get_args(annotation))]), "")


def _described(schema: Schema, meaning: str, default: Any) -> Schema:
    """Return the schema of a key with its meaning and default; `$ref` is wrapped, as it permits no other keywords."""
    schema = {"allOf": [schema]} if "$ref" in schema else schema
    plain = isinstance(default, (bool, int, float, str)) or (isinstance(default, tuple) and type(default) is tuple)
    has_default = plain and default not in ("", ()) and "$ref" not in str(schema)
    return {"description": meaning} | schema | ({"default": json_value(default)} if has_default else {})


def number(kind: type, limit: Range) -> Schema:
    """Return the schema of a number in its range; a number with a unit may also be a text such as "3 m"."""
    plain: Schema = {"type": "integer" if kind is int else "number"}
    ends = {"minimum": limit.low, "maximum": limit.high} if limit is not FINITE else {}
    plain |= {name: end for name, end in ends.items() if isfinite(end)}  # JSON has no infinity
    if limit.unit not in UNITS:
        return plain
    text = {"type": "string", "pattern": rf"^\s*{NUMBER}\s*({'|'.join(map(re.escape, units_of(limit.unit)))})\s*$"}
    return {"anyOf": [plain, text]}


def table(keys: dict[str, Schema], needed: list[str] | None = None, other_keys: Any = False) -> Schema:
    """Return the schema of a table with these keys; `other_keys`: the schema of other keys, False to permit none."""
    schema: Schema = {"type": "object", "properties": keys, "additionalProperties": other_keys}
    return schema | ({"required": needed} if needed else {})


def tables(row: Schema) -> Schema:
    """Return the schema of an array of tables."""
    return {"type": "array", "items": row}


def required(record: Any) -> list[str]:
    """Return the keys of a record that have no default."""
    return [key for key in record.__annotations__ if key not in record._field_defaults]


def chosen(kinds: Mapping[str, Schema]) -> Schema:
    """Return the schema of a table whose key `kind` determines its other keys."""
    rows = []
    for kind, schema in kinds.items():
        keys = {"kind": {"const": kind, "description": f"One of {', '.join(kinds)}."}, **schema["properties"]}
        rows.append(table(keys, ["kind", *schema.get("required", [])]))
    return {"anyOf": rows}

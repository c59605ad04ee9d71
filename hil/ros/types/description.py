"""Describe types as rosidl does: for their hashes, and for the service ~/get_type_description of each node.

A description is a message of type_description_interfaces, REP 2016, as nested dicts.
"""

from collections.abc import Iterator
from typing import Any

from hil.ros.types import PRIMITIVES, Field, definition

# type_description_interfaces/msg/FieldType; of an array 48 more, of a bounded sequence 96, of another one 144.
# A char of a .msg file is a uint8 of the IDL that rosidl makes of it, and described as that.
NESTED, BOUNDED_STRING, ARRAY, BOUNDED, SEQUENCE = 1, 21, 48, 96, 144
TYPE_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9, "float32": 10,
    "float64": 11, "char": 3, "bool": 15, "byte": 16, "string": 17,
}  # fmt: skip
PLACEHOLDER = Field("structure_needs_at_least_one_member", "uint8", None)  # that of a message without fields

Description = dict[str, Any]


def describe_type(name: str) -> Description:
    """Return the TypeDescription of a message or service. Raises ConfigError for an unknown type."""
    own = _service(name) if "/srv/" in name else [_message(name)]
    known = {part["type_name"]: part for part in own}
    waiting = list(_nested(own))
    while waiting:
        inner = waiting.pop()
        if inner not in known:
            known[inner] = _message(inner)
            waiting += _nested([known[inner]])
    others = [known[inner] for inner in sorted(known) if inner != name]
    return {"type_description": known[name], "referenced_type_descriptions": others}


def _field(field: Field) -> Description:
    nested = "" if field.type in PRIMITIVES else field.type
    if field.length is None and field.most:
        return _described(field.name, BOUNDED_STRING, 0, nested, field.most)
    form = 0 if field.length is None else ARRAY if field.length else BOUNDED if field.most else SEQUENCE
    return _described(field.name, TYPE_IDS.get(field.type, NESTED) + form, field.length or field.most, nested)


def _described(name: str, type_id: int, capacity: int, nested: str, longest: int = 0) -> Description:
    kind = {"type_id": type_id, "capacity": capacity, "string_capacity": longest, "nested_type_name": nested}
    return {"name": name, "type": kind}


def _message(name: str) -> Description:
    """Return a message, or one half of a service."""
    return {"type_name": name, "fields": [_field(field) for field in definition(name).fields or (PLACEHOLDER,)]}


def _service(name: str) -> list[Description]:
    """Return a service, its two halves, and the event that ROS makes of a call."""
    request, response, event = f"{name}_Request", f"{name}_Response", f"{name}_Event"
    halves = [("request_message", request), ("response_message", response), ("event_message", event)]
    rows = [_described("info", NESTED, 0, "service_msgs/msg/ServiceEventInfo")]
    rows += [_described(key, NESTED + BOUNDED, 1, half) for key, half in (("request", request), ("response", response))]
    return [
        {"type_name": name, "fields": [_described(key, NESTED, 0, half) for key, half in halves]},
        _message(request),
        _message(response),
        {"type_name": event, "fields": rows},
    ]


def _nested(parts: list[Description]) -> Iterator[str]:
    for part in parts:
        yield from [field["type"]["nested_type_name"] for field in part["fields"] if field["type"]["nested_type_name"]]

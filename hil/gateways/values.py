"""Messages of hil.ros.message as clients of rosbridge and Foxglove have them in JSON and CBOR, and back.

In JSON bytes are base64, and what is not a finite number is null. In CBOR an array of numbers is a typed array (RFC
8746), little-endian. Of what a client sends, the names of ROS 1 are understood too: `secs` and `nsecs` of a time, and
types without "/msg/".
"""

import json
from base64 import b64decode, b64encode
from binascii import Error
from collections.abc import Mapping, Sequence
from math import nan
from struct import pack
from typing import Any

from hil.common.errors import ConfigError
from hil.ros.types import PRIMITIVES, Field, definition

BYTES = ("uint8", "byte", "char")
INTEGERS = {name for name in PRIMITIVES if "int" in name} | {"byte", "char"}
FLOATS = ("float32", "float64")
TAGS = {
    "int8": 72, "uint16": 69, "int16": 77, "uint32": 70, "int32": 78, "uint64": 71, "int64": 79, "float32": 85,
    "float64": 86,
}  # fmt: skip
OLD_NAMES = {"secs": "sec", "nsecs": "nanosec"}
OLD_ONLY = {"std_msgs/msg/Header": ("seq",)}  # fields that ROS 2 has no more
DEEPEST = 16  # messages in messages


def whole_type(name: str, kind: str = "msg") -> str:
    """Return "geometry_msgs/msg/Twist", also of "geometry_msgs/Twist"."""
    package, _, last = name.rpartition("/")
    return name if "/" in package or not package else f"{package}/{kind}/{last}"


def to_json(type_name: str, message: Mapping[str, Any]) -> dict[str, Any]:
    """Return a message for `hil.common.text.json_text`, which makes what is not finite null."""
    return {field.name: _to_json(field, message[field.name]) for field in definition(type_name).fields}


def _to_json(field: Field, value: Any) -> Any:
    if isinstance(value, bytes):
        return b64encode(value).decode()
    if field.type in PRIMITIVES:
        return value
    if field.length is None:
        return to_json(field.type, value)
    return [to_json(field.type, each) for each in value]


def to_cbor(type_name: str, message: Mapping[str, Any]) -> dict[str, Any]:
    """Return a message for `cbor2.dumps`."""
    return {field.name: _to_cbor(field, message[field.name]) for field in definition(type_name).fields}


def _to_cbor(field: Field, value: Any) -> Any:
    from cbor2 import CBORTag

    if field.type not in PRIMITIVES:
        return to_cbor(field.type, value) if field.length is None else [to_cbor(field.type, each) for each in value]
    if field.length is None or field.type not in TAGS:
        return value if isinstance(value, (bytes, str)) or field.length is None else list(value)
    return CBORTag(TAGS[field.type], pack(f"<{len(value)}{PRIMITIVES[field.type]}", *value))


def parse_json(data: bytes, where: str) -> Any:
    """Return the values in JSON of a client. Raises ConfigError at `where`."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        raise ConfigError(f"{where}: not JSON") from None


def from_json(type_name: str, values: Any) -> dict[str, Any]:
    """Return the values of a client as a message, for `hil.ros.message.encode`. Raises ConfigError."""
    return _message(type_name, values, type_name, DEEPEST)


def _message(type_name: str, values: Any, path: str, deepest: int) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: expected an object with the fields of {type_name}")
    if not deepest:
        raise ConfigError(f"{path}: too many messages in each other")
    fields = {field.name: field for field in definition(type_name).fields}
    message = {}
    for given_name, value in values.items():
        name = OLD_NAMES.get(given_name, given_name) if given_name not in fields else given_name
        if name not in fields:
            if given_name in OLD_ONLY.get(type_name, ()):
                continue
            raise ConfigError(f"{path}: {type_name} has no field {given_name[:60]!r}")
        message[name] = _field(fields[name], value, f"{path}.{name}", deepest - 1)
    return message


def _field(field: Field, value: Any, path: str, deepest: int) -> Any:
    if field.length is None:
        return _single(field, value, path, deepest)
    if field.type in BYTES and isinstance(value, str):
        try:
            return b64decode(value, validate=True)
        except (Error, ValueError):
            raise ConfigError(f"{path}: expected base64, or an array of numbers") from None
    if not isinstance(value, list):
        raise ConfigError(f"{path}: expected an array")
    items = [_single(field, each, path, deepest) for each in value]
    if field.type not in BYTES:
        return items
    if not all(0 <= each <= 255 for each in items):
        raise ConfigError(f"{path}: expected numbers from 0 to 255")
    return bytes(items)


def _single(field: Field, value: Any, path: str, deepest: int) -> Any:
    if field.type not in PRIMITIVES:
        return _message(field.type, value, path, deepest)
    if field.type in FLOATS and value is None:
        return nan
    if field.type in FLOATS and isinstance(value, int):
        return _float(value, path)
    if field.type in INTEGERS and isinstance(value, float) and value.is_integer():
        return int(value)  # JavaScript has but one kind of number, and MATLAB writes 1.0
    wanted = str if field.type == "string" else bool if field.type == "bool" else (int, float)
    if not isinstance(value, wanted) or (field.type in INTEGERS and not isinstance(value, int)):
        raise ConfigError(f"{path}: {str(value)[:60]!r} is no {field.type}")
    return value


def _float(value: int, path: str) -> float:
    try:
        return float(value)
    except OverflowError:
        raise ConfigError(f"{path}: too large a number") from None


def arguments(type_name: str, given: Any) -> dict[str, Any]:
    """Return the request of a call: an object, or its values in the order of the fields. Raises ConfigError."""
    if isinstance(given, Sequence) and not isinstance(given, str):
        names = [field.name for field in definition(type_name).fields]
        if len(given) > len(names):
            raise ConfigError(f"args: {len(given)} values for {len(names)} fields of {type_name}")
        given = dict(zip(names, given, strict=False))
    return from_json(type_name, given or {})

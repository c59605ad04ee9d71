"""Encode and decode any message by its definition, as nested dicts, if it has no encoder of its own.

This is used for images, clouds and maps, by `uuv-hil topic`, and by planners with messages that the vehicle does not
have. The vehicle's frequent messages have fixed layouts, which are ten times as fast (hil.ros.encoders).

A message is a dict by field name. An array of numbers is a tuple, an array of bytes (uint8, byte, char) is `bytes`, an
array of messages a list. Nothing is converted: frames, units and signs are those of ROS.
"""

from collections.abc import Collection, Hashable, Iterable, Mapping
from struct import calcsize, error
from typing import Any

from hil.common.errors import ConfigError
from hil.ros.cdr import MalformedError, Reader, Writer, tolerant
from hil.ros.types import PRIMITIVES, Field, definition

Message = dict[str, Any]
_NS_PER_S = 1_000_000_000
_WANTED = {"string": "a text", "bool": "true or false"}  # for any other primitive: a number


def encode(type_name: str, values: Mapping[str, Any]) -> bytes:
    """Return a message of `type_name` ("sensor_msgs/msg/Image", "std_srvs/srv/SetBool_Request").

    Fields that are left out are zero, empty or their definition's default. An array of numbers may be any sequence, or
    a buffer of its little-endian bytes. Raises ConfigError, with the path of the field, for an unknown type or field
    and for a value that does not fit.
    """
    writer = Writer()
    _write(writer, type_name, values, type_name)
    return bytes(writer.data)


def decode(type_name: str, data: bytes) -> Message | None:
    """Return the fields of a payload; None if it is malformed. Raises ConfigError for an unknown type."""
    definition(type_name)
    return tolerant(lambda payload: read(type_name, payload))(data)


def read(type_name: str, data: bytes) -> Message:
    """Return the fields of a payload. Raises MalformedError; use inside `tolerant`."""
    return _read(Reader(data), type_name)


def header(time_ns: int, frame: str = "") -> Message:
    """Return a std_msgs/Header with this time (ns) and frame."""
    seconds, nanoseconds = divmod(time_ns, _NS_PER_S)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame}


def time_of(message: Message) -> int:
    """Return the time (ns) in the header of a message."""
    stamp = message["header"]["stamp"]
    return int(stamp["sec"] * _NS_PER_S + stamp["nanosec"])


def empty(type_name: str) -> Message:
    """Return a message with its default values. Raises ConfigError for an unknown type."""
    message = decode(type_name, encode(type_name, {}))
    assert message is not None
    return message


def _write(writer: Writer, type_name: str, values: Any, path: str) -> None:
    if not isinstance(values, Mapping):
        raise ConfigError(f"{path}: expected the fields of {type_name}, found {values!r}")
    fields = definition(type_name).fields
    _refuse_unknown(values, fields, path)
    for field in fields:
        _write_field(writer, field, values.get(field.name), f"{path}.{field.name}")
    if not fields:
        writer.numbers("B", 0)  # an empty message takes one byte


def _write_field(writer: Writer, field: Field, value: Any, path: str) -> None:
    if field.length is not None:
        _write_array(writer, field, value, path)
    elif field.type in PRIMITIVES:
        _write_primitives(writer, field.type, (_default(field) if value is None else value,), path)
    else:
        _write(writer, field.type, {} if value is None else value, path)


def _write_array(writer: Writer, field: Field, value: Any, path: str) -> None:
    raw = _raw(field, value)
    if raw is not None:
        _write_raw(writer, field, raw, path)
        return
    if isinstance(value, (str, Mapping)) or not isinstance(value, Iterable | None):
        raise ConfigError(f"{path}: expected a list, found {value!r}")
    items = [_default(field)] * (field.length or 0) if value is None else list(value)
    _write_count(writer, field, len(items), path)
    if field.type in PRIMITIVES:
        _write_primitives(writer, field.type, items, path)
        return
    for index, item in enumerate(items):
        _write(writer, field.type, {} if item is None else item, f"{path}[{index}]")


def _raw(field: Field, value: Any) -> bytes | None:
    """Return the bytes of a buffer of numbers in the wire's byte order (little-endian); None for other values."""
    code = PRIMITIVES.get(field.type)
    if not code:
        return None
    try:
        view = memoryview(value)
    except TypeError:
        return None
    if isinstance(value, bytes):  # saves a copy of a picture
        return value
    return view.tobytes() if view.itemsize == 1 or view.format.lstrip("<=@") == code else None


def _write_raw(writer: Writer, field: Field, data: bytes, path: str) -> None:
    size = calcsize(f"<{PRIMITIVES[field.type]}")
    if len(data) % size:
        raise ConfigError(f"{path}: {len(data)} bytes are no whole number of {field.type}")
    _write_count(writer, field, len(data) // size, path)
    if data:
        writer.raw(data, size)


def _write_count(writer: Writer, field: Field, count: int, path: str) -> None:
    if field.most and count > field.most:
        raise ConfigError(f"{path}: {count} values, at most {field.most}")
    if not field.length:
        writer.numbers("I", count)
    elif field.length != count:
        raise ConfigError(f"{path}: {count} values, expected {field.length}")


def _write_primitives(writer: Writer, kind: str, values: Collection[Any], path: str) -> None:
    for value in values:
        if not _has_type(kind, value):
            raise ConfigError(f"{path}: expected {_WANTED.get(kind, 'a number')}, found {value!r}")
    if kind == "string":
        for value in values:
            writer.string(value)
        return
    try:
        writer.numbers(PRIMITIVES[kind], *values)
    except (error, OverflowError, TypeError, ValueError) as problem:
        raise ConfigError(f"{path}: no {kind}: {problem}") from None


def _has_type(kind: str, value: Any) -> bool:
    """Return whether a value has the type. `struct` does not check this: it takes "off" as true, and True as 1.

    0 and 1 are accepted as bools, as in ROS's own tools.
    """
    if kind == "string":
        return isinstance(value, str)
    if kind == "bool":
        return isinstance(value, Hashable) and value in (False, True)
    return not isinstance(value, (bool, str))


def _refuse_unknown(values: Mapping[str, Any], fields: tuple[Field, ...], path: str) -> None:
    known = [field.name for field in fields]
    for key in values:
        if key not in known:
            from hil.common.schema import nearest

            raise ConfigError(f"{path}: no field {key!r}{nearest(str(key), known)}; there are: {', '.join(known)}")


def _default(field: Field) -> Any:
    if field.type == "string":
        return ""
    if field.type not in PRIMITIVES:
        return None
    return field.default if field.type.startswith("float") else int(field.default)


def _read(reader: Reader, type_name: str) -> Message:
    return {field.name: _read_field(reader, field) for field in definition(type_name).fields}


def _read_field(reader: Reader, field: Field) -> Any:
    if field.length is None:
        return _read_values(reader, field.type, 1)[0]
    count = field.length or reader.count()
    if field.most and count > field.most:
        raise MalformedError("more elements than allowed")
    if PRIMITIVES.get(field.type) == "B":
        return reader.raw(count)
    return _read_values(reader, field.type, count)


def _read_values(reader: Reader, kind: str, count: int) -> Any:
    if kind == "string":
        return [reader.string() for _ in range(count)]
    if kind in PRIMITIVES:
        return reader.numbers(PRIMITIVES[kind], count)
    return [_read(reader, kind) for _ in range(count)]

"""MAVLink messages as JSON, as mavlink2rest and BlueOS' mavlink-server have them: a header, and the message.

    {"header": {"system_id": 1, "component_id": 1, "sequence": 7, "message_id": 0},
     "message": {"type": "HEARTBEAT", "mavtype": {"type": "MAV_TYPE_SUBMARINE"}, "base_mode": {"bits": 81}, ...}}

An enumeration is its entry's name, a set of flags its bits, a text a string. A field "type" is called "mavtype", as
"type" is that of the message. Source: bluerobotics/mavlink-server, src/lib/mavlink_json.rs, and the serde forms of the
Rust crate mavlink that it uses.
"""

import json
import math
import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

LONGEST = 10_000  # bytes of a message as JSON
# What a text that anybody may have written makes json, these lines and pymavlink's packing raise.
_UNFIT = (
    LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError, StopIteration, struct.error,
    dialect.MAVError,
)  # fmt: skip
_KINDS = {kind.msgname: kind for kind in dialect.mavlink_map.values()}


def encode_message(header: tuple[int, int, int], fields: dict[str, Any], message: Any) -> bytes:
    """Return a message with these `fields` as JSON. `header`: system, component, sequence."""
    system, component, sequence = header
    top = {"system_id": system, "component_id": component, "sequence": sequence, "message_id": message.get_msgId()}
    return json.dumps({"header": top, "message": {"type": message.get_type(), **fields}}).encode()


def plain_fields(message: Any) -> dict[str, Any]:
    """Return the fields of a message as JSON has them: no NaN, texts without their padding."""
    names = [name for name in message.get_fieldnames() if hasattr(message, name)]
    return {_outer(name): _plain(message, name, getattr(message, name)) for name in names}


def decode_message(text: bytes) -> bytes | None:
    """Return the MAVLink 2 packet of a message as JSON; None if it is not a message, or its fields do not fit."""
    if len(text) > LONGEST:
        return None
    try:
        whole = json.loads(text)
        header, fields = whole["header"], whole["message"]
        kind = _KINDS[fields["type"]]
        values = [_value(kind, name, fields) for name in kind.fieldnames]
        sender = dialect.MAVLink(None, int(header["system_id"]), int(header["component_id"]))
        sender.seq = int(header.get("sequence", 0)) & 0xFF
        packet: bytes = kind(*values).pack(sender)
    except _UNFIT:
        return None
    return packet


def _outer(name: str) -> str:
    return "mavtype" if name == "type" else name


def _plain(message: Any, name: str, value: Any) -> Any:
    if isinstance(value, (bytes, bytearray)):
        return bytes(value).rstrip(b"\0").decode("utf-8", "replace")
    if isinstance(value, (list, tuple)):
        return [_plain(message, name, item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if not isinstance(value, int):
        return value
    enum = getattr(message, "fieldenums_by_name", {}).get(name)
    if enum is None:
        return value
    if getattr(message, "fielddisplays_by_name", {}).get(name) == "bitmask":
        return {"bits": value}
    entry = dialect.enums.get(enum, {}).get(value)
    return {"type": entry.name} if entry else value


def _value(kind: Any, name: str, fields: dict[str, Any]) -> Any:
    """Return what pymavlink wants of a field; one that is left out is 0. Raises where it cannot be."""
    form, size = kind.fieldtypes[kind.fieldnames.index(name)], kind.array_lengths[_wire_index(kind, name)]
    value = fields.get(_outer(name))
    if form == "char":
        text = "".join(value) if isinstance(value, list) else value or ""
        return text.encode()[: max(size, 1)]
    if size:
        return [_number(kind, name, form, each) for each in value] if value else [0] * size
    return _number(kind, name, form, value)


def _wire_index(kind: Any, name: str) -> int:
    """Return the index of a field in the order of the wire, which array_lengths has."""
    return int(kind.ordered_fieldnames.index(name))


def _number(kind: Any, name: str, form: str, value: Any) -> Any:
    if isinstance(value, dict):
        if "bits" in value:
            return int(value["bits"])
        entries = dialect.enums[kind.fieldenums_by_name[name]]
        return next(number for number, entry in entries.items() if entry.name == value["type"])
    if value is None:
        return math.nan if form in ("float", "double") else 0
    return float(value) if form in ("float", "double") else int(value)

"""Services of DroneCAN nodes besides GetNodeInfo: parameters, restart and statistics.

Source: as in hil.links.dronecan.types. Decoders return None for bytes that are not of their type.
"""

from struct import Struct, error
from typing import NamedTuple

from hil.links.dronecan.transfer import data_type

GET_TRANSPORT_STATS = data_type(4, 0xBE6F_76A7_EC31_2B04, 0)  # the sizes are those of the requests
RESTART_NODE = data_type(5, 0x569E_0539_4A30_17F0, 5)
EXECUTE_OPCODE = data_type(10, 0x3B13_1AC5_EB69_D2CD, 7)
GET_SET = data_type(11, 0xA7B6_22F9_39D1_A4D5, 224)

RESTART_MAGIC = 0xACCE_551B_1E
SAVE, ERASE = 0, 1
_EMPTY, _INTEGER, _REAL, _BOOLEAN, _STRING = range(5)  # tags of a Value; a NumericValue has the first three
_INT64, _FLOAT32 = Struct("<q"), Struct("<f")

Value = int | float | bool | str | None


class GetSet(NamedTuple):
    """A request to uavcan.protocol.param.GetSet. `value` None means read; a name takes precedence over the number."""

    number: int
    value: Value
    name: str


class Description(NamedTuple):
    """The answer to GetSet. An empty name means that the parameter is unknown; a bool has no limits."""

    name: str = ""
    value: Value = None
    default: Value = None
    most: Value = None
    least: Value = None


class TransportStats(NamedTuple):
    """Counters since the start: transfers and CAN frames, sent, received and with errors."""

    transfers_sent: int
    transfers_received: int
    transfer_errors: int
    frames_sent: int
    frames_received: int
    frame_errors: int


def unpack_get_set(payload: bytes) -> GetSet | None:
    """Return a GetSet request; None for invalid bytes."""
    if len(payload) < 2:
        return None
    number, tag, remainder = payload[0] | payload[1] >> 3 << 8, payload[1] & 7, payload[2:]
    try:
        value, size = _value(tag, remainder)
    except (error, IndexError):
        return None
    if tag > _STRING or size > len(remainder):
        return None
    return GetSet(number, value, remainder[size:].decode("ascii", "replace"))


def _value(tag: int, data: bytes) -> tuple[Value, int]:
    """Return a value and its size in bytes. Raises error, IndexError."""
    if tag == _INTEGER:
        return _INT64.unpack_from(data)[0], _INT64.size
    if tag == _REAL:
        return _FLOAT32.unpack_from(data)[0], _FLOAT32.size
    if tag == _BOOLEAN:
        return bool(data[0]), 1
    if tag == _STRING:
        return data[1 : 1 + data[0]].decode("utf-8", "replace"), 1 + data[0]
    return None, 0


def _packed(value: Value) -> bytes:
    """Return a value as bytes, after its tag."""
    if value is None:
        return bytes((_EMPTY,))
    if isinstance(value, bool):
        return bytes((_BOOLEAN, value))
    if isinstance(value, int):
        return bytes((_INTEGER,)) + _INT64.pack(value)
    if isinstance(value, float):
        return bytes((_REAL,)) + _FLOAT32.pack(value)
    text = value.encode()[:128]
    return bytes((_STRING, len(text))) + text


def pack_description(description: Description) -> bytes:
    """Pack the answer to GetSet."""
    values = (description.value, description.default, description.most, description.least)
    return b"".join([_packed(value) for value in values]) + description.name.encode("ascii")


def unpack_opcode(payload: bytes) -> int | None:
    """Return the opcode of an ExecuteOpcode request; None for a wrong length. Its argument is reserved."""
    return payload[0] if len(payload) == EXECUTE_OPCODE.max_size else None


def pack_opcode_result(ok: bool) -> bytes:
    """Pack the answer to ExecuteOpcode."""
    return bytes(6) + pack_done(ok)


def is_restart(payload: bytes) -> bool:
    """Return whether a request to RestartNode has its magic number."""
    return payload == RESTART_MAGIC.to_bytes(5, "little")


def pack_done(ok: bool) -> bytes:
    """Pack the bool that is the answer to RestartNode."""
    return bytes((ok << 7,))


def pack_transport_stats(stats: TransportStats) -> bytes:
    """Pack the answer to GetTransportStats, with one CAN interface."""
    return b"".join([(count & 0xFFFF_FFFF_FFFF).to_bytes(6, "little") for count in stats])

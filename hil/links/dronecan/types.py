"""DroneCAN data types of a thruster link, with their encoders and decoders.

Source of numbers, fields and units: the definitions in github.com/dronecan/DSDL. The signatures were computed from them
by the algorithm of the specification, chapter 3. Of a number with more than 8 bits the low byte comes first; each byte,
also a shorter last one, begins with its highest bit. An array at the end of a message has no length field.

A decoder returns None for bytes that are not of its type.
"""

from struct import Struct
from typing import NamedTuple

from hil.links.dronecan.transfer import data_type

ALLOCATION = data_type(1, 0x0B2A_8126_20A1_1D40, 17)
NODE_STATUS = data_type(341, 0x0F08_68D0_C1A7_C6F1, 7)
RAW_COMMAND = data_type(1030, 0x217F_5C87_D7EC_951D, 35)
ESC_STATUS = data_type(1034, 0xA9AF_28AE_A2FB_B254, 14)
ARMING_STATUS = data_type(1100, 0x8700_F375_556A_8003, 1)
GET_NODE_INFO = data_type(1, 0xEE46_8A81_21C4_6A9E, 0)  # of its request, which is empty

FULL_RAW = 8191
MAX_RPM = (1 << 17) - 1
DISARMED, FULLY_ARMED = 0, 255  # values of ArmingStatus
HEALTH_OK, HEALTH_WARNING = 0, 1
MODE_OPERATIONAL = 0
UNIQUE_ID_SIZE = 16
MAX_HALF = 65504.0  # the largest float16

_RAW_BITS, _RAW_MASK = 14, 0x3FFF
_STATUS = Struct("<I3e")
_NODE_STATUS = Struct("<IBH")
_VERSIONS = Struct("<BBBIQBB16sB")


class EscStatus(NamedTuple):
    """uavcan.equipment.esc.Status: volts, amperes, kelvin, signed revolutions per minute, percent of full power."""

    error_count: int
    voltage_v: float
    current_a: float
    temperature_k: float
    rpm: int
    power_pct: int
    esc_index: int


class NodeStatus(NamedTuple):
    """uavcan.protocol.NodeStatus."""

    uptime_s: int
    health: int
    mode: int
    vendor_code: int


class NodeInfo(NamedTuple):
    """A node's answer to uavcan.protocol.GetNodeInfo, without its status."""

    name: str
    unique_id: bytes
    software: tuple[int, int]
    hardware: tuple[int, int]


class Allocation(NamedTuple):
    """uavcan.protocol.dynamic_node_id.Allocation; `unique_id` may be incomplete."""

    node_id: int
    first_part: bool
    unique_id: bytes


def _half(value: float) -> float:
    """Return a value limited to the range of a float16; NaN stays NaN."""
    return max(min(value, MAX_HALF), -MAX_HALF)


def pack_raw_command(raw: list[int]) -> bytes:
    """Encode uavcan.equipment.esc.RawCommand: one signed output a controller, at most +-8191; 0 is standstill."""
    stream = 0
    for value in raw:
        value &= _RAW_MASK
        stream = stream << _RAW_BITS | (value & 0xFF) << 6 | value >> 8
    bits = _RAW_BITS * len(raw)
    return (stream << -bits % 8).to_bytes((bits + 7) // 8, "big")


def unpack_raw_command(payload: bytes) -> list[int]:
    """Return the outputs, -8192 to 8191; remaining bits of the last byte are padding."""
    count = len(payload) * 8 // _RAW_BITS
    stream = int.from_bytes(payload, "big") >> len(payload) * 8 - count * _RAW_BITS
    raw = []
    for shift in range((count - 1) * _RAW_BITS, -1, -_RAW_BITS):
        bits = stream >> shift & _RAW_MASK
        value = (bits & 0x3F) << 8 | bits >> 6
        raw.append(value - 0x4000 if value > FULL_RAW else value)
    return raw


def unpack_arming_status(payload: bytes) -> int | None:
    """Return whether motor controllers may run: DISARMED, FULLY_ARMED or a value between them."""
    return payload[0] if len(payload) == ARMING_STATUS.max_size else None


def pack_esc_status(status: EscStatus) -> bytes:
    """Encode an ESC status; numbers are limited to the range of their fields, the error count wraps."""
    errors, volts, amperes, kelvin, rpm, percent, esc_index = status
    rpm = min(max(rpm, -MAX_RPM - 1), MAX_RPM) & 0x3FFFF
    percent = min(max(percent, 0), 127)
    end = (rpm & 0xFF) << 24 | (rpm & 0xFF00) << 8 | rpm >> 16 << 14 | percent << 7 | (esc_index & 31) << 2
    return _STATUS.pack(errors & 0xFFFF_FFFF, _half(volts), _half(amperes), _half(kelvin)) + end.to_bytes(4, "big")


def unpack_esc_status(payload: bytes) -> EscStatus | None:
    """Return the status of one motor controller."""
    if len(payload) != ESC_STATUS.max_size:
        return None
    end = int.from_bytes(payload[10:], "big")
    rpm = end >> 24 | end >> 8 & 0xFF00 | (end >> 14 & 3) << 16
    rpm = rpm - 0x40000 if rpm > MAX_RPM else rpm
    errors, volts, amperes, kelvin = _STATUS.unpack_from(payload)
    return EscStatus(errors, volts, amperes, kelvin, rpm, end >> 7 & 127, end >> 2 & 31)


def pack_node_status(status: NodeStatus) -> bytes:
    """Encode a node status; the unused sub-mode is 0."""
    return _NODE_STATUS.pack(
        status.uptime_s & 0xFFFF_FFFF, status.health << 6 | status.mode << 3, status.vendor_code & 0xFFFF
    )


def unpack_node_status(payload: bytes) -> NodeStatus | None:
    """Return the status of a node."""
    if len(payload) != NODE_STATUS.max_size:
        return None
    uptime_s, health_mode, vendor_code = _NODE_STATUS.unpack(payload)
    return NodeStatus(uptime_s, health_mode >> 6, health_mode >> 3 & 7, vendor_code)


def pack_node_info(status: NodeStatus, info: NodeInfo) -> bytes:
    """Encode the response to GetNodeInfo, without optional fields: commit, image CRC, certificate."""
    versions = _VERSIONS.pack(*info.software, 0, 0, 0, *info.hardware, info.unique_id, 0)
    return pack_node_status(status) + versions + info.name.encode("ascii")


def pack_allocation(allocation: Allocation) -> bytes:
    """Encode a request for a node number, or an allocator's answer."""
    return bytes((allocation.node_id << 1 | allocation.first_part,)) + allocation.unique_id


def unpack_allocation(payload: bytes) -> Allocation | None:
    """Return a request for a node number, or an allocator's answer."""
    if not 0 < len(payload) <= ALLOCATION.max_size:
        return None
    return Allocation(payload[0] >> 1, bool(payload[0] & 1), payload[1:])

"""DroneCAN data types of a thruster link, with their encoders and decoders.

Source of numbers, fields and units: the definitions in github.com/dronecan/DSDL. The signatures were computed from them
by the algorithm of the specification, chapter 3. Of a number with more than 8 bits the low byte comes first; each byte,
also a shorter last one, begins with its highest bit. An array at the end of a message has no length field.

A decoder returns None for bytes that are not of its type.
"""

from collections.abc import Sequence
from struct import Struct
from typing import NamedTuple

from hil.links.dronecan.transfer import data_type

ALLOCATION = data_type(1, 0x0B2A_8126_20A1_1D40, 17)
NODE_STATUS = data_type(341, 0x0F08_68D0_C1A7_C6F1, 7)
RAW_COMMAND = data_type(1030, 0x217F_5C87_D7EC_951D, 35)
RPM_COMMAND = data_type(1031, 0xCE0F_9F62_1CF7_E70B, 45)
ESC_STATUS = data_type(1034, 0xA9AF_28AE_A2FB_B254, 14)
STATUS_EXTENDED = data_type(1036, 0x02DC_203C_5096_0EDC, 7)
BATTERY_INFO = data_type(1092, 0x249C_2654_8A71_1966, 54)
ARMING_STATUS = data_type(1100, 0x8700_F375_556A_8003, 1)
GET_NODE_INFO = data_type(1, 0xEE46_8A81_21C4_6A9E, 0)  # of its request, which is empty

FULL_RAW = 8191
MAX_RPM = (1 << 17) - 1
DISARMED, FULLY_ARMED = 0, 255  # values of ArmingStatus
HEALTH_OK, HEALTH_WARNING = 0, 1
MODE_OPERATIONAL = 0
BATTERY_IN_USE = 1
HEALTH_UNKNOWN_PCT = 127
UNIQUE_ID_SIZE = 16
MAX_HALF = 65504.0  # the largest float16

_RAW_BITS, _RAW_MASK = 14, 0x3FFF
_RPM_BITS = 18
_EXTENDED_BITS = (7, 7, 9, 9, 19, 5)
_STATUS = Struct("<I3e")
_NODE_STATUS = Struct("<IBH")
_VERSIONS = Struct("<BBBIQBB16sB")
_BATTERY = Struct("<7e")
_BATTERY_TAIL = Struct("<BI")


class EscStatus(NamedTuple):
    """uavcan.equipment.esc.Status: volts, amperes, kelvin, signed revolutions per minute, percent of full power."""

    error_count: int
    voltage_v: float
    current_a: float
    temperature_k: float
    rpm: int
    power_pct: int
    esc_index: int


class EscStatusExtended(NamedTuple):
    """uavcan.equipment.esc.StatusExtended: percent of full command and output; motor in °C and degrees."""

    input_pct: int
    output_pct: int
    motor_temperature_c: int
    motor_angle: int
    status_flags: int
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


class BatteryInfo(NamedTuple):
    """uavcan.equipment.power.BatteryInfo; unknown measurements are NaN."""

    voltage_v: float = 16.0
    current_a: float = 0.0
    temperature_k: float = 293.0
    average_power_w: float = 0.0  # over the last 10 s
    remaining_wh: float = 266.0
    full_wh: float = 266.0
    hours_to_full: float = 0.0
    status_flags: int = BATTERY_IN_USE
    state_of_health_pct: int = HEALTH_UNKNOWN_PCT
    state_of_charge_pct: int = 100
    state_of_charge_deviation_pct: int = 5
    battery_id: int = 0
    model_instance_id: int = 0
    model_name: str = "4S LiPo"


class Allocation(NamedTuple):
    """uavcan.protocol.dynamic_node_id.Allocation; `unique_id` may be incomplete."""

    node_id: int
    first_part: bool
    unique_id: bytes


def _half(value: float) -> float:
    """Return a value limited to the range of a float16; NaN stays NaN."""
    return -MAX_HALF if value < -MAX_HALF else MAX_HALF if value > MAX_HALF else value


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


def pack_rpm_command(rpm: list[int]) -> bytes:
    """Encode uavcan.equipment.esc.RPMCommand: signed rev/min of each motor, limited to 18 bits."""
    return _pack_fields([(min(max(value, -MAX_RPM - 1), MAX_RPM), _RPM_BITS) for value in rpm])


def unpack_rpm_command(payload: bytes) -> list[int]:
    """Return the speeds, rev/min; remaining bits of the last byte are padding."""
    return [_signed(value, _RPM_BITS) for value in _unpack_fields(payload, [_RPM_BITS] * (len(payload) * 8 // 18))]


def unpack_arming_status(payload: bytes) -> int | None:
    """Return whether motor controllers may run: DISARMED, FULLY_ARMED or a value between them."""
    return payload[0] if len(payload) == ARMING_STATUS.max_size else None


def pack_status_extended(status: EscStatusExtended) -> bytes:
    """Encode an extended ESC status; numbers are limited to the range of their fields, flags are cut."""
    percents = [min(max(value, 0), 127) for value in status[:2]]
    celsius, angle = min(max(status.motor_temperature_c, -256), 255), min(max(status.motor_angle, 0), 511)
    values = (*percents, celsius, angle, status.status_flags, status.esc_index)
    return _pack_fields(list(zip(values, _EXTENDED_BITS, strict=True)))


def unpack_status_extended(payload: bytes) -> EscStatusExtended | None:
    """Return the extended status of one motor controller; None for invalid bytes."""
    if len(payload) != STATUS_EXTENDED.max_size:
        return None
    first, second, celsius, angle, flags, index = _unpack_fields(payload, _EXTENDED_BITS)
    return EscStatusExtended(first, second, _signed(celsius, 9), angle, flags, index)


def _pack_fields(fields: list[tuple[int, int]]) -> bytes:
    """Return (value, number of bits) pairs as packed bytes; of each value the low byte comes first."""
    stream = length = 0
    for value, bits in fields:
        value &= (1 << bits) - 1
        for at in range(0, bits, 8):
            size = min(8, bits - at)
            stream = stream << size | value >> at & (1 << size) - 1
        length += bits
    return (stream << -length % 8).to_bytes((length + 7) // 8, "big")


def _unpack_fields(payload: bytes, widths: Sequence[int]) -> list[int]:
    """Return the unsigned numbers that `_pack_fields` packed; `widths` are their numbers of bits."""
    stream, left = int.from_bytes(payload, "big"), 8 * len(payload)
    values = []
    for bits in widths:
        value = 0
        for at in range(0, bits, 8):
            size = min(8, bits - at)
            left -= size
            value |= (stream >> left & (1 << size) - 1) << at
        values.append(value)
    return values


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> bits - 1 else value


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


def pack_battery_info(battery: BatteryInfo) -> bytes:
    """Encode a battery's state; percentages and flags are cut to their fields, the model's name to 31 bytes."""
    b = battery
    flags = b.status_flags & 0x7FF
    bits = (flags & 0xFF) << 24 | flags >> 8 << 21
    bits |= (b.state_of_health_pct & 127) << 14 | (b.state_of_charge_pct & 127) << 7
    bits |= b.state_of_charge_deviation_pct & 127
    watts = (b.average_power_w, b.remaining_wh, b.full_wh, b.hours_to_full)
    halves = [_half(value) for value in (b.temperature_k, b.voltage_v, b.current_a, *watts)]
    tail = _BATTERY_TAIL.pack(b.battery_id & 0xFF, b.model_instance_id & 0xFFFF_FFFF)
    return _BATTERY.pack(*halves) + bits.to_bytes(4, "big") + tail + b.model_name.encode("ascii", "replace")[:31]


def unpack_battery_info(payload: bytes) -> BatteryInfo | None:
    """Return the state of a battery."""
    if not 23 <= len(payload) <= BATTERY_INFO.max_size:
        return None
    kelvin, volts, amperes, watts, remaining, full, hours = _BATTERY.unpack_from(payload)
    bits = int.from_bytes(payload[14:18], "big")
    number, instance = _BATTERY_TAIL.unpack_from(payload, 18)
    flags = bits >> 24 | (bits >> 21 & 7) << 8
    percents = (bits >> 14 & 127, bits >> 7 & 127, bits & 127)
    name = payload[23:].decode("ascii", "replace")
    return BatteryInfo(volts, amperes, kelvin, watts, remaining, full, hours, flags, *percents, number, instance, name)


def pack_allocation(allocation: Allocation) -> bytes:
    """Encode a request for a node number, or an allocator's answer."""
    return bytes((allocation.node_id << 1 | allocation.first_part,)) + allocation.unique_id


def unpack_allocation(payload: bytes) -> Allocation | None:
    """Return a request for a node number, or an allocator's answer."""
    if not 0 < len(payload) <= ALLOCATION.max_size:
        return None
    return Allocation(payload[0] >> 1, bool(payload[0] & 1), payload[1:])

"""Encoder and decoder of SERVO_OUTPUT_RAW without pymavlink.

pymavlink takes three to six times as long, and every command and report is such a message.
"""

from collections.abc import Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

_MESSAGE = dialect.MAVLink_servo_output_raw_message
ID_BYTES: bytes = _MESSAGE.id.to_bytes(3, "little")  # bytes 7 to 9 of a packet
_PAYLOAD = _MESSAGE.unpacker  # time_usec, servo1_raw to servo8_raw, port, servo9_raw to servo16_raw
MARKER = b"\xfd"
HEADER_SIZE = 10
_CRC_EXTRA: bytes = bytes([_MESSAGE.crc_extra])


class ServoOutputRaw(NamedTuple):
    """A received SERVO_OUTPUT_RAW, with the sender's ids like a message of pymavlink."""

    time_usec: int  # on the sender's clock, wraps
    pulses: tuple[int, ...]  # us, 16; 0 is no pulse
    port: int
    number: int  # sequence number of its packet
    system: int
    component: int

    def get_msgId(self) -> int:  # noqa: N802  # pymavlink's name
        """Return the id of SERVO_OUTPUT_RAW."""
        return int(_MESSAGE.id)

    def get_seq(self) -> int:
        """Return the packet's sequence number, 0 to 255."""
        return self.number

    def get_srcSystem(self) -> int:  # noqa: N802  # pymavlink's name
        """Return the system that sent it."""
        return self.system

    def get_srcComponent(self) -> int:  # noqa: N802  # pymavlink's name
        """Return the component that sent it."""
        return self.component


def encode(time_usec: int, port: int, pulses: Sequence[int], number: int, system: int, component: int) -> bytes:
    """Return the unsigned packet with 16 pulse widths (us), byte for byte as pymavlink encodes it."""
    payload: bytes = _PAYLOAD.pack(time_usec, *pulses[:8], port, *pulses[8:]).rstrip(b"\0") or b"\0"
    checked = bytes((len(payload), 0, 0, number, system, component)) + ID_BYTES + payload
    crc: int = dialect.x25crc(checked + _CRC_EXTRA).crc
    return MARKER + checked + crc.to_bytes(2, "little")


def decode(packet: bytes) -> ServoOutputRaw:
    """Return the content of a valid packet; cut zeros at the end are restored, newer extension fields ignored."""
    payload = packet[HEADER_SIZE : HEADER_SIZE + packet[1]].ljust(_PAYLOAD.size, b"\0")
    fields = _PAYLOAD.unpack_from(payload)
    return ServoOutputRaw(fields[0], fields[1:9] + fields[10:], fields[9], packet[4], packet[5], packet[6])

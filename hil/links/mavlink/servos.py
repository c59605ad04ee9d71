"""SERVO_OUTPUT_RAW without pymavlink, which takes three to six times as long: it is every command and every report."""

from collections.abc import Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

_MESSAGE = dialect.MAVLink_servo_output_raw_message
ID_BYTES: bytes = _MESSAGE.id.to_bytes(3, "little")  # as they stand in a packet from its byte 7 on
_PAYLOAD = _MESSAGE.unpacker  # time_usec, servo1_raw to servo8_raw, port, servo9_raw to servo16_raw
MARKER = b"\xfd"
HEADER_SIZE = 10
_CRC_EXTRA: bytes = bytes([_MESSAGE.crc_extra])


class ServoOutputRaw(NamedTuple):
    """One that has come. Whose it is, it tells as pymavlink's messages do."""

    time_usec: int  # on the sender's clock, wraps
    pulses: tuple[int, ...]  # us, 16; 0 is no pulse
    port: int
    number: int  # of its packet
    system: int
    component: int

    def get_msgId(self) -> int:  # noqa: N802  # pymavlink's name
        """Always that of SERVO_OUTPUT_RAW."""
        return int(_MESSAGE.id)

    def get_seq(self) -> int:
        """The packet's number, 0 to 255."""
        return self.number

    def get_srcSystem(self) -> int:  # noqa: N802  # pymavlink's name
        """Who sent it."""
        return self.system

    def get_srcComponent(self) -> int:  # noqa: N802  # pymavlink's name
        """Which part of who sent it."""
        return self.component


def encode(time_usec: int, port: int, pulses: Sequence[int], number: int, system: int, component: int) -> bytes:
    """The unsigned packet of 16 pulses (us); byte for byte what pymavlink makes of them."""
    payload: bytes = _PAYLOAD.pack(time_usec, *pulses[:8], port, *pulses[8:]).rstrip(b"\0") or b"\0"
    checked = bytes((len(payload), 0, 0, number, system, component)) + ID_BYTES + payload
    crc: int = dialect.x25crc(checked + _CRC_EXTRA).crc
    return MARKER + checked + crc.to_bytes(2, "little")


def decode(packet: bytes) -> ServoOutputRaw:
    """What a sound packet says. Zeros at the end of the payload may be missing, and what is beyond it is newer."""
    payload = packet[HEADER_SIZE : HEADER_SIZE + packet[1]].ljust(_PAYLOAD.size, b"\0")
    fields = _PAYLOAD.unpack_from(payload)
    return ServoOutputRaw(fields[0], fields[1:9] + fields[10:], fields[9], packet[4], packet[5], packet[6])

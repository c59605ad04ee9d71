"""Records of a frame file, and its keys. `rules.py` validates them, `protocol.py` uses them.

    sync | header | the message's fields | checksum | tail          and around it all, perhaps, byte stuffing

    byte_order = "little"                    of all numbers, or "big"
    sync = [0xA5, 0x5A]                      the first bytes of every frame; may be left out where there is stuffing
    tail = [0x0D]                            the last bytes of every frame, behind the checksum; usually none
    header = [ ... ]                         the first fields of both messages
    [checksum]                               its type and what it covers: `ChecksumRule`
    [stuffing]                               cobs, slip or hdlc: `Stuffing`
    [command], [telemetry]                   the two messages: `id`, `fields`, `interleaved`
    [[other]]                                messages without thrusters: keep-alives, polls, acknowledgements

A field is one row of a byte table, `{ name = "sequence", type = "u16" }`:

    id             the `id` of the message, in the header. Without one, messages are distinguished by
                   their lengths and constants, or if those are alike, by the end that receives them
    length         in the header: number of bytes from the header to the checksum; in a message: from this
                   field to the checksum; plus `adds`
    count          the number of thrusters, plus `adds`
    sequence, flags (with `bits`), age_us, frames, errors, watchdog_trips     as in `hil.links.contract`
    pwm_us         the thrusters, one number each
    pad            sent as 0, ignored when received
    any name       with `value`: a constant, sent and expected. With `extra = true`: another field, ignored
                   when received, sent as `value` or 0; with `per_channel`, one number for each thruster

A field that a message lacks reads as 0, `armed` as true. Without an `armed` bit, a command that is not armed carries
neutral pulse widths. Numbers on the wire may be scaled: quantity = number * scale + offset. The quantity of `age_us` is
microseconds; that of `pwm_us` depends on its `unit`:

    "us"           the pulse width itself, microseconds
    "normalised"   pulse width = 1500 us + 400 us * quantity / full_scale; default full_scale 1
    "rpm", "N"     the same, with the value at 1900 us as full_scale. This is linear: the thruster's own
                   characteristic is not included
"""

import struct
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range
from hil.links.contract import MAX_THRUSTERS, PWM_NEUTRAL_US

TYPES = {"u8": "B", "u16": "H", "u32": "I", "i8": "b", "i16": "h", "i32": "i", "f32": "f"}
BYTE_ORDERS = {"little": "<", "big": ">"}
UNITS = ("us", "normalised", "rpm", "N")
PULSE_SPAN_US = 400.0  # from stop to full thrust
SIZES = {name: struct.calcsize("=" + code) for name, code in TYPES.items()}  # bytes
FLOAT_MAX = 3.4028234663852886e38

Bit = Annotated[int, Range(0, 31)]
Byte = Annotated[int, Range(0, 255)]
Factor = Annotated[float, Range(-1e9, 1e9)]
Order = Literal["little", "big"]


class Bits(NamedTuple):
    """Bits of the `flags` field; bit 0 is the lowest."""

    armed: Bit | None = None
    timed_out: Bit | None = None


class Field(NamedTuple):
    """One row of a byte table: a number, its type and its meaning."""

    name: str
    type: Literal["u8", "u16", "u32", "i8", "i16", "i32", "f32"] = "u8"
    bits: Bits = Bits()  # for `flags`
    channels: Annotated[int, Range(0, MAX_THRUSTERS)] = 0  # for `pwm_us`; 0: given by a length or a count
    adds: Annotated[int, Range(-64, 64)] = 0  # for `length` and `count`: added to the number of bytes or thrusters
    unit: str = ""  # for `pwm_us`, see above; for an extra field, as information
    scale: Factor = 1.0
    offset: Factor = 0.0
    full_scale: Annotated[float, Range(1e-6, 1e6)] | None = None
    value: Annotated[int, Range(-(2**31), 2**32 - 1)] | None = None
    extra: bool = False
    per_channel: bool = False  # for an extra field

    @property
    def is_list(self) -> bool:
        """True if the field holds one number a thruster."""
        return self.per_channel or self.name == "pwm_us"

    @property
    def line(self) -> tuple[float, float]:
        """Gain and bias: quantity = gain * number + bias; the quantity of `pwm_us` is the pulse width in us."""
        if self.name != "pwm_us" or self.unit in ("", "us"):
            return self.scale, self.offset
        us = PULSE_SPAN_US / (self.full_scale or 1.0)
        return self.scale * us, self.offset * us + PWM_NEUTRAL_US


class MessageLayout(NamedTuple):
    """One kind of message. `interleaved`: adjacent lists alternate, thruster by thruster."""

    fields: tuple[Field, ...]
    id: Annotated[int, Range(0, 2**32 - 1)] | None = None
    interleaved: bool = False


class Other(NamedTuple):
    """A message without thrusters. It is ignored when received. With a `period` (s) the end `sent_by` sends it.

    It is sent when that end has sent nothing else for the period, or, with `when_silent` false, every period.
    """

    fields: tuple[Field, ...] = ()
    id: Annotated[int, Range(0, 2**32 - 1)] | None = None
    name: str = "other"
    sent_by: Literal["host", "device", "both"] = "both"
    period: Annotated[float, Range(0.001, 3600.0, "s")] | None = None
    when_silent: bool = True


class ChecksumRule(NamedTuple):
    """The checksum: its type, what it covers, and its own byte order if it differs from the frame's.

    `type` is a name in `hil.links.frame.checksums`; the other CRC parameters replace those of that name. The checksum
    covers the bytes from `start` (the sync, the header, a field of the header, or the payload) up to itself, without
    the last `omit_last` bytes. It is computed before stuffing.
    """

    type: str = "crc16-ccitt-false"
    start: str = "header"  # "sync", "header", "payload", or the name of a field of the header
    omit_last: Annotated[int, Range(0, 64)] = 0
    byte_order: Order | None = None
    polynomial: Annotated[int, Range(0, 2**32 - 1)] | None = None
    start_value: Annotated[int, Range(0, 2**32 - 1)] | None = None
    reflected: bool | None = None
    final_xor: Annotated[int, Range(0, 2**32 - 1)] | None = None


class Stuffing(NamedTuple):
    """Byte stuffing: it keeps the byte that delimits frames out of them.

    "cobs" (Cheshire and Baker 1999) delimits by 0; "slip" is RFC 1055; "hdlc" (RFC 1662) escapes `delimiter`, `escape`
    and the bytes in `also`: each is sent as `escape`, then itself xor `xor`. `delimit` "both": a delimiter also before
    the frame, which ends any noise before it.
    """

    type: Literal["none", "cobs", "slip", "hdlc"] = "none"
    delimit: Literal["end", "both"] = "end"
    delimiter: Byte = 0x7E
    escape: Byte = 0x7D
    xor: Byte = 0x20
    also: tuple[Byte, ...] = ()


class FrameLayout(NamedTuple):
    """A frame file."""

    byte_order: Order
    command: MessageLayout
    telemetry: MessageLayout
    header: tuple[Field, ...] = ()
    sync: tuple[Byte, ...] = ()
    tail: tuple[Byte, ...] = ()
    checksum: ChecksumRule = ChecksumRule()
    stuffing: Stuffing = Stuffing()
    other: tuple[Other, ...] = ()

    @property
    def payload_start(self) -> int:
        """Number of bytes before the payload: sync and header."""
        return len(self.sync) + sum(type_size(field.type) for field in self.header)

    @property
    def checksum_start(self) -> int:
        """Offset in the frame of the first byte that the checksum covers."""
        offset, start = len(self.sync), self.checksum.start
        if start in ("sync", "payload"):
            return 0 if start == "sync" else self.payload_start
        for field in self.header:
            if start in ("header", field.name):
                break
            offset += type_size(field.type)
        return offset

    @property
    def sequence_bits(self) -> int:
        """Number of bits of the sequence number that both command and report carry."""
        rows = [(*self.header, *message.fields) for message in (self.command, self.telemetry)]
        return min(sum(8 * SIZES[field.type] for field in row if field.name == "sequence") for row in rows)


def type_size(type_name: str) -> int:
    """Return the size in bytes of a number of that type."""
    return SIZES[type_name]


def limits(type_name: str) -> tuple[float, float]:
    """Return the minimum and maximum of a type; ints, floats for f32."""
    if type_name == "f32":
        return -FLOAT_MAX, FLOAT_MAX
    span = 1 << (8 * type_size(type_name))
    return (0, span - 1) if type_name.startswith("u") else (-span // 2, span // 2 - 1)


def unrolled(fields: tuple[Field, ...], channels: int, interleaved: bool = False) -> Iterator[tuple[Field, int]]:
    """Yield the numbers of a message in their order on the wire: field, and index in its list."""
    offset = 0
    while offset < len(fields):
        end = offset + 1
        while interleaved and end < len(fields) and fields[offset].is_list and fields[end].is_list:
            end += 1
        for channel in range(channels if fields[offset].is_list else 1):
            yield from ((field, channel) for field in fields[offset:end])
        offset = end


def fields_size(fields: tuple[Field, ...], channels: int) -> int:
    """Return the size in bytes of these fields for this number of thrusters."""
    single = lists = 0
    for field in fields:
        if field.is_list:
            lists += SIZES[field.type]
        else:
            single += SIZES[field.type]
    return single + lists * channels

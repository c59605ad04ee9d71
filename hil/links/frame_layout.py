"""The schema of a frame file, and what cannot be meant by one. `frame.py` puts it to work."""

import struct
from typing import Annotated, Literal, NamedTuple

from hil.links.contract import MAX_THRUSTERS
from hil.schema import Range

TYPES = {"u8": "B", "u16": "H", "u32": "I", "i8": "b", "i16": "h", "i32": "i"}
SATURATING = ("pwm_us", "age_us")  # the other numbers are counters, and wrap

COMMON_FIELDS = ("sequence", "flags", "count", "pwm_us", "pad")
TELEMETRY_FIELDS = (*COMMON_FIELDS, "age_us", "frames", "errors", "watchdog_trips")

Bit = Annotated[int, Range(0, 31)]
Byte = Annotated[int, Range(0, 255)]
Order = Literal["little", "big"]


class Bits(NamedTuple):
    """Which bit of the `flags` field is what; bit 0 is the lowest. A message without a bit is armed."""

    armed: Bit | None = None
    timed_out: Bit | None = None


class Field(NamedTuple):
    """One row of a byte table: a number of a message, where it stands."""

    name: Literal[
        "length", "id", "sequence", "flags", "count", "pwm_us", "pad",
        "age_us", "frames", "errors", "watchdog_trips",
    ]  # fmt: skip
    type: Literal["u8", "u16", "u32", "i8", "i16", "i32"] = "u8"
    bits: Bits = Bits()
    channels: Annotated[int, Range(0, MAX_THRUSTERS)] = 0  # of `pwm_us`; 0: the length says how many


class MessageLayout(NamedTuple):
    """The payload of one kind of message, and the id that marks it."""

    id: Annotated[int, Range(0, 65535)]
    fields: tuple[Field, ...]


class Crc(NamedTuple):
    """The checksum that ends a frame: its kind, where the bytes it covers begin, and its own byte order."""

    type: Literal["crc16-ccitt-false"] = "crc16-ccitt-false"
    start: Literal["sync", "header", "payload"] = "header"
    byte_order: Order | None = None


class FrameLayout(NamedTuple):
    """A frame file. `length_adds`: what the length field counts beyond the bytes of the payload."""

    byte_order: Order
    sync: tuple[Byte, ...]
    header: tuple[Field, ...]
    command: MessageLayout
    telemetry: MessageLayout
    crc: Crc = Crc()
    length_adds: Annotated[int, Range(0, 64)] = 0

    def problem(self) -> str | None:
        """What makes the file impossible, or None."""
        header = [field.name for field in self.header]
        if not self.sync:
            return "sync: needs at least one byte"
        if sorted(header) not in (["id"], ["id", "length"]):
            return "header: needs one 'id', may have one 'length', and nothing else"
        if self.command.id == self.telemetry.id:
            return "command and telemetry have the same id"
        return (
            _payload_problem(self.command.fields, "command", COMMON_FIELDS, "length" in header)
            or _payload_problem(self.telemetry.fields, "telemetry", TELEMETRY_FIELDS, "length" in header)
            or self._header_problem()
        )

    def _header_problem(self) -> str | None:
        sizes = [_payload_size(message.fields) for message in (self.command, self.telemetry)]
        needed = {"id": max(self.command.id, self.telemetry.id), "length": max(sizes) + self.length_adds}
        for field in self.header:
            if needed[field.name] > _limits(field.type)[1]:
                return f"header: {field.name} must hold {needed[field.name]}, which {field.type} cannot"
        return None


def _payload_problem(fields: tuple[Field, ...], message: str, known: tuple[str, ...], has_length: bool) -> str | None:
    names: list[str] = [field.name for field in fields if field.name != "pad"]
    for field in fields:
        if field.name not in known:
            return f"{message}: {field.name!r} cannot be in it; there are: {', '.join(known)}"
        if names.count(field.name) > 1:
            return f"{message}: {field.name!r} stands there twice"
        bits = [bit for bit in field.bits if bit is not None]
        if bits and (field.name != "flags" or max(bits) >= 8 * _size(field.type)):
            return f"{message}: {field.name} of type {field.type} cannot have these bits"
        if field.channels and field.name != "pwm_us":
            return f"{message}: only pwm_us has channels, {field.name!r} has not"
        if field.name == "pwm_us" and not field.channels and not has_length:
            return f"{message}: pwm_us needs its number of channels, as the header has no length"
    return None if "pwm_us" in names else f"{message}: has no pwm_us"


def _size(type_name: str) -> int:
    return struct.calcsize("=" + TYPES[type_name])


def _payload_size(fields: tuple[Field, ...]) -> int:
    """The bytes of a payload with as many channels as it can have."""
    return sum(_size(f.type) * ((f.channels or MAX_THRUSTERS) if f.name == "pwm_us" else 1) for f in fields)


def _limits(type_name: str) -> tuple[int, int]:
    """The least and the greatest number that a type holds."""
    span = 1 << (8 * _size(type_name))
    return (0, span - 1) if type_name.startswith("u") else (-span // 2, span // 2 - 1)


def fit(value: int, field: Field) -> int:
    """`value` as its field can carry it: pulse widths and ages stop at the limit, counters wrap."""
    low, high = _limits(field.type)
    if field.name in SATURATING:
        return min(max(value, low), high)
    return (value - low) % (high - low + 1) + low

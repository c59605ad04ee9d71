"""Thruster messages as a binary frame that a TOML file describes; no lab's frame needs code.

    sync | header: length and id, in either order | payload: the message's fields | checksum

The file is read once and compiled to `struct` tables. As length and id follow from the kind of message
and its number of channels, a frame of ours begins with one of a few known byte strings: finding it is a
dictionary look-up.

Receiving is built for a noisy line. A sound frame is delivered as soon as its last byte is there,
whatever came before: neither a cut frame nor a damaged length holds back the frame behind it. What is
not understood is counted, and at most one frame is ever kept back.
"""

import struct
from binascii import crc_hqx  # with 0xFFFF to start from: CRC-16/CCITT-FALSE (CRC-16/IBM-3740)
from typing import Any, NamedTuple

from hil.errors import ConfigError
from hil.links.contract import MAX_THRUSTERS, Counters, Message, Protocol, ThrusterCommand, ThrusterTelemetry
from hil.links.frame_layout import TYPES, Field, FrameLayout, MessageLayout, fit
from hil.links.protocols import Role
from hil.schema import find_preset, load

ORDERS = {"little": "<", "big": ">"}
CRC_START = 0xFFFF
CRC_SIZE = 2
MAX_FOREIGN_PAYLOAD = 255  # bytes; a longer frame of an unknown message is taken for noise


class _Payload:
    """A kind of message as the numbers of its payload, and back."""

    def __init__(self, kind: type[ThrusterCommand] | type[ThrusterTelemetry], fields: tuple[Field, ...]) -> None:
        names = [field.name for field in fields]
        first = names.index("pwm_us")
        self._kind, self._fields, self._first = kind, fields, first
        self._before, self._after = names[:first], names[first + 1 :]
        bits = fields[names.index("flags")].bits._asdict() if "flags" in names else {}
        self._masks = [(name, 1 << bit) for name, bit in bits.items() if bit is not None and name in kind._fields]
        # what a frame without such a field says
        self._absent: dict[str, Any] = dict.fromkeys((*kind._fields, "flags"), 0) | {"armed": True, "timed_out": False}
        only = fields[first].channels
        self.channels = range(only, only + 1) if only else range(1, MAX_THRUSTERS + 1)

    def code(self, channels: int) -> str:
        """The `struct` code of a payload with so many channels."""
        return "".join(TYPES[f.type] * (channels if f.name == "pwm_us" else 1) for f in self._fields)

    def numbers(self, message: Message) -> list[int]:
        values: dict[str, Any] = message._asdict()
        values["flags"] = sum([mask for name, mask in self._masks if values[name]])
        values["count"] = len(message.pwm_us)
        values["pad"] = 0
        return [*[values[n] for n in self._before], *message.pwm_us, *[values[n] for n in self._after]]

    def fitted(self, numbers: list[int]) -> list[int]:
        """`numbers`, each wrapped or clamped to the type of its field."""
        first, last = self._first, len(numbers) - len(self._after)
        fields = self._fields[:first] + (self._fields[first],) * (last - first) + self._fields[first + 1 :]
        return [fit(value, field) for value, field in zip(numbers, fields, strict=True)]

    def message(self, numbers: tuple[int, ...], channels: int) -> Message | None:
        """The message, or None if it contradicts itself about its number of channels."""
        first, last = self._first, self._first + channels
        values = self._absent.copy()
        values.update(zip(self._before, numbers, strict=False))
        values.update(zip(self._after, numbers[last:], strict=True))
        if values.get("count", channels) != channels:
            return None
        for name, mask in self._masks:
            values[name] = values["flags"] & mask != 0
        values["pwm_us"] = numbers[first:last]
        return self._kind(*[values[name] for name in self._kind._fields])


class _Variant(NamedTuple):
    """A kind of message with a given number of channels: all that is then constant in its frame."""

    payload: _Payload
    channels: int
    prefix: bytes  # sync and header
    crc: int  # of what the checksum covers of the prefix
    packer: struct.Struct  # of the payload
    size: int  # of the frame, bytes


class FrameProtocol(Protocol):
    """Encodes and decodes the frame that the TOML file at `path` describes.

    `channels` are the numbers of thrusters that the frame can carry. Raises ConfigError naming the file
    and the key if the file is wrong.
    """

    def __init__(self, path: str) -> None:
        layout = load(path, FrameLayout)
        self.counters = Counters()
        self._layout = layout
        self._order = ORDERS[layout.byte_order]
        self._sync = bytes(layout.sync)
        self._header = struct.Struct(self._order + "".join(TYPES[field.type] for field in layout.header))
        self._prefix_size = len(self._sync) + self._header.size
        self._crc = struct.Struct(ORDERS[layout.crc.byte_order or layout.byte_order] + "H")
        self._crc_from = {"sync": 0, "header": len(self._sync), "payload": self._prefix_size}[layout.crc.start]
        self._to_send: dict[tuple[type[Message], int], _Variant] = {}
        self._by_prefix: dict[bytes, _Variant] = {}
        commands = self._compile(ThrusterCommand, layout.command)
        reports = self._compile(ThrusterTelemetry, layout.telemetry)
        self.channels = [count for count in commands.channels if count in reports.channels]
        if not self.channels:
            raise ConfigError(f"{path}: command and telemetry never have the same number of channels")
        self._rest = b""  # the beginning of a frame whose end has not come

    def encode(self, message: Message) -> bytes:
        """The frame of `message`.

        A number too big for its field wraps if it is a counter, and stops at the field's limit if it is
        a pulse width or an age. Raises ValueError for a number of channels that the frame cannot carry.
        """
        variant = self._to_send.get((type(message), len(message.pwm_us)))
        if variant is None:
            raise ValueError(f"this frame carries {self.channels} channels, not {len(message.pwm_us)}")
        numbers = variant.payload.numbers(message)
        try:
            payload = variant.packer.pack(*numbers)
        except struct.error:
            payload = variant.packer.pack(*variant.payload.fitted(numbers))
        return variant.prefix + payload + self._crc.pack(crc_hqx(payload, variant.crc))

    def feed(self, data: bytes) -> list[Message]:
        """The messages completed by `data`, in order. Never raises.

        Every byte ends up in a message, in a sound frame that is counted as malformed, in
        `dropped_bytes`, or in the unfinished frame that is kept.
        """
        buffer = self._rest + data
        counters = self.counters
        messages: list[Message] = []
        position = 0
        while (start := self._find_sync(buffer, position)) < len(buffer):
            size = self._size_at(buffer, start)
            if start + size > len(buffer):
                behind = self._find_sound(buffer, start + 1)
                if behind < 0:
                    break
                start, size = behind, self._size_at(buffer, behind)
            counters.dropped_bytes += start - position
            if size and self._is_sound(buffer, start, size):
                self._take(buffer, start, messages)
                position = start + size
            else:
                counters.checksum_errors += size > 0
                counters.dropped_bytes += 1
                position = start + 1  # not past it all: a frame may begin inside a damaged one
        counters.dropped_bytes += start - position
        self._rest = buffer[start:]
        return messages

    def _compile(self, kind: type[ThrusterCommand] | type[ThrusterTelemetry], layout: MessageLayout) -> _Payload:
        payload = _Payload(kind, layout.fields)
        for count in payload.channels:
            packer = struct.Struct(self._order + payload.code(count))
            numbers = {"id": layout.id, "length": packer.size + self._layout.length_adds}
            prefix = self._sync + self._header.pack(*[numbers[field.name] for field in self._layout.header])
            crc = crc_hqx(prefix[self._crc_from :], CRC_START)
            variant = _Variant(payload, count, prefix, crc, packer, len(prefix) + packer.size + CRC_SIZE)
            self._to_send[kind, count] = self._by_prefix[prefix] = variant
        return payload

    def _find_sync(self, buffer: bytes, position: int) -> int:
        """Where the next frame may begin: at a sync, or at a part of one that ends the buffer."""
        sync = self._sync
        found = buffer.find(sync, position)
        if found >= 0:
            return found
        for start in range(max(position, len(buffer) - len(sync) + 1), len(buffer)):
            if sync.startswith(buffer[start:]):
                return start
        return len(buffer)

    def _size_at(self, buffer: bytes, start: int) -> int:
        """The size of the frame that begins at `start`, as far as can be seen; 0: none begins there."""
        prefix = buffer[start : start + self._prefix_size]
        variant = self._by_prefix.get(prefix)
        if variant:
            return variant.size
        if len(prefix) < self._prefix_size:
            return self._prefix_size
        header = zip(self._layout.header, self._header.unpack_from(prefix, len(self._sync)), strict=True)
        for field, value in header:
            if field.name == "length" and 0 <= value - self._layout.length_adds <= MAX_FOREIGN_PAYLOAD:
                return self._prefix_size + int(value) - self._layout.length_adds + CRC_SIZE
        return 0

    def _is_sound(self, buffer: bytes, start: int, size: int) -> bool:
        end = start + size - CRC_SIZE
        wanted: int = self._crc.unpack_from(buffer, end)[0]
        return crc_hqx(buffer[start + self._crc_from : end], CRC_START) == wanted

    def _find_sound(self, buffer: bytes, position: int) -> int:
        """Where the first whole sound frame begins, or -1: one behind a cut frame need not wait for its end."""
        while (start := self._find_sync(buffer, position)) < len(buffer):
            size = self._size_at(buffer, start)
            if size and start + size <= len(buffer) and self._is_sound(buffer, start, size):
                return start
            position = start + 1
        return -1

    def _take(self, buffer: bytes, start: int, messages: list[Message]) -> None:
        prefix = buffer[start : start + self._prefix_size]
        variant = self._by_prefix.get(prefix)
        message = None
        if variant:
            numbers = variant.packer.unpack_from(buffer, start + self._prefix_size)
            message = variant.payload.message(numbers, variant.channels)
        if message is None:
            self.counters.malformed += 1
        else:
            messages.append(message)


def open_frame(role: Role, channels: int, frame: str = "uuv_hil") -> FrameProtocol:
    """The protocol of the frame of that name, or of the TOML file of that path; it is the same at both ends.

    Raises ConfigError if the frame cannot carry so many thrusters.
    """
    protocol = FrameProtocol(find_preset("firmware_stub/frames", frame))
    if channels not in protocol.channels:
        carried = " to ".join(map(str, sorted({protocol.channels[0], protocol.channels[-1]})))
        raise ConfigError(f"frame {frame} carries {carried} thrusters, not {channels}")
    return protocol

"""A compiled frame file: for each message and number of thrusters a `Form` with all its constants."""

import struct

from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.frame.bodies import Body, Kind, numbers_of
from hil.links.frame.checksums import CRCS, SUMS, Checksum, crc_checksum
from hil.links.frame.layout import (
    BYTE_ORDERS,
    TYPES,
    ChecksumRule,
    FrameLayout,
    MessageLayout,
    Other,
    fields_size,
    type_size,
)

NAMES: dict[Kind | None, str] = {ThrusterCommand: "command", ThrusterTelemetry: "telemetry"}


class Trailer:
    """The end of a frame: its checksum and the constant bytes after it, together `size` bytes."""

    def __init__(self, layout: FrameLayout) -> None:
        rule = layout.checksum
        checksum = checksum_of(rule)
        self.update, self.empty = checksum.update, checksum.empty
        self.stored = struct.Struct(BYTE_ORDERS[rule.byte_order or layout.byte_order] + "BHxI"[checksum.size - 1])
        self.start, self.omit_last = layout.checksum_start, rule.omit_last
        self.tail = bytes(layout.tail)
        self.size = checksum.size + len(self.tail)

    def is_sound(self, buffer: bytes, start: int, size: int) -> bool:
        """Return whether the `size` bytes from `start` end with the right checksum and tail."""
        end = start + size - self.size
        checksum = self.update(buffer[start + self.start : end - self.omit_last], self.empty)
        return buffer.startswith(self.stored.pack(checksum) + self.tail, end)


class Form:
    """One kind of message for `channels` thrusters. With `kind` None it carries no thrusters and is ignored.

    `size` is the size of the whole frame before stuffing. `head` has all bytes before the first list of numbers, None
    for those that vary; `prefix` has the bytes before the first one that varies.
    """

    def __init__(
        self, layout: FrameLayout, message: MessageLayout | Other, kind: Kind | None, channels: int, trailer: Trailer
    ) -> None:
        self.kind, self.channels = kind, channels
        self.name = message.name if isinstance(message, Other) else NAMES[kind]
        self.head = tuple(_head(layout, message, channels))
        start = self.head.index(None) if None in self.head else len(self.head)
        self.prefix = bytes(byte or 0 for byte in self.head[:start])
        end = layout.payload_start + fields_size(message.fields, channels)
        self.size = end + trailer.size
        self.checksum = trailer.update(self.prefix[trailer.start :], trailer.empty)  # of the prefix alone
        # The rest of the bytes that the checksum covers.
        self.covered = slice(max(0, trailer.start - start), max(0, end - start - trailer.omit_last))
        self.start = start  # offset of the body
        self._made_of = (layout, message, kind, channels, start - len(layout.sync))
        self._body: Body | None = None

    @property
    def body(self) -> Body:
        """The body after the prefix; made on first use, as most numbers of thrusters are never used."""
        if self._body is None:
            self._body = Body(*self._made_of)
        return self._body


def checksum_of(rule: ChecksumRule) -> Checksum:
    """Return the checksum that a frame file specifies."""
    if rule.type in SUMS:
        return SUMS[rule.type]
    crc = CRCS[rule.type]
    own = {name: getattr(rule, name) for name in ("polynomial", "start_value", "reflected", "final_xor")}
    return crc_checksum(crc._replace(**{name: value for name, value in own.items() if value is not None}))


def _head(layout: FrameLayout, message: MessageLayout | Other, channels: int) -> list[int | None]:
    order = BYTE_ORDERS[layout.byte_order]
    head: list[int | None] = list(layout.sync)
    for field, _, value in numbers_of(layout, message, channels):
        if field.is_list:
            break
        head += [None] * type_size(field.type) if value is None else struct.pack(order + TYPES[field.type], value)
    return head

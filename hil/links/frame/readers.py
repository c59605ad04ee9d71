"""Decoders of received bytes: the part that all readers share, and the reader of frames that begin with a sync.

The reader of frames between delimiters is in `stuffing.py`. Both are made for a noisy line: a valid frame is decoded as
soon as its last byte is received, whatever came before it. Neither a cut frame nor a damaged length delays the next
frame. Bytes that cannot be decoded are counted, and at most one incomplete frame is stored.
"""

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterable
from operator import and_

from hil.common.errors import ConfigError
from hil.links.contract import Counters, Message
from hil.links.frame.forms import Form, Trailer
from hil.links.frame.layout import BYTE_ORDERS, TYPES, FrameLayout, type_size
from hil.links.search import find_frames

MAX_FOREIGN_PAYLOAD = 255  # bytes; a longer frame of an unknown message counts as noise


class Reader(ABC):
    """Decode the frames of one end; `unfinished` is the start of a frame whose end was not received yet."""

    def __init__(self, trailer: Trailer, counters: Counters) -> None:
        self.unfinished = b""
        self.trailer, self.counters = trailer, counters

    @abstractmethod
    def feed(self, data: bytes) -> list[Message]:
        """Return the messages completed by `data`, in order. Never raises.

        Every byte belongs to one of: a message, a valid frame that is ignored or counted as malformed, `dropped_bytes`,
        `unfinished`, or a delimiter.
        """

    @abstractmethod
    def unwrapped(self, data: bytes) -> bytes | None:
        """Return the frame in these bytes of the wire, without stuffing and delimiters; None if they are damaged."""

    @abstractmethod
    def form_of(self, frame: bytes) -> Form | None:
        """Return the form of a frame; None if the message is unknown."""

    def read_frame(self, form: Form | None, frame: bytes, start: int, messages: list[Message]) -> None:
        """Add the message of the valid frame at `start` of `frame`; `form` is None if the message is unknown."""
        if form:
            body = form.body
            numbers = body.packer.unpack_from(frame, start + form.start)
            if form.kind is None:
                if body.matches_constants(numbers):
                    return
            elif message := body.message(numbers):
                messages.append(message)
                return
        self.counters.malformed += 1


class SyncReader(Reader):
    """Find frames by their sync. Their heads are known byte strings, so this is a table look-up."""

    def __init__(self, layout: FrameLayout, forms: Iterable[Form], trailer: Trailer, counters: Counters) -> None:
        super().__init__(trailer, counters)
        self.sync = bytes(layout.sync)
        self._header_end = layout.payload_start
        self._keys = _Keys(list(forms), layout.payload_start)
        self._length = _length_field(layout)

    def feed(self, data: bytes) -> list[Message]:
        """Return the frames in `data`: see `Reader`."""
        buffer = self.unfinished + data
        messages: list[Message] = []
        form = self._keys.form_at(buffer, 0)
        if form and form.size == len(buffer) and self.trailer.is_sound(buffer, 0, form.size):  # the usual case
            self.read_frame(form, buffer, 0, messages)
            self.unfinished = b""
        else:
            self._search(buffer, messages)
        return messages

    def _search(self, buffer: bytes, messages: list[Message]) -> None:
        """Add the messages of the valid frames in `buffer`; store what may be the start of another."""
        frames, rest = find_frames(self, buffer, self.counters)
        for start, _ in frames:
            self.read_frame(self._keys.form_at(buffer, start), buffer, start, messages)
        self.unfinished = buffer[rest:]

    def frame_at(self, buffer: bytes, start: int) -> tuple[Form | None, int]:
        """Return form and size of the frame that begins at `start`, as far as known; size 0 if none begins there."""
        form = self._keys.form_at(buffer, start)
        return form, form.size if form else self._unknown_size(buffer, start)

    def size_at(self, buffer: bytes, start: int) -> int:
        """Return the size of the frame that begins at `start`, as far as known; 0 if none begins there."""
        return self.frame_at(buffer, start)[1]

    def is_sound(self, buffer: bytes, start: int, size: int) -> bool:
        """Return whether the checksum of the whole frame at `start` is right."""
        return self.trailer.is_sound(buffer, start, size)

    def unwrapped(self, data: bytes) -> bytes | None:
        """Return the bytes unchanged: there is no stuffing."""
        return data

    def form_of(self, frame: bytes) -> Form | None:
        """Return the form by the frame's first bytes."""
        return self._keys.form_at(frame, 0)

    def find_start(self, buffer: bytes, position: int) -> int:
        """Return where the next frame may begin: at a sync, or at a part of one at the end of the buffer."""
        sync = self.sync
        index = buffer.find(sync, position)
        if index >= 0:
            return index
        for start in range(max(position, len(buffer) - len(sync) + 1), len(buffer)):
            if sync.startswith(buffer[start:]):
                return start
        return len(buffer)

    def _unknown_size(self, buffer: bytes, start: int) -> int:
        """Return the size of a frame without a known form: an incomplete one, or one whose header has its length."""
        length = len(buffer) - start
        if self._length and length < self._header_end:
            return self._header_end
        if self._keys.may_begin(buffer[start : start + self._keys.longest]):
            return length + 1
        if self._length:
            offset, packer, adds = self._length
            payload: int = packer.unpack_from(buffer, start + offset)[0] - adds
            if 0 <= payload <= MAX_FOREIGN_PAYLOAD:
                return self._header_end + payload + self.trailer.size
        return 0


class _Keys:
    """Find the form of a frame by its first bytes.

    The constant bytes at the beginning are enough if they reach beyond the header and differ between all forms.
    Otherwise all constants before the first list are compared, and the bytes between them that vary are masked.
    """

    def __init__(self, forms: list[Form], header_end: int) -> None:
        prefixes = {form.prefix for form in forms}
        enough = len(prefixes) == len(forms) and all(len(form.prefix) >= header_end for form in forms)
        self._heads = [tuple(form.prefix) if enough else form.head for form in forms]
        self.longest = max(map(len, self._heads))
        tables: dict[bytes, dict[bytes, Form]] = {}
        for form, head in zip(forms, self._heads, strict=True):
            mask = bytes(0 if byte is None else 0xFF for byte in head)
            known = tables.setdefault(mask, {}).setdefault(bytes(byte or 0 for byte in head), form)
            if known is not form:
                raise ConfigError(_alike(form, known))
        self._tables = [
            (len(mask), mask if 0 in mask else b"", tables[mask]) for mask in sorted(tables, key=len, reverse=True)
        ]

    def form_at(self, buffer: bytes, start: int) -> Form | None:
        """Return the form of the frame that begins at `start`."""
        for length, mask, table in self._tables:
            head = buffer[start : start + length]
            form = table.get(bytes(map(and_, head, mask)) if mask else head)
            if form:
                return form
        return None

    def may_begin(self, data: bytes) -> bool:
        """Return whether these bytes are the start of a head, but not a whole head."""
        return any(len(data) < len(head) and matches_head(head, data) for head in self._heads)


def matches_head(head: tuple[int | None, ...], frame: bytes) -> bool:
    """Return whether the frame and the head agree over their common length."""
    return all(wanted in (None, byte) for wanted, byte in zip(head, frame, strict=False))


def _alike(form: Form, other: Form) -> str:
    if form.kind and form.kind is other.kind:
        name = form.name
        return f"{name}: pwm_us needs its number of channels, as there is no length or count before it that tells"
    return (
        f"{other.name} and {form.name} look alike: give them an id or constants that differ, or say which end this is"
    )


def _length_field(layout: FrameLayout) -> tuple[int, struct.Struct, int] | None:
    """Return the header's length field: its offset, its format, and what it counts in addition to the payload."""
    offset = len(layout.sync)
    for field in layout.header:
        if field.name == "length":
            return offset, struct.Struct(BYTE_ORDERS[layout.byte_order] + TYPES[field.type]), field.adds
        offset += type_size(field.type)
    return None

"""Byte stuffing: remove the delimiting byte from a frame, and read frames between delimiters.

Loaded only for frames that use it.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator

from hil.links.contract import Counters, Message
from hil.links.frame.forms import Form, Trailer
from hil.links.frame.layout import Stuffing
from hil.links.frame.readers import Reader, matches_head

COBS_RUN = 254  # the longest run without a zero that one code byte can encode


class Stuffer(ABC):
    """Remove the byte `delimiter` from a frame, and restore it. `opening` is sent before each frame."""

    delimiter: bytes
    opening = b""

    def wrap(self, frame: bytes) -> bytes:
        """Return the bytes on the wire for `frame`."""
        return self.opening + self.stuff(frame) + self.delimiter

    @abstractmethod
    def stuff(self, frame: bytes) -> bytes:
        """Return `frame` without a delimiter in it."""

    @abstractmethod
    def unstuff(self, piece: bytes) -> bytes | None:
        """Return the frame between two delimiters; None if it is invalid."""

    @abstractmethod
    def max_stuffed_size(self, size: int) -> int:
        """Return the largest stuffed size of a frame of `size` bytes."""

    @abstractmethod
    def frames_at_end(self, piece: bytes, size: int) -> Iterator[bytes]:
        """Yield the frames of `size` bytes that `piece` may end with; noise may come before them."""


class Cobs(Stuffer):
    """Consistent Overhead Byte Stuffing (Cheshire and Baker 1999): each zero becomes the distance to the next one."""

    delimiter = b"\0"

    def stuff(self, frame: bytes) -> bytes:
        """Return one byte more than `frame`, and another for each run of 254 without a zero."""
        out = bytearray()
        runs = frame.split(b"\0")
        for behind, run in zip(range(len(runs) - 1, -1, -1), runs, strict=True):
            while len(run) > COBS_RUN or (len(run) == COBS_RUN and behind):
                out += b"\xff" + run[:COBS_RUN]
                run = run[COBS_RUN:]
            out.append(len(run) + 1)
            out += run
        return bytes(out)

    def unstuff(self, piece: bytes) -> bytes | None:
        """Return the frame; None if a code byte points beyond the end."""
        out = bytearray()
        position, end = 0, len(piece)
        while position < end:
            code = piece[position]
            out += piece[position + 1 : position + code]
            position += code
            if position < end and code <= COBS_RUN:
                out.append(0)
        return bytes(out) if position == end else None

    def max_stuffed_size(self, size: int) -> int:
        """Return the size with one code byte for each run."""
        return size + 1 + size // COBS_RUN

    def frames_at_end(self, piece: bytes, size: int) -> Iterator[bytes]:
        """Yield the few frames that are possible."""
        for length in range(size + 1, min(self.max_stuffed_size(size), len(piece)) + 1):
            frame = self.unstuff(piece[-length:])
            if frame is not None and len(frame) == size:
                yield frame


class Escapes(Stuffer):
    """Escaping: each byte that must not occur becomes an escape byte and a substitute (SLIP, HDLC)."""

    def __init__(self, delimiter: int, escape: int, substitutes: dict[int, int]) -> None:
        self.delimiter = bytes([delimiter])
        # The escape byte itself is replaced first and restored last.
        order = sorted(substitutes, key=lambda byte: byte != escape)
        self._pairs = [(bytes([byte]), bytes([escape, substitutes[byte]])) for byte in order]

    def stuff(self, frame: bytes) -> bytes:
        """Return the escaped frame, at most twice as long."""
        for byte, pair in self._pairs:
            frame = frame.replace(byte, pair)
        return frame

    def unstuff(self, piece: bytes) -> bytes | None:
        """Return the frame; an escape byte before anything but a substitute stays unchanged."""
        for byte, pair in reversed(self._pairs):
            piece = piece.replace(pair, byte)
        return piece

    def max_stuffed_size(self, size: int) -> int:
        """Return the size with every byte escaped."""
        return 2 * size

    def frames_at_end(self, piece: bytes, size: int) -> Iterator[bytes]:
        """Yield the last `size` bytes, unescaped."""
        frame = self.unstuff(piece)
        if frame is not None and len(frame) >= size:
            yield frame[-size:]


class StuffedReader(Reader):
    """Find frames between delimiters, and by their known sizes after noise without a delimiter."""

    def __init__(self, stuffer: Stuffer, forms: Iterable[Form], trailer: Trailer, counters: Counters) -> None:
        super().__init__(trailer, counters)
        self._stuffer = stuffer
        self._by_size: dict[int, list[Form]] = {}
        for form in forms:
            self._by_size.setdefault(form.size, []).append(form)
        self._longest = stuffer.max_stuffed_size(max(self._by_size))

    def feed(self, data: bytes) -> list[Message]:
        """Return the frames in `data`: see `Reader`."""
        messages: list[Message] = []
        *pieces, remainder = (self.unfinished + data).split(self._stuffer.delimiter)
        for piece in pieces:
            if piece:
                self._read(piece, messages)
        surplus = max(0, len(remainder) - self._longest)
        self.counters.dropped_bytes += surplus
        self.unfinished = remainder[surplus:]
        return messages

    def unwrapped(self, data: bytes) -> bytes | None:
        """Return the frame in these bytes, with or without delimiters."""
        return self._stuffer.unstuff(data.strip(self._stuffer.delimiter))

    def form_of(self, frame: bytes) -> Form | None:
        """Return the form by size and first bytes."""
        for form in self._by_size.get(len(frame), ()):
            if matches_head(form.head, frame):
                return form
        return None

    def _read(self, piece: bytes, messages: list[Message]) -> None:
        frame = self._stuffer.unstuff(piece)
        if frame is None or len(frame) <= self.trailer.size or not self.trailer.is_sound(frame, 0, len(frame)):
            known = self._at_end(piece)
            self.counters.checksum_errors += known is None and frame is not None and len(frame) > self.trailer.size
            self.counters.dropped_bytes += max(0, len(piece) - (len(self._stuffer.stuff(known)) if known else 0))
            if known is None:
                return
            frame = known
        self.read_frame(self.form_of(frame), frame, 0, messages)

    def _at_end(self, piece: bytes) -> bytes | None:
        """Return the known valid frame that `piece` ends with; None if there is none."""
        for size in self._by_size:
            for frame in self._stuffer.frames_at_end(piece, size):
                if self.form_of(frame) and self.trailer.is_sound(frame, 0, size):
                    return frame
        return None


def open_stuffer(rule: Stuffing) -> Stuffer:
    """Return the stuffer that a frame file specifies."""
    stuffer = _stuffer(rule)
    if rule.delimit == "both":
        stuffer.opening = stuffer.delimiter
    return stuffer


def _stuffer(rule: Stuffing) -> Stuffer:
    if rule.type == "cobs":
        return Cobs()
    if rule.type == "slip":
        return Escapes(0xC0, 0xDB, {0xC0: 0xDC, 0xDB: 0xDD})
    escaped = (rule.delimiter, rule.escape, *rule.also)
    return Escapes(rule.delimiter, rule.escape, {byte: byte ^ rule.xor for byte in escaped})

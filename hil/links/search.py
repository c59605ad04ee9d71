"""Search for frames in received bytes, whatever lies between them; shared by all stream protocols."""

from typing import Protocol

from hil.links.contract import Counters


class Grammar(Protocol):
    """Shape of a protocol's frames."""

    def find_start(self, buffer: bytes, position: int) -> int:
        """Return where the next frame may begin, as far as known; the buffer's length if nowhere."""

    def size_at(self, buffer: bytes, start: int) -> int:
        """Return the size in bytes of the frame that may begin at `start`, as far as known; 0 if none begins there."""

    def is_sound(self, buffer: bytes, start: int, size: int) -> bool:
        """Return whether the checksum of the whole frame at `start` is right."""


def find_frames(grammar: Grammar, buffer: bytes, counters: Counters) -> tuple[list[tuple[int, int]], int]:
    """Return start and end of each valid frame, in order, and where an incomplete frame may begin.

    A valid frame after a cut one is found at once. Bytes outside of valid frames are counted as dropped; wrong
    checksums are counted too.
    """
    frames: list[tuple[int, int]] = []
    position = 0
    while (start := grammar.find_start(buffer, position)) < len(buffer):
        size = grammar.size_at(buffer, start)
        if start + size > len(buffer):
            behind = _find_valid(grammar, buffer, start + 1)
            if behind < 0:
                break
            start = behind
            size = grammar.size_at(buffer, start)
        counters.dropped_bytes += start - position
        if size and grammar.is_sound(buffer, start, size):
            position = start + size
            frames.append((start, position))
        else:
            counters.checksum_errors += size > 0
            counters.dropped_bytes += 1
            position = start + 1  # do not skip it: a frame may begin inside a damaged one
    counters.dropped_bytes += start - position
    return frames, start


def _find_valid(grammar: Grammar, buffer: bytes, position: int) -> int:
    """Return where the first complete valid frame begins, or -1; so a frame after a cut one is not delayed."""
    while (start := grammar.find_start(buffer, position)) < len(buffer):
        size = grammar.size_at(buffer, start)
        if size and start + size <= len(buffer) and grammar.is_sound(buffer, start, size):
            return start
        position = start + 1
    return -1

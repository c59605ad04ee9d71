"""Fault injection on a link: a wire around any other wire that delays, drops, corrupts and interrupts its data.

    wire = FaultyWire(PtyHostWire(path), Faults(baud=115_200, drop=0.01), seed=7)
    wire.faults = wire.faults._replace(drop=0.2)    # at any time

Faults apply to *chunks*. A sent chunk is the data of one `write`, which is one message of a `ThrusterLink`. A received
chunk is the data of one `read` of the inner wire, which is one message unless the reader was late. On a CAN bus a chunk
is always one frame. The same seed and the same chunks give the same faults; each direction has its own random numbers.
A delayed chunk is due at a certain time, and `fileno` then becomes readable. A loop that waits on it and calls `read`
advances both directions.
"""

import select
import sys
from collections import deque
from random import Random
from typing import Annotated, Literal, NamedTuple

from hil.common.clock import NEVER_NS, NS_PER_S, now_ns
from hil.common.errors import DeviceError
from hil.common.schema import Range
from hil.links.contract import Wire
from hil.links.wires.can_frame import EXTENDED, RECORD_SIZE
from hil.links.wires.timer import Timer

BITS_A_BYTE = 10  # start bit, eight of data, stop bit
CAN_BITS, CAN_BITS_EXTENDED = 47, 67  # of a frame without its data: ISO 11898-1, interframe space included
CAN_DATA = 8  # offset of the data in a record; their size is at offset 4
PIECE = 32  # bytes; a longer chunk arrives in pieces, as from the buffer of a UART
BACKLOG = 4096  # bytes that may wait for a paced line; Linux buffers as many for a serial port
REORDER_WAIT_NS = NS_PER_S // 10  # how long a reordered chunk waits for the next one

Share = Annotated[float, Range(0.0, 1.0)]


class Faults(NamedTuple):
    """Faults of a wire; none by default.

    `baud`, bit/s: bytes take ten bits each; frames of a CAN bus take their bits without stuffing (0: no time). `delay`
    is added to it, and `jitter` up to so much more, uniformly distributed; chunks do not overtake each other.
    Probabilities from 0 to 1: `drop` and `duplicate` of a chunk; `reorder`: a chunk is swapped with the next one;
    `corrupt`, for each byte (in CAN frames: of data): one of its bits flips; `stall`: a chunk and all after it wait for
    `stall_time`; `disconnect`: from a chunk on, everything is lost in both directions for `disconnect_time`.
    `unplugged`: the wire raises DeviceError until it is false again, like a device that was pulled out. `direction`:
    the affected direction, seen from the end with this wire.
    """

    baud: Annotated[int, Range(0, 12_000_000, "bit/s")] = 0
    delay: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    jitter: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    drop: Share = 0.0
    corrupt: Share = 0.0
    duplicate: Share = 0.0
    reorder: Share = 0.0
    stall: Share = 0.0
    stall_time: Annotated[float, Range(0.0, 10.0, "s")] = 0.2
    disconnect: Share = 0.0
    disconnect_time: Annotated[float, Range(0.0, 60.0, "s")] = 1.0
    unplugged: bool = False
    direction: Literal["both", "sent", "received"] = "both"


CLEAR = Faults()


def line_bits(data: bytes, on_can: bool) -> int:
    """Return the number of bits of `data` on a serial line, or of whole records of CAN frames on a bus."""
    if not on_can:
        return len(data) * BITS_A_BYTE
    bits = 0
    for start in range(0, len(data), RECORD_SIZE):
        extended = int.from_bytes(data[start : start + 4], sys.byteorder) & EXTENDED
        bits += (CAN_BITS_EXTENDED if extended else CAN_BITS) + 8 * min(data[start + 4], 8)
    return bits


class Tally:
    """Counters of the faults in one direction: chunks, unless the name has bytes."""

    __slots__ = (
        "chunks", "corrupted_bytes", "disconnects", "dropped", "duplicated", "lost", "refused_bytes", "reordered",
        "stalls",
    )  # fmt: skip

    def __init__(self) -> None:
        self.chunks = 0  # all
        self.dropped = 0
        self.lost = 0  # during a disconnect
        self.corrupted_bytes = 0
        self.duplicated = 0
        self.reordered = 0  # swapped with the next one
        self.stalls = 0
        self.disconnects = 0
        self.refused_bytes = 0  # by the inner wire, when they were due


class FaultyWire(Wire):
    """`wire`, which it owns, with `faults`; `sent` and `received` count them. Raises the errors of `wire`."""

    def __init__(self, wire: Wire, faults: Faults = CLEAR, seed: int = 0) -> None:
        self.name = wire.name
        self.record_size = wire.record_size
        self._wire = wire
        self._outward = _Lane(Random(f"{seed} sent"), self.record_size)
        self._inward = _Lane(Random(f"{seed} received"), self.record_size)
        self.sent, self.received = self._outward.tally, self._inward.tally
        self._timer = Timer()
        self._epoll = select.epoll()
        self._epoll.register(self._timer.fd, select.EPOLLIN)
        self._listening = False
        self.faults = faults

    @property
    def faults(self) -> Faults:
        """Faults of the wire; new ones do not change chunks that are already waiting."""
        return self._faults

    @faults.setter
    def faults(self, faults: Faults) -> None:
        self._faults = faults
        self._outward.faults = faults if faults.direction != "received" else CLEAR
        self._inward.faults = faults if faults.direction != "sent" else CLEAR
        self._settle(now_ns())

    def fault_counts(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return the counters of `sent` and of `received` by name."""
        sent, received = (
            {name: float(getattr(tally, name)) for name in Tally.__slots__} for tally in (self.sent, self.received)
        )
        return sent, received

    def fileno(self) -> int:
        """Return the descriptor that becomes readable for bytes of the inner wire and for due bytes; -1 once closed."""
        return -1 if self._epoll.closed else self._epoll.fileno()

    def read(self) -> bytes:
        """Return the received bytes that are due. Raises DeviceError if the device is lost or unplugged."""
        self._check_plugged()
        now = now_ns()
        if self._inward.backlog(now) < BACKLOG:
            data = self._wire.read()
            if data:
                self._inward.offer(data, now)
                self._share_disconnect()
        horizon = self._timer.horizon(now)
        due = self._inward.due(horizon)
        self._flush(horizon)
        self._settle(now)
        return b"".join(due)

    def discard_received(self) -> int:
        """Discard the bytes that wait here, due or not, and those of the inner wire; return how many."""
        discarded = self._inward.discard_all() + self._wire.discard_received()
        self._settle(now_ns())
        return discarded

    def write(self, data: bytes) -> int:
        """Send `data`; return the bytes accepted, lost ones included. Raises DeviceError if the device is lost."""
        self._check_plugged()
        if self._epoll.closed or self._outward.is_clear:
            taken_now = self._wire.write(data)
            self.sent.chunks += len(self._outward.chunks(data[:taken_now]))
            return taken_now
        now = now_ns()
        room = max(0, BACKLOG - self._outward.backlog(now))
        accepted = data[: room - room % self.record_size]
        if accepted:
            self._outward.offer(accepted, now)
            self._share_disconnect()
        self._flush(now)
        self._settle(now)
        return len(accepted)

    def unsent(self) -> int:
        """Return the bytes that the slow line has not carried yet, and those that wait in the inner wire."""
        return self._outward.unsent(now_ns()) + self._wire.unsent()

    def discard_unsent(self) -> None:
        """Discard the unsent bytes, except those that the line is carrying now."""
        self._outward.discard_unsent(now_ns())
        self._wire.discard_unsent()

    def close(self) -> None:
        """Close the wire; waiting bytes are lost. May be called twice."""
        if not self._epoll.closed:
            self._epoll.close()
            self._timer.close()
        self._wire.close()

    def _check_plugged(self) -> None:
        if self._faults.unplugged and not self._epoll.closed:
            raise DeviceError(f"{self.name}: went away (unplugged by the faults of this link); plug it in again")

    def _share_disconnect(self) -> None:
        end = max(self._outward.silent_until_ns, self._inward.silent_until_ns)
        self._outward.silent_until_ns = self._inward.silent_until_ns = end

    def _flush(self, horizon: int) -> None:
        for piece in self._outward.due(horizon):
            self.sent.refused_bytes += len(piece) - self._wire.write(piece)

    def _settle(self, now: int) -> None:
        """Set the timer for the next due bytes; listen to the inner wire unless enough bytes wait here."""
        if self._epoll.closed:
            return
        self._timer.arm(now if self._faults.unplugged else min(self._inward.next_ns, self._outward.next_ns))
        is_reading = self._inward.backlog(now) < BACKLOG and not self._faults.unplugged
        if is_reading and not self._listening:
            self._epoll.register(self._wire.fileno(), select.EPOLLIN)
        elif self._listening and not is_reading:
            self._epoll.unregister(self._wire.fileno())
        self._listening = is_reading


class _Lane:
    """One direction: applies `faults` to chunks and stores those that are not yet due, in order."""

    def __init__(self, random: Random, record_size: int) -> None:
        self.faults = CLEAR
        self.tally = Tally()
        self.silent_until_ns = 0
        self._random = random
        self._on_can = record_size == RECORD_SIZE
        # Time when due (not before earlier entries), time when the line has carried it, data.
        self._waiting: deque[tuple[int, int, bytes]] = deque()
        self._swapped: tuple[int, bytes] | None = None  # a reordered chunk: time until it waits for the next, data
        self._line_free_ns = 0  # when the line will have carried everything so far
        self._stalled_until_ns = 0

    @property
    def is_clear(self) -> bool:
        """True if chunks pass unchanged and without delay."""
        return self.next_ns == NEVER_NS and self.faults == CLEAR

    @property
    def next_ns(self) -> int:
        """Time (ns) at which the next chunk is due."""
        next_ns = self._waiting[0][0] if self._waiting else NEVER_NS
        return min(next_ns, self._swapped[0]) if self._swapped else next_ns

    def backlog(self, now: int) -> int:
        """Return the bytes that the line has not carried yet (for records: the bytes of their data)."""
        waits = max(0, self._line_free_ns - now)
        return waits * self.faults.baud // (BITS_A_BYTE * NS_PER_S)

    def unsent(self, now: int) -> int:
        """Return the bytes that the line has not carried, in whole pieces; bytes delayed after it do not count."""
        if self._line_free_ns <= now:
            return 0
        return sum([len(piece) for _, carried_ns, piece in self._waiting if carried_ns > now])

    def discard_unsent(self, now: int) -> None:
        """Discard what the line has not begun to carry."""
        carried = [entry for entry in self._waiting if entry[1] <= now]
        on_the_line = self._waiting[len(carried)] if len(carried) < len(self._waiting) else None
        if on_the_line and now < self._stalled_until_ns:
            on_the_line = None  # a stalled line carries nothing
        self._waiting = deque([*carried, on_the_line] if on_the_line else carried)
        self._line_free_ns = max(now, self._stalled_until_ns, on_the_line[1] if on_the_line else 0)

    def discard_all(self) -> int:
        """Discard all bytes that wait; return how many."""
        discarded = sum([len(piece) for *_, piece in self._waiting]) + (len(self._swapped[1]) if self._swapped else 0)
        self._waiting.clear()
        self._swapped, self._line_free_ns = None, self._stalled_until_ns
        return discarded

    def offer(self, data: bytes, now: int) -> None:
        """Add bytes for the line to carry."""
        for chunk in self.chunks(data):
            self._strike(chunk, now)

    def chunks(self, data: bytes) -> list[bytes]:
        """Return the chunks of `data`; faults apply to each separately."""
        size = RECORD_SIZE if self._on_can else max(len(data), 1)
        return [data[start : start + size] for start in range(0, len(data), size)]

    def due(self, now: int) -> list[bytes]:
        """Return the data that have arrived by `now`."""
        if self._swapped and self._swapped[0] <= now:
            self._pass_swapped(now)
        arrived = []
        while self._waiting and self._waiting[0][0] <= now:
            arrived.append(self._waiting.popleft()[2])
        return arrived

    def _strike(self, chunk: bytes, now: int) -> None:
        faults, tally, happens = self.faults, self.tally, self._happens
        tally.chunks += 1
        if happens(faults.disconnect) and now >= self.silent_until_ns:
            tally.disconnects += 1
            self.silent_until_ns = now + round(faults.disconnect_time * NS_PER_S)
        if now < self.silent_until_ns:
            tally.lost += 1
            return
        if happens(faults.drop):
            tally.dropped += 1
            return
        if faults.corrupt:
            chunk = self._corrupted(chunk)
        if happens(faults.stall):
            tally.stalls += 1
            self._line_free_ns = max(now, self._line_free_ns) + round(faults.stall_time * NS_PER_S)
            self._stalled_until_ns = self._line_free_ns
        if happens(faults.reorder) and not self._swapped:
            tally.reordered += 1
            self._swapped = now + REORDER_WAIT_NS, chunk
            return
        self._carry(chunk, now)
        if happens(faults.duplicate):
            tally.duplicated += 1
            self._carry(chunk, now)
        if self._swapped:
            self._pass_swapped(now)

    def _happens(self, chance: float) -> bool:
        return chance > 0.0 and self._random.random() < chance

    def _corrupted(self, chunk: bytes) -> bytes:
        """Return `chunk` with some bits flipped; a CAN frame's identifier and size stay valid."""
        first, last = (CAN_DATA, CAN_DATA + min(chunk[4], 8)) if self._on_can else (0, len(chunk))
        damaged = bytearray(chunk)
        for place in range(first, last):
            if self._happens(self.faults.corrupt):
                damaged[place] ^= 1 << self._random.randrange(8)
                self.tally.corrupted_bytes += 1
        return bytes(damaged)

    def _pass_swapped(self, now: int) -> None:
        assert self._swapped
        (_, chunk), self._swapped = self._swapped, None
        self._carry(chunk, now)

    def _carry(self, chunk: bytes, now: int) -> None:
        faults = self.faults
        if now > self._line_free_ns:
            self._line_free_ns = now
        wait = faults.delay + (faults.jitter * self._random.random() if faults.jitter else 0.0)
        later = round(wait * NS_PER_S)
        size = PIECE if faults.baud else len(chunk)
        for start in range(0, len(chunk), size):
            piece = chunk[start : start + size]
            if faults.baud:
                self._line_free_ns += line_bits(piece, self._on_can) * NS_PER_S // faults.baud
            self._waiting.append((self._line_free_ns + later, self._line_free_ns, piece))

"""Two ends of a CAN bus in memory, and noise made of CAN frames."""

import random
from collections.abc import Callable, Iterable

from hil.links.contract import Message, Protocol, Wire
from hil.links.wires.can_frame import CanFrame, pack_frame, unpack_frames
from tests.support.links.can_pairs import virtual_pair
from tests.support.links.link_contract import CanLinkContract


class MemoryBus:
    """A bus: frames written by one wire are read by all others."""

    def __init__(self) -> None:
        self.wires: list[MemoryWire] = []
        self.taps: list[Callable[[bytes], None]] = []  # called with what is written

    def wire(self) -> "MemoryWire":
        self.wires.append(MemoryWire(self))
        return self.wires[-1]


class MemoryWire(Wire):
    name = "memory"

    def __init__(self, bus: MemoryBus) -> None:
        self._bus = bus
        self.unread = b""

    def fileno(self) -> int:
        return -1

    def read(self) -> bytes:
        data, self.unread = self.unread, b""
        return data

    def write(self, data: bytes) -> int:
        for wire in self._bus.wires:
            if wire is not self:
                wire.unread += data
        for tap in self._bus.taps:
            tap(data)
        return len(data)

    def close(self) -> None:
        pass


def frames(records: bytes) -> list[CanFrame]:
    return list(unpack_frames(records))


def records(frames: Iterable[CanFrame]) -> bytes:
    return b"".join(map(pack_frame, frames))


def exchange(sender: Protocol, message: Message, receiver: Protocol) -> list[Message]:
    """Return the message as the receiver decodes it."""
    return receiver.feed(sender.encode(message))


def noise(count: int, sound: list[CanFrame], seed: int = 1) -> Iterable[bytes]:
    """Return records: valid frames with a bit or two changed, valid ones in a wrong order, and random bytes."""
    source = random.Random(seed)
    known = [pack_frame(frame) for frame in sound]
    for _ in range(count):
        record = bytearray(source.choice(known))
        kind = source.random()
        if kind < 0.2:
            record = bytearray(source.randbytes(16))
        elif kind < 0.8:
            for _ in range(source.randint(1, 3)):
                record[source.randrange(16)] ^= 1 << source.randrange(8)
        yield bytes(record)


class VirtualCanContract(CanLinkContract):
    """The contract on a bus within this process."""

    open_wires = staticmethod(virtual_pair)

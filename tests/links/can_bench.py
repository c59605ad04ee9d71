"""Two ends of a CAN bus in memory, and noise that knows CAN frames."""

import random
from collections.abc import Callable, Iterable

from firmware_stub.stub import Stm32, Stm32End
from hil.links.can_frame import CanFrame, pack_frame, unpack_frames
from hil.links.contract import MAX_THRUSTERS, Message, Protocol, ThrusterTelemetry, Wire
from tests.links.can_pairs import virtual_pair
from tests.links.link_contract import CanLinkContract, Ends, command, read_messages, wait_readable


class MemoryBus:
    """A bus: what one of its wires writes, all others read."""

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


def records(kept: Iterable[CanFrame]) -> bytes:
    return b"".join(map(pack_frame, kept))


def exchange(sender: Protocol, message: Message, receiver: Protocol) -> list[Message]:
    """What the receiver makes of a message."""
    return receiver.feed(sender.encode(message))


def noise(count: int, sound: list[CanFrame], seed: int = 1) -> Iterable[bytes]:
    """Records: sound frames with a bit or two turned, sound ones in a wrong order, and random bytes."""
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
    """The contract on a bus of python-can, whose reading thread hands over the frames of a command one by one."""

    open_wires = staticmethod(virtual_pair)

    def test_all_come_in_order(self, ends: Ends) -> None:
        """Each waits for the one before: the thread is slower than a loop that only writes."""
        for sequence in range(1, 51):
            order = command(sequence, MAX_THRUSTERS)
            ends.host.send(order)
            self.assert_same(read_messages(ends.device, 1), [order])

    def test_stm32_on_the_link(self, ends: Ends) -> None:
        stm32 = Stm32(MAX_THRUSTERS, telemetry_period_ns=10**9)
        end = Stm32End(stm32, ends.device)
        assert end.service(1) == 0
        assert len(read_messages(ends.host, 1)) == 1
        order = command(99, MAX_THRUSTERS)
        ends.host.send(order)
        while not stm32.frames:
            assert wait_readable(ends.device.wire)
            end.service(5_000)
        self.assert_same(read_messages(ends.host, 1), [ThrusterTelemetry(99, True, False, order.pwm_us, 0, 1, 0, 0)])
        assert stm32.pwm_us == list(order.pwm_us)

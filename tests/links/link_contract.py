"""What every thruster link must do. A new wire or protocol subclasses `LinkContract` and says what it is."""

import os
import select
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ClassVar, NamedTuple

import pytest

from firmware_stub.stub import Stm32, Stm32End
from hil.errors import DeviceError
from hil.links.contract import (
    MAX_THRUSTERS,
    Message,
    Protocol,
    ThrusterCommand,
    ThrusterLink,
    ThrusterTelemetry,
    Wire,
)
from hil.links.frame import FrameProtocol
from hil.schema import find_preset

PATIENCE_S = 2.0
EVERY_BYTE = bytes(range(256))


def uuv_hil() -> FrameProtocol:
    """One end's protocol, speaking our own frame."""
    return FrameProtocol(find_preset("firmware_stub/frames", "uuv_hil"))


def command(sequence: int, channels: int = 6) -> ThrusterCommand:
    """An armed command that no other sequence number gives."""
    return ThrusterCommand(sequence, True, tuple(1100 + (sequence * 7 + i) % 800 for i in range(channels)))


@contextmanager
def nothing_leaks() -> Iterator[None]:
    """Asserts that the descriptors and threads at the end are those of the beginning."""
    before = _held()
    yield
    assert _held() == before


def _held() -> tuple[set[str], set[threading.Thread]]:
    descriptors = {f"{fd} {os.readlink(f'/proc/self/fd/{fd}')}" for fd in map(str, _descriptors())}
    return descriptors, set(threading.enumerate())


def _descriptors() -> list[int]:
    listed = [int(name) for name in os.listdir("/proc/self/fd")]
    return [fd for fd in listed if os.path.lexists(f"/proc/self/fd/{fd}")]  # without the listing's own


def wait_readable(wire: Wire, seconds: float = PATIENCE_S) -> bool:
    """Whether the wire's descriptor wakes a waiting program in time."""
    return bool(select.select([wire.fileno()], [], [], seconds)[0])


def read_bytes(wire: Wire, count: int) -> bytes:
    """The next `count` bytes, or as many as come in time."""
    data = b""
    while len(data) < count and wait_readable(wire):
        data += wire.read()
    return data


def read_messages(link: ThrusterLink, count: int) -> list[Message]:
    """The next `count` messages, or as many as come in time."""
    messages: list[Message] = []
    while len(messages) < count and wait_readable(link.wire):
        messages += link.receive()
    return messages


class Ends(NamedTuple):
    """A link from both sides."""

    device: ThrusterLink
    host: ThrusterLink


class LinkContract:
    """Subclass as `Test...` and set the attributes."""

    open_wires: ClassVar[Callable[[], tuple[Wire, Wire]]]  # the device's end, the host's end
    open_protocol: ClassVar[Callable[[], Protocol]] = staticmethod(uuv_hil)
    channels: ClassVar[range] = range(1, MAX_THRUSTERS + 1)
    host_sees_hangup: ClassVar[bool] = True

    injected = False  # a test that damages bytes says so

    @pytest.fixture
    def ends(self) -> Iterator[Ends]:
        """A fresh link; afterwards no error that the test has not injected, and nothing left open."""
        with nothing_leaks():
            kind = type(self)
            device, host = kind.open_wires()
            ends = Ends(ThrusterLink(device, kind.open_protocol()), ThrusterLink(host, kind.open_protocol()))
            yield ends
            for link in ends:
                link.close()
        if not self.injected:
            for link in ends:
                counters = link.counters
                assert (counters.checksum_errors, counters.malformed, counters.dropped_bytes) == (0, 0, 0)

    def test_a_quiet_wire_reads_as_nothing(self, ends: Ends) -> None:
        for link in ends:
            assert not wait_readable(link.wire, 0)
            assert link.wire.read() == b""
            assert link.receive() == []

    @pytest.mark.parametrize("downward", [True, False])
    def test_every_byte_crosses_unchanged_and_without_echo(self, ends: Ends, downward: bool) -> None:
        sender, receiver = (ends.host, ends.device) if downward else (ends.device, ends.host)
        assert sender.wire.write(EVERY_BYTE) == 256
        assert read_bytes(receiver.wire, 256) == EVERY_BYTE
        assert receiver.wire.read() == b""
        assert sender.wire.read() == b""

    @pytest.mark.parametrize("downward", [True, False])
    def test_a_full_wire_refuses_and_recovers(self, ends: Ends, downward: bool) -> None:
        sender, receiver = (ends.host.wire, ends.device.wire) if downward else (ends.device.wire, ends.host.wire)
        sent = 0
        for _ in range(20_000):
            taken = sender.write(EVERY_BYTE)
            sent += taken
            if taken < len(EVERY_BYTE):
                break
        else:
            pytest.fail("took 5 MB that nobody read")
        assert len(read_bytes(receiver, sent)) == sent
        assert sender.write(b"after") == 5
        assert read_bytes(receiver, 5) == b"after"

    def test_messages_cross_both_ways(self, ends: Ends) -> None:
        for channels in self.channels:
            order = command(channels, channels)
            ends.host.send(order)
            assert read_messages(ends.device, 1) == [order]
            report = ThrusterTelemetry(channels, True, False, order.pwm_us, 1234, 5, 6, 7)
            ends.device.send(report)
            assert read_messages(ends.host, 1) == [report]
        assert ends.host.counters.messages_out == ends.device.counters.messages_in == len(self.channels)
        assert ends.device.counters.bytes_out == ends.host.counters.bytes_in > 0

    def test_all_come_in_order(self, ends: Ends) -> None:
        channels = self.channels[-1]
        sent = [command(sequence, channels) for sequence in range(300)]
        heard: list[Message] = []
        for order in sent:
            ends.host.send(order)
            heard += ends.device.receive()
        heard += read_messages(ends.device, len(sent) - len(heard))
        assert heard == sent

    def test_noise_costs_no_sound_message(self, ends: Ends) -> None:
        self.injected = True
        for sequence, noise in enumerate((EVERY_BYTE, b"\xff", b"\0" * 40, EVERY_BYTE[::-1])):
            ends.host.wire.write(noise)
            order = command(sequence, self.channels[0])
            ends.host.send(order)
            assert read_messages(ends.device, 1) == [order]
        assert ends.device.counters.dropped_bytes == 256 + 1 + 40 + 256

    def test_stm32_on_the_link(self, ends: Ends) -> None:
        channels = self.channels[-1]
        stm32 = Stm32(channels, telemetry_period_ns=10**9)
        end = Stm32End(stm32, ends.device)
        assert end.service(1) == 0
        assert read_messages(ends.host, 1)[0].sequence == 0
        order = command(99, channels)
        ends.host.send(order)
        assert select.select([end.fileno()], [], [], PATIENCE_S)[0]
        assert end.service(5_000) == 1
        (answer,) = read_messages(ends.host, 1)
        assert answer == ThrusterTelemetry(99, True, False, order.pwm_us, 0, 1, 0, 0)
        assert stm32.pwm_us == list(order.pwm_us)

    def test_a_closed_wire_says_so(self, ends: Ends) -> None:
        for link in ends:
            link.close()
            link.close()
            with pytest.raises(DeviceError, match="closed"):
                link.wire.read()
            with pytest.raises(DeviceError, match="closed"):
                link.wire.write(b"x")

    def test_the_host_notices_that_the_device_went(self, ends: Ends) -> None:
        if not self.host_sees_hangup:
            pytest.skip("this kind of wire has no hang-up")
        ends.device.close()
        assert wait_readable(ends.host.wire), "a loop that waits must wake up"
        with pytest.raises(DeviceError, match="went away"):
            ends.host.receive()
        with pytest.raises(DeviceError, match="went away"):
            ends.host.wire.write(b"x")

"""Conformance tests of every wire and every thruster link.

A new wire subclasses `WireContract`, a wire with a protocol on it `LinkContract`; class attributes describe it:

    class TestVescOnVirtualCan(CanLinkContract):
        open_wires = staticmethod(virtual_pair)
        protocol = "vesc"
"""

import os
import select
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar, NamedTuple

import pytest

from firmware_stub.stub import Stm32, Stm32End
from hil.common.children import open_lifeline
from hil.common.clock import now_ns
from hil.common.errors import DeviceError
from hil.links.contract import MAX_THRUSTERS, Message, Protocol, ThrusterCommand, ThrusterLink, ThrusterTelemetry, Wire
from hil.links.protocols import Role, open_protocol
from hil.links.wires.can_frame import RECORD_SIZE, CanFrame, pack_frame
from hil.slave.drivers.driver import ThrusterDriver

PATIENCE_S = 60.0
EVERY_BYTE = bytes(range(256))


def uuv_hil() -> Protocol:
    """Return the frame protocol of one end."""
    return open_protocol("frame", "host", MAX_THRUSTERS)


def command(sequence: int, channels: int = 6) -> ThrusterCommand:
    """Return an armed command whose pulses depend on the sequence number."""
    return ThrusterCommand(sequence, True, tuple(1100 + (sequence * 7 + i) % 800 for i in range(channels)))


def records(data: bytes, first_id: int = 0x1AB_CDE0, extended: bool = True) -> bytes:
    """Return CAN frames that carry `data`, eight bytes each."""
    parts = [data[start : start + 8] for start in range(0, len(data), 8)]
    return b"".join(pack_frame(CanFrame(first_id + i, part, extended)) for i, part in enumerate(parts))


@contextmanager
def nothing_leaks() -> Iterator[None]:
    """Assert that no descriptors and threads are added between the beginning and the end, or soon after it.

    Those of earlier tests may end meanwhile.
    """
    os.close(open_lifeline())  # the pipe for children is made once and stays
    before = _held()
    yield
    deadline = time.monotonic() + PATIENCE_S / 2
    while (leaked := _held() - before) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not leaked


def _held() -> set[object]:
    descriptors = {f"{fd} {os.readlink(f'/proc/self/fd/{fd}')}" for fd in map(str, _descriptors())}
    return {*descriptors, *threading.enumerate()}


def _descriptors() -> list[int]:
    listed = [int(name) for name in os.listdir("/proc/self/fd")]
    return [fd for fd in listed if os.path.lexists(f"/proc/self/fd/{fd}")]  # without the listing's own


def wait_readable(wire: Wire, seconds: float = PATIENCE_S) -> bool:
    """Return whether the wire's descriptor wakes a waiting program in time."""
    return bool(select.select([wire.fileno()], [], [], seconds)[0])


def wait_telemetry(link: ThrusterLink, condition: Callable[[ThrusterTelemetry], bool]) -> ThrusterTelemetry:
    """Return the first telemetry that meets the condition; fail if none does in time."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        wait_readable(link.wire, 0.1)
        for message in link.receive():
            if isinstance(message, ThrusterTelemetry) and condition(message):
                return message
    pytest.fail("no such telemetry")


def read_bytes(wire: Wire, count: int, patience_s: float = PATIENCE_S) -> bytes:
    """Return the next `count` bytes, or as many as arrive in time."""
    data = b""
    while len(data) < count and wait_readable(wire, patience_s):
        data += wire.read()
    return data


def read_messages(link: ThrusterLink, count: int) -> list[Message]:
    """Return the next `count` messages, or as many as arrive in time."""
    messages: list[Message] = []
    while len(messages) < count and wait_readable(link.wire):
        messages += link.receive()
    return messages


def await_answer(driver: ThrusterDriver, sequence: int) -> list[ThrusterTelemetry]:
    """Return the reports that echo the command with this number, once there is one; [] if none arrives in time."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        found = [report for report in driver.service(now_ns()) if report.sequence == sequence]
        if found:
            return found
        select.select(driver.descriptors, [], [], 0.01)
    return []


class Wires(NamedTuple):
    """A wire from both sides."""

    device: Wire
    host: Wire


class Ends(NamedTuple):
    """A link from both sides."""

    device: ThrusterLink
    host: ThrusterLink


class WireContract:
    """The contract of a wire: subclass it as `Test...` and set the attributes."""

    open_wires: ClassVar[Callable[[], tuple[Wire, Wire]]]  # the device's end, the host's end
    record_size: ClassVar[int] = 1  # bytes that the wire keeps together: RECORD_SIZE on a CAN bus
    host_sees_hangup: ClassVar[bool] = True
    refuses_when_full: ClassVar[bool] = True  # else what nobody reads is lost on the way
    quiet_s: ClassVar[float] = 0.05  # after which nothing more is on the way

    @property
    def sample(self) -> bytes:
        """Every byte value, in the form that the wire carries."""
        return records(EVERY_BYTE) if self.record_size == RECORD_SIZE else EVERY_BYTE

    @pytest.fixture
    def wires(self) -> Iterator[Wires]:
        """Provide a new wire; check afterwards that nothing is left open."""
        with nothing_leaks():
            wires = Wires(*type(self).open_wires())
            yield wires
            for wire in wires:
                wire.close()

    def test_a_quiet_wire_reads_no_bytes(self, wires: Wires) -> None:
        for wire in wires:
            assert not wait_readable(wire, 0)
            assert wire.read() == b""

    @pytest.mark.parametrize("downward", [True, False])
    def test_every_byte_is_transmitted_unchanged_and_without_echo(self, wires: Wires, downward: bool) -> None:
        sender, receiver = (wires.host, wires.device) if downward else (wires.device, wires.host)
        assert sender.write(self.sample) == len(self.sample)
        assert read_bytes(receiver, len(self.sample)) == self.sample
        assert receiver.read() == b""
        assert sender.read() == b""

    @pytest.mark.parametrize("downward", [True, False])
    def test_a_full_wire_refuses_and_recovers(self, wires: Wires, downward: bool) -> None:
        sender, receiver = (wires.host, wires.device) if downward else (wires.device, wires.host)
        sent = self.fill(sender)
        if self.refuses_when_full:
            assert len(read_bytes(receiver, sent)) == sent
        sender.read()  # as a loop does: a wire may have kept what was cut
        while wait_readable(receiver, self.quiet_s):
            receiver.read()
            sender.read()
        after = self.sample[: 2 * self.record_size]
        assert sender.write(after) == len(after)
        assert read_bytes(receiver, len(after)) == after

    def fill(self, sender: Wire) -> int:
        """Write until the wire refuses; return the accepted bytes, always whole records."""
        sent_count = 0
        for _ in range(20_000 if self.refuses_when_full else 400):
            written = sender.write(self.sample)
            assert written % self.record_size == 0
            sent_count += written
            if written < len(self.sample):
                return sent_count
        assert not self.refuses_when_full, "took 5 MB that nobody read"
        return sent_count

    def test_using_a_closed_wire_is_an_error(self, wires: Wires) -> None:
        for wire in wires:
            wire.close()
            wire.close()
            with pytest.raises(DeviceError, match="closed"):
                wire.read()
            with pytest.raises(DeviceError, match="closed"):
                wire.write(self.sample)

    def test_the_host_detects_that_the_device_closed(self, wires: Wires) -> None:
        wires.device.close()
        if self.host_sees_hangup:
            assert wait_readable(wires.host), "a loop that waits must wake up"
            with pytest.raises(DeviceError, match="went away"):
                wires.host.read()
            with pytest.raises(DeviceError, match="went away"):
                wires.host.write(self.sample)
        else:
            for _ in range(3):  # it looks like a device that is silent
                wires.host.write(self.sample)
                assert wires.host.read() == b""


class LinkContract(WireContract):
    """The contract of a wire with a protocol on it."""

    protocol: ClassVar[str] = "frame"
    settings: ClassVar[dict[str, Any]] = {}  # of the protocol
    channels: ClassVar[Sequence[int]] = range(1, MAX_THRUSTERS + 1)
    # What crosses; the rest the other end has to make up, and is not looked at.
    commands_carry: ClassVar[tuple[str, ...]] = ThrusterCommand._fields
    reports_carry: ClassVar[tuple[str, ...]] = ThrusterTelemetry._fields
    pwm_error_us: ClassVar[int] = 0  # the most by which rounding changes a pulse
    noise: ClassVar[tuple[bytes, ...]] = (EVERY_BYTE, b"\xff", b"\0" * 40, EVERY_BYTE[::-1])
    noise_is_counted: ClassVar[bool] = True  # as dropped bytes

    injected = False  # a test that damages bytes says so

    def protocol_of(self, role: Role, channels: int) -> Protocol:
        """Return one end's protocol."""
        return open_protocol(self.protocol, role, channels, **self.settings)

    @contextmanager
    def linked(self, wires: Wires, channels: int) -> Iterator[Ends]:
        """Provide new protocols on `wires`; check afterwards that there are no errors except injected ones."""
        device = ThrusterLink(wires.device, self.protocol_of("device", channels))
        ends = Ends(device, ThrusterLink(wires.host, self.protocol_of("host", channels)))
        yield ends
        if not self.injected:
            for link in ends:
                counters = link.counters
                assert (counters.checksum_errors, counters.malformed, counters.dropped_bytes) == (0, 0, 0)

    @pytest.fixture
    def ends(self, wires: Wires) -> Iterator[Ends]:
        """Provide a new link with the most thrusters it can carry."""
        with self.linked(wires, self.channels[-1]) as ends:
            yield ends

    def assert_same(self, received: list[Message], sent: Sequence[Message]) -> None:
        """Assert that `received` equals `sent`, as far as this protocol carries it."""
        assert [type(message) for message in received] == [type(message) for message in sent]
        for received_message, sent_message in zip(received, sent, strict=True):
            carried = self.commands_carry if isinstance(sent_message, ThrusterCommand) else self.reports_carry
            for field in carried:
                if field == "pwm_us":
                    errors = [abs(a - b) for a, b in zip(received_message.pwm_us, sent_message.pwm_us, strict=True)]
                    assert max(errors) <= self.pwm_error_us
                else:
                    assert getattr(received_message, field) == getattr(sent_message, field), field

    def test_nothing_is_received_on_a_quiet_link(self, ends: Ends) -> None:
        for link in ends:
            assert link.receive() == []

    def test_messages_are_transmitted_both_ways(self, wires: Wires) -> None:
        for channels in self.channels:
            with self.linked(wires, channels) as ends:
                order = command(channels, channels)
                ends.host.send(order)
                self.assert_same(read_messages(ends.device, 1), [order])
                report = ThrusterTelemetry(channels, True, False, order.pwm_us, 1234, 1, 6, 7)
                ends.device.send(report)
                self.assert_same(read_messages(ends.host, 1), [report])
                assert ends.host.counters.messages_out == ends.device.counters.messages_in == 1
                assert ends.device.counters.bytes_out == ends.host.counters.bytes_in > 0

    def test_all_messages_arrive_in_order(self, ends: Ends) -> None:
        burst = 10  # what fits any bus at once
        for first in range(1, 301, burst):
            sent = [command(sequence, self.channels[-1]) for sequence in range(first, first + burst)]
            for order in sent:
                ends.host.send(order)
            self.assert_same(read_messages(ends.device, burst), sent)

    def test_noise_loses_no_valid_message(self, ends: Ends) -> None:
        self.injected = True
        for sequence, noise in enumerate(self.noise, 1):
            ends.host.wire.write(noise)
            order = command(sequence, self.channels[-1])
            ends.host.send(order)
            self.assert_same(read_messages(ends.device, 1), [order])
        if self.noise_is_counted:
            assert ends.device.counters.dropped_bytes == sum(map(len, self.noise))

    def test_an_stm32_is_commanded_over_the_link(self, ends: Ends) -> None:
        channels = self.channels[-1]
        stm32 = Stm32(channels, telemetry_period_ns=10**9)
        end = Stm32End(stm32, ends.device)
        assert end.service(1) == 0
        assert read_messages(ends.host, 1)[0].sequence == 0
        order = command(99, channels)
        ends.host.send(order)
        while stm32.frames == 0:  # on some buses the frames of a command come one by one
            assert select.select([end.fileno()], [], [], PATIENCE_S)[0]
            end.service(5_000)
        self.assert_same(read_messages(ends.host, 1), [ThrusterTelemetry(99, True, False, order.pwm_us, 0, 1, 0, 0)])
        assert max(abs(a - b) for a, b in zip(stm32.pwm_us, order.pwm_us, strict=True)) <= self.pwm_error_us


class CanLinkContract(LinkContract):
    """The contract of a protocol on a CAN bus, where noise consists of frames of other nodes."""

    record_size = RECORD_SIZE
    host_sees_hangup = False
    noise = (records(EVERY_BYTE, 0x100, extended=False), records(EVERY_BYTE))
    noise_is_counted = False

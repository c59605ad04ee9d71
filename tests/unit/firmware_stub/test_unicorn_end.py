"""The emulated STM32 on its end of a wire."""

import os
import random
import socket
import time
from collections.abc import Iterator

import pytest

from firmware_stub.unicorn_board import UnicornBoard, UnicornEnd, shipped_image
from hil.common.clock import now_ns
from hil.common.errors import DeviceError
from hil.links.contract import ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.vesc.end import SET_DUTY
from hil.links.wires.can_frame import CanFrame, pack_frame, unpack_frames
from hil.links.wires.terminal import DescriptorWire, PtyHostWire, PtyWire
from tests.support.links.link_contract import nothing_leaks, read_messages, uuv_hil, wait_readable

MS = 1_000_000
FULL = (1900, 1100, 1600, 1400, 1501, 1499)
NEUTRAL = [1500] * 6
START_NS = 123_456_789_012_345  # of a clock that is independent of the board


class Bench:
    """The board on a pty, the host's end of it, and the caller's clock."""

    def __init__(self) -> None:
        wire = PtyWire()
        self.end = UnicornEnd(UnicornBoard(shipped_image(), 6), wire)
        self.host = ThrusterLink(PtyHostWire(wire.path), uuv_hil())
        self.now_ns = START_NS
        self.end.service(self.now_ns)
        self.received(1)

    def pass_time(self, ms: int, step_ms: int = 5) -> None:
        for _ in range(ms // step_ms):
            self.now_ns += step_ms * MS
            self.end.service(self.now_ns)

    def send(self, data: bytes) -> int:
        """Send bytes to the wire at once; return their number."""
        self.host.wire.write(data)
        assert wait_readable(self.end.wire)
        return self.end.service(self.now_ns)

    def received(self, count: int) -> list[ThrusterTelemetry]:
        reports = read_messages(self.host, count)
        assert len(reports) == count
        return [report for report in reports if isinstance(report, ThrusterTelemetry)]


@pytest.fixture
def bench() -> Iterator[Bench]:
    with nothing_leaks():
        bench = Bench()
        yield bench
        bench.end.close()
        bench.host.close()


def command(sequence: int) -> bytes:
    return uuv_hil().encode(ThrusterCommand(sequence, True, FULL))


def test_a_command_is_acknowledged_and_sets_the_timers(bench: Bench) -> None:
    assert bench.end.pwm_us == NEUTRAL
    bench.pass_time(10)
    assert bench.send(command(7)) == 22
    (answer,) = bench.received(1)
    assert (answer.sequence, answer.pwm_us, answer.age_us) == (7, FULL, 0)
    assert bench.end.pwm_us == list(FULL)


def test_the_time_at_which_the_outputs_apply_a_command_is_recorded(bench: Bench) -> None:
    """The time is on the machine's own clock, from writes to the timers' registers; invalid bytes do not change it."""
    before = now_ns()
    bench.send(command(1))
    executed = bench.end.command_ns
    assert before < executed < now_ns()
    bench.send(bytes(40))
    assert bench.end.command_ns == executed
    bench.send(command(2))
    assert bench.end.command_ns > executed, "though the pulses are the same"


def test_a_command_does_not_wait_until_the_board_has_caught_up(bench: Bench) -> None:
    bench.host.wire.write(command(3))
    assert wait_readable(bench.end.wire)
    bench.now_ns += 80 * MS
    bench.end.service(bench.now_ns)
    (report,) = bench.received(1)
    assert (report.sequence, report.age_us) == (3, 0)


def test_reports_and_the_watchdog_follow_the_callers_clock(bench: Bench) -> None:
    bench.send(command(1))
    bench.received(1)
    bench.pass_time(195)
    assert bench.end.pwm_us == list(FULL)
    bench.pass_time(5)
    assert bench.end.pwm_us == NEUTRAL
    (report,) = bench.received(1)
    assert (report.age_us, report.timed_out) == (200_000, True)


def test_a_pause_of_the_machine_does_not_trip_the_watchdog(bench: Bench) -> None:
    bench.send(command(1))
    bench.now_ns += 10_000 * MS
    began_ns = bench.end.board.now_ns
    bench.send(command(2))
    assert bench.end.board.now_ns - began_ns == UnicornEnd.PATIENCE_NS, "the pause is not emulated completely"
    assert bench.end.pwm_us == list(FULL)
    assert bench.received(2)[-1].watchdog_trips == 0


def test_a_flood_is_processed_in_portions(bench: Bench) -> None:
    """A service call never takes long however much arrives, and a command behind it all is received."""
    taken = bench.send(random.Random(4).randbytes(3500) + bytes(300) + command(9))
    assert taken == UnicornEnd.AT_ONCE
    assert bench.end.deadline_ns == bench.now_ns, "there is more"
    services, ends = 0, time.monotonic() + 60.0  # the kernel delivers a flood after some time
    while bench.end.pwm_us != list(FULL) and time.monotonic() < ends:
        bench.now_ns += MS // 10
        bench.end.service(bench.now_ns)
        services += 1
    assert bench.end.pwm_us == list(FULL)
    assert services >= 3500 // UnicornEnd.AT_ONCE


def test_closing_stops_the_thrusters() -> None:
    with nothing_leaks():
        bench = Bench()
        bench.send(command(1))
        bench.end.close()
        assert bench.end.pwm_us == NEUTRAL
        with pytest.raises(DeviceError, match="closed"):
            bench.end.service(bench.now_ns)
        bench.host.close()


def test_can_frames_are_received_even_in_pieces() -> None:
    near, far = socket.socketpair()
    with near, far:
        near.setblocking(False)
        far.setblocking(False)
        end = UnicornEnd(
            UnicornBoard(shipped_image(), 2), DescriptorWire(os.dup(near.fileno()), "socketpair"), can=True
        )
        end.service(START_NS)
        records = b"".join(
            pack_frame(CanFrame(SET_DUTY << 8 | vesc, duty.to_bytes(4, "big", signed=True)))
            for vesc, duty in ((1, 50_000), (2, -25_000))
        )
        far.send(records[:21])
        assert end.service(START_NS + MS) == 16
        assert end.deadline_ns > START_NS + MS, "half a record needs no service"
        far.send(records[21:])
        assert end.service(START_NS + 2 * MS) == 16
        assert end.pwm_us == [1700, 1400]
        assert {frame.id & 0xFF for frame in unpack_frames(far.recv(4096))} == {1, 2}
        end.close()

"""Timing on a wire with faults: by a clock of the test, and in two tests by the machine's clock."""

import statistics
from contextlib import ExitStack

import pytest

from hil.common.clock import NEVER_NS, NS_PER_S, now_ns
from hil.links.wires.faults import BACKLOG, PIECE, Faults
from hil.links.wires.timer import Timer
from tests.support.links.faulty_wires import Clock, cross, instant_pair, pty_pair
from tests.support.links.link_contract import EVERY_BYTE, wait_readable


@pytest.mark.parametrize("downward", [True, False])
def test_bytes_take_no_less_than_their_transmission_time(opened: ExitStack, downward: bool) -> None:
    """By the machine's clock, on a pty; so lateness is not judged."""
    far, near = pty_pair(opened, Faults(baud=230_400))
    sender, receiver = (near, far) if downward else (far, near)
    data = EVERY_BYTE * 8
    received, took_ns = cross(sender, receiver, data)
    assert received == data
    assert took_ns > len(data) * 10 * NS_PER_S / 230_400 - 2 * Timer.MAX_LEAD_NS


@pytest.mark.parametrize("downward", [True, False])
def test_a_frame_arrives_after_its_transmission_time(opened: ExitStack, clock: Clock, downward: bool) -> None:
    far, near = instant_pair(opened, Faults(baud=115_200))
    sender, receiver = (near, far) if downward else (far, near)
    assert sender.write(bytes(32)) == 32
    near.read()
    clock.advance(320 / 115_200 - Timer.MAX_LEAD_NS / NS_PER_S)
    assert near.read() + far.read() == b""
    clock.advance(Timer.MAX_LEAD_NS / NS_PER_S)
    assert near.read() + receiver.read() == bytes(32)


def test_bytes_arrive_one_by_one_at_the_line_rate(opened: ExitStack, clock: Clock) -> None:
    far, near = instant_pair(opened, Faults(baud=9600))
    far.write(bytes(96))
    assert near.read() == b""
    for _ in range(3):
        clock.advance(320 / 9600)
        assert len(near.read()) == 32, "and not all 96 after 100 ms"


def test_a_paced_line_refuses_what_its_buffer_cannot_hold(opened: ExitStack, clock: Clock) -> None:
    _, near = instant_pair(opened, Faults(baud=9600))
    assert near.write(bytes(3 * BACKLOG)) == BACKLOG
    clock.advance(0.01)
    assert near.write(bytes(100)) in (9, 10), "the bytes that the line has carried meanwhile"
    assert near.sent.chunks == 2


def test_a_flood_is_limited_without_a_busy_loop(opened: ExitStack, clock: Clock) -> None:
    far, near = instant_pair(opened, Faults(baud=115_200))
    far.write(bytes(3 * BACKLOG))
    received = len(near.read())
    for milliseconds in range(1, 51):
        clock.advance(0.001)
        received += len(near.read())
        assert received == pytest.approx(11.52 * milliseconds, abs=PIECE)
        assert not wait_readable(near, 0), "the wire wakes for due bytes, not for bytes waiting in the wire below"


def test_delay_and_jitter_have_their_stated_size(opened: ExitStack, clock: Clock) -> None:
    far, near = instant_pair(opened, Faults(delay=0.01, jitter=0.01))
    took_ms = []
    for _ in range(30):
        near.write(b"abc")
        start = clock()
        while not (received := far.read()):
            clock.advance(0.0001)
            near.read()
        assert received == b"abc"
        took_ms.append((clock() - start) / 1e6)
    assert 9.8 <= min(took_ms) < 13.0
    assert 17.0 < statistics.quantiles(took_ms, n=20)[-2] < 20.2


def test_jitter_does_not_reorder_bytes(opened: ExitStack, clock: Clock) -> None:
    far, near = instant_pair(opened, Faults(jitter=0.02))
    received = b""
    for byte in EVERY_BYTE:
        far.write(bytes([byte]))
        received += near.read()
        assert received == EVERY_BYTE[: len(received)]
        clock.advance(0.0005)
    assert 100 < len(received) < 256
    clock.advance(0.02)
    assert received + near.read() == EVERY_BYTE


def test_the_wire_wakes_its_reader_only_when_bytes_are_due(opened: ExitStack) -> None:
    """The machine's clock is used, so lateness is not judged."""
    far, near = instant_pair(opened, Faults(delay=0.05))
    due_ns = now_ns() + NS_PER_S // 20
    near.write(b"later")
    assert wait_readable(near)
    assert now_ns() >= due_ns - Timer.MAX_LEAD_NS
    assert near.read() == b""
    assert far.read() == b"later"
    assert not wait_readable(near, 0)


def test_a_timer_is_early_by_the_latency_that_it_learns() -> None:
    """What is due within the latency of a wake-up counts as due; each wake-up changes the latency by 2 us."""
    timer, at = Timer(), 10**12
    try:
        timer.arm(at)
        assert timer.horizon(at - 51_000) == at - 51_000, "not yet"
        assert timer.horizon(at - 50_000) == at
        assert timer.lead_ns == 48_000, "it came early"
        assert timer.horizon(at + 50_000) == at + 50_000
        assert timer.lead_ns == 50_000, "it came late"
        timer.arm(NEVER_NS)
        assert timer.horizon(at) == at
        timer.lead_ns = timer.MAX_LEAD_NS
        timer.arm(at + 1)
        timer.horizon(at + 10**9)
        assert timer.lead_ns == timer.MAX_LEAD_NS
    finally:
        timer.close()

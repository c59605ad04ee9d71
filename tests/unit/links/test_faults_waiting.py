"""Data that wait in a wire with faults: what discards them, what they delay, and what the wire below still holds."""

from contextlib import ExitStack

import pytest

from hil.common.errors import DeviceError
from hil.links.wires.can_frame import CanFrame, pack_frame
from hil.links.wires.faults import CLEAR, Faults, line_bits
from tests.support.links.faulty_wires import Clock, instant_pair

STALLED = Faults(stall=1.0, stall_time=0.2)


@pytest.mark.parametrize("faults", [CLEAR, Faults(reorder=1.0), Faults(delay=1.0), Faults(baud=9600), STALLED])
def test_received_bytes_are_discarded_wherever_they_wait(opened: ExitStack, clock: Clock, faults: Faults) -> None:
    far, near = instant_pair(opened, faults)
    far.write(b"early")
    early = near.read()
    far.write(b"inner")
    assert len(early) + near.discard_received() == 10
    near.faults = CLEAR
    clock.advance(2.0)
    assert near.read() == b""
    far.write(b"after")
    assert near.read() == b"after"


@pytest.mark.parametrize(("stall", "due_s"), [(0.0, 0.0333), (1.0, 0.2333)])
def test_discarded_bytes_take_no_time_of_the_line_but_a_stall_lasts(
    opened: ExitStack, clock: Clock, stall: float, due_s: float
) -> None:
    far, near = instant_pair(opened, STALLED._replace(baud=9600, stall=stall))
    far.write(bytes(960))
    assert (near.read(), near.discard_received()) == (b"", 960)
    near.faults = Faults(baud=9600)
    far.write(bytes(32))
    for advance_s, arrived in ((0.0, 0), (due_s - 0.001, 0), (0.002, 32)):
        clock.advance(advance_s)
        assert near.read() == bytes(arrived)


def test_unsent_bytes_are_discarded_but_those_on_the_line(opened: ExitStack, clock: Clock) -> None:
    far, near = instant_pair(opened, Faults(baud=9600))
    near.write(bytes(96))  # three pieces of 33.3 ms
    clock.advance(0.04)
    assert near.unsent() == 64
    near.discard_unsent()
    assert near.unsent() == 32
    near.write(bytes(32))
    received = []
    for advance_s in (0.026, 0.001, 0.032, 0.002):  # 66, 67, 99 and 101 ms
        clock.advance(advance_s)
        near.read()
        received.append(len(far.read()))
    assert received == [32, 32, 0, 32]
    near.write(bytes(64))
    clock.advance(0.0667)
    assert near.unsent() == 0
    near.faults = STALLED._replace(baud=9600)
    near.write(bytes(32))
    near.discard_unsent()
    near.faults = Faults(baud=9600)
    near.write(bytes(32))
    received = []
    for advance_s in (0.0001, 0.232, 0.002):
        clock.advance(advance_s)
        near.read()
        received.append(len(far.read()))
    assert received == [64, 0, 32], "the stalled ones are lost, and the stall goes on"
    near.discard_unsent()  # nothing waits


def test_bytes_that_are_delayed_behind_the_line_are_sent(opened: ExitStack) -> None:
    _, near = instant_pair(opened, Faults(delay=5.0))
    near.write(bytes(64))
    assert near.unsent() == 0


def test_the_wire_below_counts_and_discards_too(opened: ExitStack, monkeypatch: pytest.MonkeyPatch) -> None:
    _, near = instant_pair(opened, Faults(baud=300))
    discards = []
    monkeypatch.setattr(near._wire, "unsent", lambda: 7)
    monkeypatch.setattr(near._wire, "discard_unsent", lambda: discards.append(1))
    near.write(bytes(32))
    assert near.unsent() == 39
    near.discard_unsent()
    assert (near.unsent(), discards) == (39, [1])


def test_stalls_add_up_and_delayed_bytes_follow_them(opened: ExitStack, clock: Clock) -> None:
    far, near = instant_pair(opened, STALLED)
    near.write(b"a")
    near.write(b"b")
    near.faults = Faults(delay=0.1)
    near.write(b"c")
    received = []
    for _ in range(5):
        clock.advance(0.1)
        near.read()
        received.append(far.read())
    assert received == [b"", b"a", b"", b"b", b"c"]


def test_one_chunk_at_a_time_is_swapped_and_waits_a_tenth_of_a_second(opened: ExitStack, clock: Clock) -> None:
    far, near = instant_pair(opened, Faults(reorder=1.0))
    near.write(b"a")
    near.write(b"b")
    assert (far.read(), near.sent.reordered) == (b"ba", 1)
    near.write(b"c")
    for advance_s, arrived in ((0.099, b""), (0.001, b"c")):
        clock.advance(advance_s)
        near.read()
        assert far.read() == arrived
    assert near.sent.reordered == 2


def test_a_disconnect_of_either_direction_cuts_both_once(opened: ExitStack, clock: Clock) -> None:
    far, near = instant_pair(opened, Faults(disconnect=1.0, disconnect_time=0.2))
    for _ in range(2):
        far.write(b"cut")
        assert near.read() == b""
        near.write(b"lost")
        clock.advance(0.1)
    assert (near.received.disconnects, near.received.lost, near.sent.disconnects, near.sent.lost) == (1, 2, 0, 2)
    near.faults = CLEAR
    near.write(b"back")
    far.write(b"here")
    assert (far.read(), near.read()) == (b"back", b"here")


def test_a_closed_wire_is_closed_and_not_unplugged(opened: ExitStack) -> None:
    _, near = instant_pair(opened, Faults(unplugged=True, delay=1.0))
    near.close()
    near.close()
    assert near.fileno() == -1
    near.faults = Faults(unplugged=True)
    for use in (near.read, lambda: near.write(b"x")):
        with pytest.raises(DeviceError, match="is closed"):
            use()


def test_counters_have_their_names(opened: ExitStack) -> None:
    far, near = instant_pair(opened, Faults(drop=1.0))
    near.write(b"x")
    near.write(b"y")
    far.write(b"z")
    near.read()
    sent, received = near.fault_counts()
    names = ("chunks", "dropped", "lost", "stalls")
    assert ([sent[name] for name in names], [received[name] for name in names]) == ([2, 2, 0, 0], [1, 1, 0, 0])


@pytest.mark.parametrize(
    ("data", "bits"),
    [
        (b"", 0),
        (pack_frame(CanFrame(1, b"", extended=False)), 47),
        (pack_frame(CanFrame(1, b"1234", extended=False)), 79),
        (pack_frame(CanFrame(1, b"12345678")), 131),
        (pack_frame(CanFrame(1, b"12345678")) + pack_frame(CanFrame(1, b"1", extended=False)), 186),
        (bytes((1, 0, 0, 0, 15, *[0] * 11)), 111),  # a size that no frame has
    ],
)
def test_bytes_and_frames_take_their_bits(data: bytes, bits: int) -> None:
    assert line_bits(data, on_can=True) == bits
    assert line_bits(data, on_can=False) == 10 * len(data)


def test_a_seed_gives_each_direction_numbers_of_its_own(opened: ExitStack) -> None:
    far, near = instant_pair(opened, Faults(drop=0.5), seed=4)
    crossed = []
    for _ in range(64):
        near.write(b"x")
        far.write(b"x")
        crossed.append((far.read(), near.read()))
    assert len(set(crossed)) == 4

"""DroneCAN on a shared bus: node numbers, foreign controllers, noise."""

from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.dronecan.allocation import FOLLOWUP_TIMEOUT_NS, Allocator
from hil.links.dronecan.types import Allocation
from hil.links.wires.can_frame import unpack_frames
from tests.support.links.can_bench import exchange, records
from tests.support.links.dronecan_ends import NEUTRAL, PULSES, Board, device, host, report


def test_controllers_of_others_are_ignored() -> None:
    end, master = device(6), host(2)
    assert exchange(end, report(), master) == [report(PULSES[:2])]


def test_reports_of_a_foreign_controller_are_accepted() -> None:
    end, master = device(), host(own_device=False)
    exchange(master, ThrusterCommand(7, True, PULSES), end)
    assert exchange(end, report(armed=False), master) == [report(PULSES, sequence=7, frames=1)]
    (off,) = exchange(end, report(tuple(p + 1 for p in PULSES)), master)
    assert isinstance(off, ThrusterTelemetry)
    assert (off.sequence, off.pwm_us) == (7, tuple(p + 1 for p in PULSES))


def test_the_stm32_drives_stops_and_recovers_on_the_bus() -> None:
    board = Board()
    board.run(0.1)
    assert board.received
    assert not any(t.armed or t.timed_out for t in board.received)
    for sequence in range(1, 21):
        board.host.send(ThrusterCommand(sequence, True, (1500 + sequence,) * 6))
        board.run(0.02)
        last = board.received[-1]
        assert last == ThrusterTelemetry(sequence, True, False, (1500 + sequence,) * 6, 0, sequence, 0, 0)
    board.run(0.3)
    assert board.received[-1] == last._replace(armed=False, timed_out=True, pwm_us=NEUTRAL, watchdog_trips=1)
    assert board.stm32.watchdog_trips == 1
    board.host.send(ThrusterCommand(21, True, PULSES))
    board.run(0.02)
    assert board.received[-1] == ThrusterTelemetry(21, True, False, PULSES, 0, 21, 0, 1)
    board.host.send(ThrusterCommand(22, False, PULSES))
    board.run(0.02)
    assert (board.received[-1].armed, board.received[-1].pwm_us) == (False, NEUTRAL)
    for link in (board.host, board.end.link):
        assert (link.counters.malformed, link.counters.checksum_errors, link.counters.dropped_bytes) == (0, 0, 0)


def ask(allocator: Allocator, unique_id: bytes, preferred: int = 0) -> int:
    parts = [unique_id[:6], unique_id[6:12], unique_id[12:]]
    answers = [allocator.answer(Allocation(preferred, not i, part)) for i, part in enumerate(parts)]
    *first, last = answers
    assert first == [Allocation(0, False, unique_id[:6]), Allocation(0, False, unique_id[:12])]
    if last is None:
        return 0
    assert last.unique_id == unique_id
    return last.node_id


def test_the_allocator_gives_each_node_its_own_number() -> None:
    allocator = Allocator()
    allocator.see(125)
    allocator.see(50)
    uids = [bytes([number]) * 16 for number in range(1, 130)]
    assert ask(allocator, uids[0]) == 124
    assert ask(allocator, uids[1], 50) == 51
    assert ask(allocator, uids[2], 124) == 123
    assert ask(allocator, uids[0], 99) == 124, "the same node again"
    rest = [ask(allocator, uid, 1) for uid in uids[3:]]
    assert sorted(filter(None, rest)) == sorted(set(range(1, 126)) - {125, 50, 124, 51, 123})
    assert rest[-1] == 0


def test_the_allocator_discards_an_unfinished_exchange() -> None:
    allocator = Allocator()
    assert allocator.answer(Allocation(0, False, b"6bytes")) is None
    assert allocator.answer(Allocation(0, True, b"short")) is None
    assert allocator.answer(Allocation(0, True, b"abcdef"))
    allocator.expire(1000)
    assert allocator.due_ns == 1000 + FOLLOWUP_TIMEOUT_NS
    allocator.expire(allocator.due_ns)
    assert allocator.answer(Allocation(0, False, b"ghijkl")) is None


def test_11_bit_frames_are_ignored() -> None:
    output = host().encode(ThrusterCommand(1, True, PULSES))
    short = records(frame._replace(extended=False, id=frame.id & 0x7FF) for frame in unpack_frames(output))
    assert device().feed(short) == []

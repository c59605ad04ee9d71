"""DroneCAN on a shared bus: node numbers, foreign controllers, noise."""

from hil.links.contract import ThrusterCommand, ThrusterTelemetry
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


def test_11_bit_frames_are_ignored() -> None:
    output = host().encode(ThrusterCommand(1, True, PULSES))
    short = records(frame._replace(extended=False, id=frame.id & 0x7FF) for frame in unpack_frames(output))
    assert device().feed(short) == []

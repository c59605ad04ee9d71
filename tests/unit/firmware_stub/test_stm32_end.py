"""The STM32 on its end of a link: replies, line errors, time stamps."""

from collections.abc import Iterator

import pytest

from firmware_stub.stub import Stm32, Stm32End
from hil.common import clock
from hil.common.clock import now_ns
from hil.common.errors import DeviceError
from hil.links.contract import ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.wires.terminal import PtyHostWire, PtyWire
from tests.support.links.link_contract import nothing_leaks, read_messages, uuv_hil, wait_readable

MS = 1_000_000
FULL = (1900, 1100)


class Bench:
    """An STM32 with two thrusters on a pty, and the host's end of it."""

    def __init__(self) -> None:
        wire = PtyWire()
        self.end = Stm32End(Stm32(2), ThrusterLink(wire, uuv_hil()))
        self.host = ThrusterLink(PtyHostWire(wire.path), uuv_hil())

    def send(self, *data: bytes) -> None:
        """Put bytes on the wire and wait until they are at the other end."""
        self.host.wire.write(b"".join(data))
        assert wait_readable(self.end.link.wire)

    def received(self, count: int) -> list[ThrusterTelemetry]:
        """Return exactly `count` reports."""
        reports = read_messages(self.host, count) + self.host.receive()
        assert len(reports) == count
        return [report for report in reports if isinstance(report, ThrusterTelemetry)]


@pytest.fixture
def bench() -> Iterator[Bench]:
    with nothing_leaks():
        bench = Bench()
        bench.end.service(0)
        bench.received(1)
        yield bench
        bench.end.close()
        bench.host.close()


def frame(sequence: int, pwm_us: tuple[int, ...] = FULL) -> bytes:
    return uuv_hil().encode(ThrusterCommand(sequence, True, pwm_us))


def test_commands_read_before_the_process_was_stopped_are_refused(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.send(frame(7), frame(8))
    times = iter((0, 200 * MS + 1, 200 * MS + 2))
    monkeypatch.setattr(clock, "now_ns", lambda: next(times))
    assert bench.end.service(1 * MS) == 0
    monkeypatch.undo()
    bench.end.service(201 * MS)
    (report,) = bench.received(1)
    assert (report.pwm_us, report.frames, report.errors) == ((1500, 1500), 0, 2)


def test_each_command_is_acknowledged_with_its_sequence_number(bench: Bench) -> None:
    bench.send(frame(7), frame(8, (1600, 1600)), frame(9))
    assert bench.end.service(1 * MS) == 3
    answers = bench.received(3)
    assert [(a.sequence, a.pwm_us, a.age_us, a.frames) for a in answers] == [
        (7, FULL, 0, 1),
        (8, (1600, 1600), 0, 2),
        (9, FULL, 0, 3),
    ]
    assert (bench.end.stm32.sequence, bench.end.stm32.applied_ns) == (9, 1 * MS)


def test_the_time_at_which_the_outputs_apply_a_command_is_on_the_machines_clock(bench: Bench) -> None:
    before = now_ns()
    bench.send(frame(7))
    bench.end.service(1 * MS)
    executed = bench.end.command_ns
    assert before < executed < now_ns()
    bench.send(frame(6))
    bench.end.service(2 * MS)
    assert (bench.end.stm32.refused, bench.end.command_ns) == (1, executed), (
        "a command that arrives too late is not executed"
    )


def test_periodic_reports_have_the_age_of_the_command(bench: Bench) -> None:
    bench.send(frame(7))
    bench.end.service(5 * MS)
    bench.received(1)
    assert bench.end.deadline_ns == 205 * MS
    assert bench.end.service(204 * MS) == 0
    assert not wait_readable(bench.host.wire, 0.02)
    bench.end.service(205 * MS)
    assert bench.received(1)[0].age_us == 200_000


def test_line_errors_are_in_the_telemetry_and_get_no_reply(bench: Bench) -> None:
    damaged = frame(7)[:-1] + b"\0"
    report = uuv_hil().encode(ThrusterTelemetry(1, True, False, FULL, 0, 0, 0, 0))
    bench.send(damaged, frame(8, (1500,) * 3), report)
    assert bench.end.service(1 * MS) == 0
    assert not wait_readable(bench.host.wire, 0.02)
    assert bench.end.stm32.pwm_us == [1500, 1500]
    bench.end.service(200 * MS)
    (reported,) = bench.received(1)
    assert (reported.errors, reported.frames) == (3, 0)


def test_a_waiting_command_is_read_before_the_watchdog_is_checked(bench: Bench) -> None:
    bench.send(frame(1))
    bench.end.service(0)
    bench.send(frame(2))
    bench.end.service(500 * MS)  # we slept; the host did not
    assert bench.end.stm32.watchdog_trips == 0
    assert bench.end.stm32.pwm_us == list(FULL)
    bench.end.service(700 * MS)
    assert bench.end.stm32.watchdog_trips == 1
    assert bench.received(3)[-1].timed_out


def test_closing_stops_the_thrusters(bench: Bench) -> None:
    bench.send(frame(1))
    bench.end.service(0)
    bench.end.close()
    assert bench.end.stm32.pwm_us == [1500, 1500]
    with pytest.raises(DeviceError, match="closed"):
        bench.end.service(1)

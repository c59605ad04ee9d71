"""Benchmarks of a slave that ends, hangs or has another clock: each reports it."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from threading import Timer

import pytest

from hil.bench.harness import Bench, Process
from hil.bench.soak_run import Soak, Soaking
from hil.bench.stream_run import Listener, Listening

KILL_S = 6.0  # after which a hanging slave is killed, as its end would take longer than the tests have


class SlaveUnderTest:
    """The slave that was started last."""

    slave: Process
    hangs = False

    def hit(self, number: int) -> None:
        """Send it a signal, once."""
        if not self.hangs:
            self.hangs = True
            os.kill(self.slave.pid, number)
            Timer(KILL_S, self.slave._process.kill).start()


@pytest.fixture
def victim(monkeypatch: pytest.MonkeyPatch) -> Iterator[SlaveUnderTest]:
    found, start = SlaveUnderTest(), Bench.start_slave

    def start_slave(bench: Bench) -> Process:
        found.slave, found.hangs = start(bench), False
        return found.slave

    monkeypatch.setattr(Bench, "start_slave", start_slave)
    yield found
    found.slave._process.kill()


def stream(seconds: float, watch: Callable[[float], None] = lambda _: None) -> Listening:
    """Measure the stream of a new slave."""
    with Bench("paper_field") as bench:
        slave = bench.start_slave()
        with Listener(bench.endpoint, bench.scenario) as listener:
            return listener.listen(seconds, slave, watch)


def test_stream_reports_an_interruption_and_its_missing_samples(victim: SlaveUnderTest) -> None:
    def watch(done: float) -> None:
        if done >= 0.2 and not victim.hangs:
            victim.hit(signal.SIGSTOP)
            Timer(1.4, os.kill, (victim.slave.pid, signal.SIGCONT)).start()

    received = stream(3.0, watch)
    assert any("the vehicle was out of reach meanwhile (times: " in text for text in received.warnings)
    assert received.streams["imu"]["missing"] > 20.0


def soak(victim: SlaveUnderTest, number: int, seconds: float, leave_every: float, stop_after_s: float = 60.0) -> Soak:
    """Send the signal after three observations, and request the end so many seconds later."""
    read_fd, write_fd = os.pipe()
    observations = []
    stop = Timer(stop_after_s, os.write, (write_fd, b"x"))

    def watch(look: object) -> None:
        observations.append(look)
        if len(observations) == 3:
            victim.hit(number)
            stop.start()

    with Bench("paper_field") as bench:
        soak_result = Soaking(bench, 0.3, watch, read_fd).run(seconds, leave_every)
    stop.cancel()
    stop.join()
    os.close(read_fd)
    os.close(write_fd)
    return soak_result


def test_soak_reports_a_slave_that_hangs(victim: SlaveUnderTest) -> None:
    began = time.monotonic()
    soak_result = soak(victim, signal.SIGSTOP, 5.0, 60.0)
    assert time.monotonic() - began < 5.0 + 30.0, "a hung slave is not requested to end"
    ((at_s, seconds, reason),) = soak_result.silences
    assert 0.0 < at_s < at_s + seconds
    assert at_s + seconds == pytest.approx(5.0, abs=3.0)
    assert reason == "uuv1 did not answer"
    assert soak_result.observations[-1].real_time_factor != soak_result.observations[-1].real_time_factor, (
        "nobody knows"
    )


@pytest.mark.parametrize("leave_every", [1.5, 60.0])
def test_soak_can_be_ended_while_its_slave_hangs(leave_every: float, victim: SlaveUnderTest) -> None:
    began = time.monotonic()
    found = soak(victim, signal.SIGSTOP, 60.0, leave_every, stop_after_s=2.5)
    assert time.monotonic() - began < 40.0, "usually 6 s: it ends before the 60 s that it was to last"
    assert len(found.observations) >= 3
    assert len(found.silences) == 1

"""Commands over lines that store what they cannot carry, such as a serial bridge or a radio; in simulated time."""

from collections import deque
from itertools import pairwise
from random import Random

import pytest

from firmware_stub.stub import Stm32
from hil.common.clock import NS_PER_MS, NS_PER_S
from hil.links.contract import Message, ThrusterCommand, ThrusterLink, ThrusterTelemetry, Wire
from hil.links.frame.protocol import open_frame
from hil.links.pace import LEAST_RATE, MOST, EchoPace
from hil.scenario.records import Link
from hil.slave.drivers.ends import end_protocol

CHANNELS, HZ, NEUTRAL = 6, 50, 1500
REPORT = len(
    open_frame("device", CHANNELS, "uuv_hil").encode(ThrusterTelemetry(1, True, False, (1600,) * CHANNELS, 0, 0, 0, 0))
)


class Line:
    """One direction of a line: it stores all bytes, carries `rate` bytes a second, and delays them by `delay_ns`."""

    def __init__(self, rate: float, delay_ns: int = 0) -> None:
        self.rate, self.delay_ns = rate, delay_ns
        self._free_ns = 0.0
        self._bytes = deque[tuple[float, bytes]]()

    def put(self, data: bytes, now: int) -> None:
        self._free_ns = max(self._free_ns, now) + len(data) / self.rate * NS_PER_S
        self._bytes.append((self._free_ns + self.delay_ns, data))

    def take(self, now: int) -> bytes:
        taken = b""
        while self._bytes and self._bytes[0][0] <= now:
            taken += self._bytes.popleft()[1]
        return taken


class Bridge(Wire):
    """The host's end of a line that never tells how much waits."""

    name = "bridge"

    def __init__(self, simulated: "Simulated") -> None:
        self._simulated = simulated

    def fileno(self) -> int:
        return -1

    def read(self) -> bytes:
        return self._simulated.back.take(self._simulated.now)

    def write(self, data: bytes) -> int:
        self._simulated.out.put(data, self._simulated.now)
        return len(data)

    def close(self) -> None: ...


class Simulated:
    """Host, line and STM32, in steps of 1 ms. `lost`: share of the reports that are lost; 1: no telemetry."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, rate: float, delay_ns: int = 0, lost: float = 0.0,
        protocol: str = "frame", periodic: bool = False,
    ) -> None:  # fmt: skip
        self.now, self._lost, self._random = NS_PER_S, lost, Random(1)
        self.out, self.back = Line(rate, delay_ns), Line(rate, delay_ns)
        self.stm32 = Stm32(CHANNELS)
        link = Link()._replace(protocol=protocol)
        self._device, host = end_protocol(link, "device", CHANNELS), end_protocol(link, "host", CHANNELS)
        self.pace = EchoPace(host.echoes_sequence, by_count=not periodic)
        self._periodic = periodic
        self._host = ThrusterLink(Bridge(self), host, self.pace)
        self._sequence = self.applied = 0
        monkeypatch.setattr("hil.links.contract.now_ns", lambda: self.now)

    def run(self, seconds: float, commands: bool = True) -> None:
        end = self.now + round(seconds * NS_PER_S)
        while self.now < end:
            self.now += NS_PER_MS
            if commands and self.now % (NS_PER_S // HZ) == 0:
                self._sequence += 1
                self._host.send(ThrusterCommand(self._sequence, True, (1600,) * CHANNELS))
            self._serve_stm32()
            if commands:  # without, the host is gone
                self._host.receive()
                self._host.tick(self.now)

    def seconds_to_neutral(self) -> float:
        """Return how long the thrusters turn after the host has been killed."""
        start = self.now
        while self.stm32.pwm_us[0] != NEUTRAL and self.now - start < 60 * NS_PER_S:
            self.run(0.001, commands=False)
        return (self.now - start) / NS_PER_S

    def _serve_stm32(self) -> None:
        received: list[Message] = self._device.feed(self.out.take(self.now))
        for command in received:
            assert isinstance(command, ThrusterCommand)
            self.applied += self.stm32.command(command, self.now)
            if not self._periodic:
                self._report()
        if self.now % (NS_PER_S // 10) == 0 if self._periodic else self.stm32.tick(self.now):
            self._report()
        own = self._device.replies() + (self._device.tick(self.now) if self.now >= self._device.deadline_ns else b"")
        if own:
            self.back.put(own, self.now)

    def _report(self) -> None:
        report = self._device.encode(self.stm32.telemetry(self.now))
        if self._random.random() >= self._lost:
            self.back.put(report, self.now)


RATES = [1e6, 5000, 2000, 1000, 700, 500, 11 * REPORT]
MOMENTS = [0.3, 1.0, 7.35]
ARMING = 69  # bytes of a MAVLink command that requests arming, too, as the first ones do


@pytest.mark.parametrize(
    ("protocol", "rate", "moment"),
    [
        *(("frame", rate, moment) for rate in RATES for moment in MOMENTS),
        *(("mavlink", rate, moment) for rate in RATES for moment in MOMENTS if rate >= 10 * ARMING or moment > 0.5),
    ],
)
def test_the_thrusters_stop_in_time_on_every_line_that_carries_ten_frames(
    monkeypatch: pytest.MonkeyPatch, protocol: str, rate: float, moment: float
) -> None:
    """The watchdog needs 0.2 s of it. Without pacing it takes 3 s at 1000 B/s and 9 s at 500 B/s."""
    simulated = Simulated(monkeypatch, rate, protocol=protocol)
    simulated.run(moment)
    assert simulated.seconds_to_neutral() <= 0.5 + (ARMING if protocol == "mavlink" else REPORT) / rate


@pytest.mark.parametrize("rate", [11 * REPORT, 500, 1000])
def test_a_slow_line_carries_the_newest_commands_and_is_reported(monkeypatch: pytest.MonkeyPatch, rate: float) -> None:
    simulated = Simulated(monkeypatch, rate)
    simulated.run(5.0)
    before = simulated.applied
    simulated.run(5.0)
    assert simulated.pace.is_slow
    assert (simulated.applied - before) / 5.0 == pytest.approx(rate / REPORT, rel=0.15), "the line is used in full"
    assert simulated.pace.rate == pytest.approx(rate / REPORT, rel=0.25)
    assert simulated.pace.rate >= LEAST_RATE


def test_a_line_below_ten_commands_a_second_is_too_slow_to_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    simulated = Simulated(monkeypatch, 7 * REPORT)
    simulated.run(10.0)
    assert simulated.pace.is_slow
    assert 0 < simulated.pace.rate < LEAST_RATE


@pytest.mark.parametrize(
    ("delay_ms", "lost"), [(0, 0.0), (5, 0.0), (5, 0.3), (100, 0.0), (300, 0.0), (0, 1.0)], ids=str
)
def test_a_fast_line_carries_all_commands(monkeypatch: pytest.MonkeyPatch, delay_ms: int, lost: float) -> None:
    """Whatever its delay, and also without reports."""
    simulated = Simulated(monkeypatch, 1e6, delay_ms * NS_PER_MS, lost)
    simulated.run(20.0)
    before = simulated.applied
    simulated.run(4.0)
    assert simulated.applied - before >= 0.95 * 4 * HZ
    assert not simulated.pace.is_slow


@pytest.mark.parametrize(("lost", "share"), [(0.0, 1.0), (0.02, 0.9), (0.3, 0.3)])
def test_lost_reports_without_sequence_numbers_do_not_count_as_commands_on_the_line(
    monkeypatch: pytest.MonkeyPatch, lost: float, share: float
) -> None:
    """Those of a second at a time, and a share of the others."""
    simulated = Simulated(monkeypatch, 1e6, 5 * NS_PER_MS, lost, "mavlink")
    for _ in range(10):
        simulated.run(5.0)
        simulated.back.rate = 0.001
        simulated.run(1.0)
        simulated.back = Line(1e6, 5 * NS_PER_MS)
    simulated.run(3.0)
    before = simulated.applied
    simulated.run(10.0)
    assert simulated.applied - before >= share * 10 * HZ
    assert simulated.pace.rate >= LEAST_RATE


def test_a_foreign_stm32_with_periodic_reports_gets_all_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its reports, 10 a second, have no sequence numbers."""
    simulated = Simulated(monkeypatch, 1e6, protocol="mavlink", periodic=True)
    simulated.run(5.0)
    before = simulated.applied
    simulated.run(4.0)
    assert simulated.applied - before >= 0.95 * 4 * HZ


def test_a_line_that_becomes_slow_and_fast_again_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    simulated = Simulated(monkeypatch, 1e6)
    simulated.run(3.0)
    simulated.out.rate = simulated.back.rate = 500
    simulated.run(3.0)
    assert simulated.pace.is_slow
    simulated.out.rate = simulated.back.rate = 1e6
    simulated.run(3.0)
    before = simulated.applied
    simulated.run(2.0)
    assert (simulated.applied - before, simulated.pace.is_slow) == (2 * HZ, False)


def test_lost_reports_do_not_stop_the_thrusters() -> None:
    """A command comes before the watchdog trips, and memory does not grow."""
    pace = EchoPace(watchdog_ns=100 * NS_PER_MS)
    for number in range(10):
        pace.add_sent(number, number * 20 * NS_PER_MS)
        pace.add_answer(number, number * 20 * NS_PER_MS + NS_PER_MS)
    sent = list[int]()
    for now in range(NS_PER_S, 100 * NS_PER_S, NS_PER_MS):
        if pace.due_ns(now) <= now:
            pace.add_sent(10 + len(sent), now)
            sent.append(now)
    assert max(later - earlier for earlier, later in pairwise(sent)) < 100 * NS_PER_MS
    assert len(pace._flight) <= MOST

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
        protocol: str = "frame", periodic: bool = False
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
    simulated.run(8.0)
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
    for now in range(NS_PER_S, 30 * NS_PER_S, NS_PER_MS):
        if pace.due_ns(now) <= now:
            pace.add_sent(10 + len(sent), now)
            sent.append(now)
    assert max(later - earlier for earlier, later in pairwise(sent)) < 100 * NS_PER_MS
    assert len(pace._flight) <= MOST


def drive(pace: EchoPace, answered: int, trip_ms: int = 5, each: int = 1, start_ms: int = 0) -> int:
    """Offer a command every 20 ms for half a second, and answer the first of them; return the time (ms) behind it."""
    start_ms = start_ms or 10_000
    if start_ms == 10_000:
        pace.add_offered(start_ms * NS_PER_MS)
    events = []
    for number in range(answered):
        at_ms = start_ms + 20 * number
        events.append((at_ms, number, pace.add_sent))
        if (number + 1) % each == 0:
            events.append((at_ms + trip_ms, number, pace.add_answer))
    for at_ms, number, act in sorted(events, key=lambda event: event[0]):
        act(start_ms + number, at_ms * NS_PER_MS)
    for number in range(1, 26):
        pace.add_offered((start_ms + 20 * number) * NS_PER_MS)
    return start_ms + 500


@pytest.mark.parametrize(("watchdog_ms", "pause_ms"), [(1000, 150), (100, 75)])
def test_two_commands_are_on_a_line_whose_rate_is_not_known(watchdog_ms: int, pause_ms: int) -> None:
    pace = EchoPace(watchdog_ns=watchdog_ms * NS_PER_MS)

    def due_ms(now_ms: int) -> int:
        return pace.due_ns(now_ms * NS_PER_MS) // NS_PER_MS

    pace.add_sent(1, 1000 * NS_PER_MS)
    assert due_ms(1001) == 1001
    pace.add_sent(2, 1010 * NS_PER_MS)
    assert due_ms(1999) == 1010 + pause_ms
    assert due_ms(2000) == 2000, "a line without telemetry"
    pace.add_answer(9, 2020 * NS_PER_MS)  # of none of them
    assert due_ms(2021) == 2020 + pause_ms
    pace.add_answer(1, 2030 * NS_PER_MS)
    assert due_ms(2031) == 2031


@pytest.mark.parametrize(
    ("answered", "rates", "slow"),
    [
        ([25, 20], [50, 40], [False, False]),
        ([19, 19, 25, 25], [38, 38, 50, 50], [False, True, True, False]),
        ([19, 25, 19, 25], [38, 50, 38, 50], [False] * 4),
        ([10, 10, 0, 0, 0, 0, 0], [20, 20, 0, 0, 0, 0, 0], [False, True, True, True, True, True, False]),  # silent
    ],
)
def test_a_line_is_slow_after_two_periods_below_eight_tenths(
    answered: list[int], rates: list[float], slow: list[bool]
) -> None:
    pace, at_ms, found = EchoPace(), 0, []
    for count in answered:
        at_ms = drive(pace, count, start_ms=at_ms)
        found.append((pace.rate, pace.is_slow))
    assert found == list(zip(rates, slow, strict=True))


def test_a_pause_of_this_process_is_not_measured() -> None:
    pace = EchoPace()
    end_ms = drive(pace, 20)
    pace.add_offered((end_ms + 2000) * NS_PER_MS)
    assert pace.rate == 40
    pace.add_offered((end_ms + 3999) * NS_PER_MS)
    assert pace.rate == 0


@pytest.mark.parametrize(
    ("trip_ms", "each", "window"), [(5, 1, 5), (60, 1, 5), (100, 1, 7), (100, 5, 11), (200, 1, 13)]
)
def test_the_window_is_what_the_line_carries_in_a_round_trip(trip_ms: int, each: int, window: int) -> None:
    """Of 50 commands a second, a quarter more, and the commands that one report answers."""
    pace = EchoPace()
    end_ms = drive(pace, 25, trip_ms, each)
    drive(pace, 25, trip_ms, each, end_ms)
    for number in range(40):
        now = (end_ms + 500 + number) * NS_PER_MS
        if pace.due_ns(now) > now:
            break
        pace.add_sent(number, now)
    assert len(pace._flight) == window


def test_a_report_without_a_number_answers_the_oldest_command_that_is_not_forgotten() -> None:
    pace = EchoPace(has_sequence=False, by_count=True)
    for number, at_ms in enumerate((1000, 1100, 1200, 1201, 1202)):
        pace.add_sent(number, at_ms * NS_PER_MS)
    pace.add_answer(-1, 1600 * NS_PER_MS)  # the first is forgotten, the second is answered
    assert [number for number, _ in pace._flight] == [2, 3, 4]
    due = [pace.due_ns(at_ms * NS_PER_MS) // NS_PER_MS for at_ms in (2599, 2600, 2600)]
    assert due == [1750, 1750, 2600], "two round trips of silence behind the last command: the others were lost"
    numbered = EchoPace(has_sequence=True, by_count=True)
    numbered.add_sent(1, NS_PER_S)
    numbered.add_answer(-1, NS_PER_S + 1)
    assert len(numbered._flight) == 1


@pytest.mark.parametrize(
    ("answered", "has_sequence", "by_count"), [(23, False, True), (22, False, False), (25, True, False)]
)
def test_a_report_for_each_command_is_found_out(answered: int, has_sequence: bool, by_count: bool) -> None:
    pace = EchoPace(has_sequence)
    end_ms = drive(pace, answered)
    pace.add_sent(1, end_ms * NS_PER_MS)
    pace.add_answer(-1, (end_ms + 1) * NS_PER_MS)
    assert (not pace._flight) == by_count

"""Comparison of two clocks over a network with random, asymmetric delays."""

import random

import pytest

from hil.network.clock_offset import MAX_DRIFT, ClockOffset, Estimate

S = 1_000_000_000
MS = 1_000_000


class OtherClock:
    """A clock that is wrong by `offset` ns at time 0 and gains `drift` ns a ns."""

    def __init__(self, offset: int, drift: float = 0.0) -> None:
        self.offset, self.drift = offset, drift

    def read(self, time_ns: int) -> int:
        return time_ns + self.error(time_ns)

    def error(self, time_ns: int) -> int:
        return self.offset + round(self.drift * time_ns)


def exchange(clock: ClockOffset, other: OtherClock, sent: int, out: int, back: int, thinking: int = 100_000) -> None:
    """Do one exchange that takes `there` ns to the peer and `back` ns back."""
    received = sent + out + thinking + back
    clock.add(sent, other.read(sent + out), other.read(sent + out + thinking), received)


def compare(other: OtherClock, seconds: int, seed: int, least: int = 300_000, jitter_ms: float = 5.0) -> ClockOffset:
    """Return the offsets of four exchanges a second that take three times as long back as to the peer."""
    clock, generator = ClockOffset(), random.Random(seed)
    for tick in range(4 * seconds):
        there = least + round(generator.expovariate(1 / (jitter_ms * MS)))
        back = 3 * least + round(generator.expovariate(1 / (jitter_ms * MS)))
        exchange(clock, other, tick * S // 4, there, back)
    return clock


def estimate(clock: ClockOffset, time_ns: int) -> Estimate:
    found = clock.at(time_ns)
    assert found is not None
    return found


def test_there_is_no_estimate_before_the_first_exchange() -> None:
    assert ClockOffset().at(0) is None


@pytest.mark.parametrize("offset", [0, 5 * S, -3600 * S])
@pytest.mark.parametrize("drift", [0.0, 40e-6, -80e-6])
def test_the_true_offset_lies_within_the_uncertainty(offset: int, drift: float) -> None:
    other = OtherClock(offset, drift)
    for seed in range(5):
        for seconds in (1, 5, 20, 100):
            now = seconds * S
            found = estimate(compare(other, seconds, seed), now)
            assert abs(found.offset_ns - other.error(now)) <= found.uncertainty_ns
            assert found.uncertainty_ns < (6 if seconds == 1 else 4) * MS


def test_the_shortest_round_trip_gives_the_estimate() -> None:
    clock, other = ClockOffset(), OtherClock(7 * MS)
    exchange(clock, other, 0, 300 * MS, 1 * MS)
    assert estimate(clock, 0).uncertainty_ns > 100 * MS
    exchange(clock, other, S // 2, 100_000, 100_000)
    found = estimate(clock, S // 2)
    assert found.offset_ns == pytest.approx(7 * MS, abs=1000)
    assert found.uncertainty_ns == pytest.approx(100_000, abs=60_000)
    exchange(clock, other, S, 300 * MS, 1 * MS)
    assert abs(estimate(clock, S).offset_ns - 7 * MS) < 1000


@pytest.mark.parametrize("drift", [30e-6, -60e-6])
def test_drift_is_measured_and_extrapolated(drift: float) -> None:
    other = OtherClock(S, drift)
    clock = compare(other, 60, seed=3, jitter_ms=1.0)
    offset = estimate(clock, 60 * S)
    assert offset.drift == pytest.approx(drift, abs=10e-6)
    later = 90 * S
    offset = estimate(clock, later)
    assert abs(offset.offset_ns - other.error(later)) <= offset.uncertainty_ns
    assert offset.uncertainty_ns < round(MAX_DRIFT * 30 * S) / 2 + MS, "less than without the measured drift"


def test_uncertainty_grows_without_exchanges() -> None:
    clock = compare(OtherClock(0), 2, seed=1)
    assert estimate(clock, 60 * S).uncertainty_ns > estimate(clock, 2 * S).uncertainty_ns + 5 * MS


@pytest.mark.parametrize("step", [3600 * S, -20 * MS])
def test_a_clock_step_is_detected_at_once(step: int) -> None:
    other = OtherClock(4 * S)
    clock = compare(other, 10, seed=2)
    other.offset += step
    exchange(clock, other, 11 * S, 400_000, 400_000)
    found = estimate(clock, 11 * S)
    assert clock.steps == 1
    assert abs(found.offset_ns - other.error(11 * S)) <= found.uncertainty_ns < MS


def test_an_exchange_that_was_overtaken_is_no_step_and_a_clock_of_the_whole_machine_is_one() -> None:
    clock, same = ClockOffset(), OtherClock(0)
    for sent in (3600 * S, 3599 * S, 3601 * S):
        exchange(clock, same, sent, MS, MS)
    assert clock.steps == 0
    exchange(clock, same, 20 * S, MS, MS)  # both clocks were set back
    assert clock.steps == 1
    exchange(clock, same, 21 * S, MS // 10, MS // 10)
    found = clock.at(21 * S)
    assert found is not None
    assert found.uncertainty_ns < MS


@pytest.mark.parametrize(
    ("sent", "arrived", "answered", "received"),
    [(0, 10, 5, 20), (100, 10, 20, 90), (0, 0, 11 * S, 12 * S), (0, 0, 30, 20)],
)
def test_impossible_exchanges_are_counted(sent: int, arrived: int, answered: int, received: int) -> None:
    clock = ClockOffset()
    clock.add(sent, arrived, answered, received)
    assert clock.malformed == 1
    assert clock.at(0) is None


def test_memory_is_bounded_to_the_requested_number_of_points() -> None:
    other = OtherClock(0, 50e-6)
    short, long = ClockOffset(8), ClockOffset(1000)
    for second in range(500):
        for clock in (short, long):
            exchange(clock, other, second * S, 200_000, 200_000)
    assert len(short._points) == 8
    assert abs(estimate(long, 100 * S).offset_ns - other.error(100 * S)) < 300_000
    assert estimate(short, 100 * S).uncertainty_ns > estimate(long, 100 * S).uncertainty_ns

"""The rate keeper's schedule, the histogram's error bounds, and times of the wall clock."""

import math
from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common import clock
from hil.common.clock import LEARN_NS, MAX_FRESH, MAX_LEAD_NS, Histogram, RateKeeper


def test_schedule_is_absolute() -> None:
    keeper = RateKeeper(1000, start_ns=0)
    assert keeper.due(999) == 0
    assert keeper.due(1400) == 1
    assert keeper.deadline_ns == 2000, "a late wake-up does not move the schedule"
    assert keeper.due(1999) == 0
    assert keeper.due(4100) == 3
    assert keeper.deadline_ns == 5000
    assert keeper.due_total == 4
    assert keeper.skipped == 0


def test_a_long_stall_is_skipped_and_counted() -> None:
    keeper = RateKeeper(1000, start_ns=0, most_due=5)
    assert keeper.due(100_500) == 5
    assert keeper.skipped == 95
    assert keeper.deadline_ns == 101_000
    assert keeper.lateness.maximum == 99_500


def test_unread_lateness_takes_bounded_memory() -> None:
    """An hour at 400 Hz has every fourth step late by a period."""
    keeper, now, late = RateKeeper(1000, start_ns=0), 0, 0
    for number in range(400 * 60):
        now += 1000
        late = 1000 + number % 7 if number % 4 == 3 else number % 7
        keeper.due(now + late)
    assert len(keeper._fresh) <= MAX_FRESH + 1
    assert keeper.lateness.count >= keeper.due_total - MAX_FRESH
    assert keeper.lateness.count == keeper.due_total, "each is counted, and once"
    assert keeper.lateness.maximum == 1006
    assert not keeper._fresh


def test_the_loop_does_not_wait_while_lateness_is_counted() -> None:
    keeper = RateKeeper(1000, start_ns=0)
    with keeper._counting:
        for number in range(1, MAX_FRESH + 100):
            assert keeper.due(1000 * number) == 1
        assert len(keeper._fresh) == MAX_FRESH + 99
    assert keeper.lateness.count == MAX_FRESH + 99


@given(st.lists(st.integers(0, 10**15), min_size=1, max_size=200), st.floats(0.01, 1.0))
def test_quantiles_are_never_too_small_and_close(values: list[int], share: float) -> None:
    histogram = Histogram()
    for value in values:
        histogram.add(value)
    exact = sorted(values)[math.ceil(share * len(values)) - 1]
    found = histogram.quantile(share)
    assert exact <= found <= max(exact * 1.25, 7)
    assert histogram.quantile(1.0) == max(values)


def test_the_quantile_of_an_empty_histogram_is_zero() -> None:
    assert Histogram().quantile(0.5) == 0


def test_wall_clock_conversion_round_trip() -> None:
    now = clock.now_ns()
    assert clock.from_wall_ns(clock.to_wall_ns(now)) == now


def test_the_parent_may_pass_the_start_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UUV_HIL_EXEC_NS", "123456789")
    assert clock.process_start_ns() == 123456789


def test_the_rate_keeper_adapts_to_the_wake_up_latency(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = count(10**12, 1000)  # each look at the clock takes 1 us
    monkeypatch.setattr(clock, "now_ns", lambda: next(ticks))
    now_ns = clock.now_ns
    keeper = RateKeeper(10**9, now_ns())
    for _ in range(100):  # each time too late
        keeper.deadline_ns = now_ns() - 1
        keeper.on_wakeup()
    learnt = keeper.lead_ns
    assert learnt == 100 * LEARN_NS
    keeper.deadline_ns = now_ns() + 20_000
    assert keeper.on_wakeup() >= keeper.deadline_ns, "a little early: it waits out the rest"
    assert keeper.lead_ns == learnt - 3 * LEARN_NS
    keeper.deadline_ns = now_ns() + 10**9
    before = keeper.lead_ns
    assert keeper.on_wakeup() < keeper.deadline_ns, "far too early: something else has woken it"
    assert keeper.lead_ns == before
    assert keeper.timeout() == pytest.approx(1.0, abs=1e-4)
    for _ in range(1000):
        keeper.deadline_ns = now_ns() - 1
        keeper.on_wakeup()
    assert keeper.lead_ns == MAX_LEAD_NS
    keeper.deadline_ns = now_ns() - 1
    assert keeper.timeout() == 0.0


def test_the_boot_is_identified() -> None:
    assert len(clock.boot_id()) == 36
    assert clock.boot_id() == clock.boot_id()

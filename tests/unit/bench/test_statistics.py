"""The statistics of benchmarks, against numbers worked out by hand or by other implementations."""

import math
import random

import pytest

from hil.bench.statistics import Interval, median, median_interval, ratio_interval, spread
from hil.client.delay import quantiles
from hil.common.clock import Histogram
from hil.common.quantiles import quantile


@pytest.mark.parametrize(
    ("share", "value"),
    [(0.0, 15.0), (0.05, 15.0), (0.3, 20.0), (0.4, 20.0), (0.5, 35.0), (1.0, 50.0)],
)
def test_quantiles_are_of_nearest_rank(share: float, value: float) -> None:
    assert quantile([15.0, 20.0, 35.0, 40.0, 50.0], share) == value  # the usual example of the method


def test_all_quantile_functions_agree() -> None:
    """The histograms are those of measurements, loopback and delays: small whole numbers here."""
    for count, share in ((100, 0.07), (100, 0.55), (100, 0.99), (7, 0.5), (1000, 0.999)):
        histogram, values = Histogram(), [number % 8 for number in range(count)]
        for value in values:
            histogram.add(value)  # those below 8 have bins of their own
        assert histogram.quantile(share) == quantile(sorted(values), share)
    assert quantiles(list(range(1_000_000, 101_000_000, 1_000_000)))[:3] == (50.0, 90.0, 99.0)


def test_spread_is_the_interquartile_range() -> None:
    assert spread([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]) == 6.0 - 2.0
    assert spread([3.0]) == 0.0


def test_statistics_of_no_values_are_nan() -> None:
    assert all(math.isnan(value) for value in (median([]), quantile([], 0.5), spread([])))
    assert all(map(math.isnan, median_interval([])))
    assert all(map(math.isnan, ratio_interval([], [1.0])))
    assert all(map(math.isnan, ratio_interval([0.0] * 5, [1.0] * 5)))


def test_the_interval_of_equal_values_is_that_value() -> None:
    assert median_interval([7.0] * 9) == Interval(7.0, 7.0)
    assert ratio_interval([2.0] * 9, [3.0] * 9) == Interval(1.5, 1.5)


def test_the_interval_contains_the_true_median_at_its_stated_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.bench.statistics.RESAMPLES", 400)  # for speed
    generator = random.Random(5)
    trials, covered = 120, 0
    for seed in range(trials):
        values = [generator.expovariate(1.0) for _ in range(25)]
        covered += median_interval(values, 0.9, seed).holds(math.log(2.0))
    assert 0.82 <= covered / trials <= 0.98


def test_more_values_narrow_the_interval() -> None:
    generator = random.Random(6)
    few, many = ([generator.gauss(10.0, 1.0) for _ in range(size)] for size in (10, 400))
    narrow, wide = (interval.high - interval.low for interval in map(median_interval, (many, few)))
    assert narrow < wide / 3


def autoregressive_series(generator: random.Random, count: int, correlation: float) -> list[float]:
    """Return a first-order autoregressive series (AR(1)) around 20."""
    state, series = generator.gauss(0.0, 1.0) / math.sqrt(1.0 - correlation**2), []
    for _ in range(count):
        state = correlation * state + generator.gauss(0.0, 1.0)
        series.append(20.0 + state)
    return series


def test_correlated_values_are_resampled_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two series of one process seem to differ in some five of a hundred pairs, not in a quarter."""
    monkeypatch.setattr("hil.bench.statistics.RESAMPLES", 150)  # for speed
    generator, trials = random.Random(7), 60
    false_counts = {True: 0, False: 0}
    for _ in range(trials):
        one, other = (autoregressive_series(generator, 200, 0.54) for _ in range(2))
        for block in false_counts:
            false_counts[block] += not ratio_interval(one, other, block=block).holds(1.0)
    assert false_counts[False] / trials > 0.15, "the fault"
    assert false_counts[True] / trials <= 0.12


def test_block_intervals_of_equal_and_of_few_values_are_defined() -> None:
    assert median_interval([7.0] * 9, block=True) == Interval(7.0, 7.0)
    assert median_interval([7.0], block=True) == Interval(7.0, 7.0)
    assert all(map(math.isnan, median_interval([], block=True)))


def test_a_ratio_needs_medians_above_zero() -> None:
    assert all(map(math.isnan, ratio_interval([-2.0] * 5, [-3.0] * 5)))
    assert all(map(math.isnan, ratio_interval([2.0] * 5, [-3.0] * 5)))


def test_the_same_seed_gives_the_same_interval() -> None:
    values = [float(value % 7) for value in range(50)]
    assert median_interval(values, seed=3) == median_interval(values, seed=3)

"""The statistics of benchmarks, against numbers worked out by hand or by other implementations."""

import math

import pytest

from hil.bench.record import median, spread
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

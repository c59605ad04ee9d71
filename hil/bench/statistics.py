"""Medians and spread, and the record of an interval."""

import statistics
from collections.abc import Sequence
from math import nan
from typing import NamedTuple

from hil.common.quantiles import quantile


class Interval(NamedTuple):
    """Confidence interval of a figure, from `low` to `high`."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether `value` is inside, ends included."""
        return self.low <= value <= self.high


def median(values: Sequence[float]) -> float:
    """Return the middle value, or the mean of the two middle ones; nan without values."""
    return statistics.median(values) if values else nan


def spread(values: Sequence[float]) -> float:
    """Return the range of the middle half of the values (the interquartile range); nan without values."""
    ordered = sorted(values)
    return quantile(ordered, 0.75) - quantile(ordered, 0.25)

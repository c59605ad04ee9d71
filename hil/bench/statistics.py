"""Medians and spread."""

import statistics
from collections.abc import Sequence
from math import nan

from hil.common.quantiles import quantile


def median(values: Sequence[float]) -> float:
    """Return the middle value, or the mean of the two middle ones; nan without values."""
    return statistics.median(values) if values else nan


def spread(values: Sequence[float]) -> float:
    """Return the range of the middle half of the values (the interquartile range); nan without values."""
    ordered = sorted(values)
    return quantile(ordered, 0.75) - quantile(ordered, 0.25)

"""Medians, quantiles, how far they scatter, and whether two of them really differ."""

import random
from collections.abc import Sequence
from math import isfinite, nan
from typing import NamedTuple

RESAMPLES = 2000
CONFIDENCE = 0.95
MOST_RESAMPLED = 2000  # values; more of them are thinned evenly, which leaves their median as it is


class Interval(NamedTuple):
    """Between `low` and `high` a figure lies, with the confidence that was asked for."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Whether `value` is inside, ends included."""
        return self.low <= value <= self.high


def quantile(ordered: Sequence[float], share: float) -> float:
    """The smallest of the `ordered` values that at least `share` (0..1) of all do not exceed; nan of none.

    Nearest rank: what is given out was measured, nothing between two values is made up.
    """
    if not ordered:
        return nan
    rank = -(-share * len(ordered) // 1)  # rounded up
    return ordered[min(max(int(rank), 1), len(ordered)) - 1]


def median(values: Sequence[float]) -> float:
    """The middle one, or the mean of the two middle ones; nan of none."""
    ordered = sorted(values)
    if not ordered:
        return nan
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2


def spread(values: Sequence[float]) -> float:
    """The range of the middle half of the values (the interquartile range); nan of none."""
    ordered = sorted(values)
    return quantile(ordered, 0.75) - quantile(ordered, 0.25)


def median_interval(values: Sequence[float], confidence: float = CONFIDENCE, seed: int = 1) -> Interval:
    """Where the median lies, by resampling (percentile bootstrap: Efron and Tibshirani 1993, chapter 13)."""
    return _interval(sorted(_resampled(values, random.Random(seed))), confidence)


def ratio_interval(
    before: Sequence[float], after: Sequence[float], confidence: float = CONFIDENCE, seed: int = 1
) -> Interval:
    """Where median(after) / median(before) lies, both resampled; nan where one has no values or `before` is 0."""
    source = random.Random(seed)
    pairs = zip(_resampled(before, source), _resampled(after, source), strict=True)
    return _interval(sorted(new / old if old else nan for old, new in pairs), confidence)


def _resampled(values: Sequence[float], source: random.Random) -> list[float]:
    thin = values[:: -(-len(values) // MOST_RESAMPLED) or 1]
    if not thin:
        return [nan] * RESAMPLES
    return [median(source.choices(thin, k=len(thin))) for _ in range(RESAMPLES)]


def _interval(ordered: list[float], confidence: float) -> Interval:
    if not all(map(isfinite, ordered)):
        return Interval(nan, nan)
    tail = (1.0 - confidence) / 2.0
    return Interval(quantile(ordered, tail), quantile(ordered, 1.0 - tail))

"""Medians, quantiles, spread, and the significance of differences."""

import random
import statistics
from collections.abc import Sequence
from math import ceil, isfinite, nan, sqrt
from typing import NamedTuple

from hil.common.quantiles import quantile

RESAMPLES = 2000
CONFIDENCE = 0.95
MAX_RESAMPLED = 2000  # values; more of them are thinned evenly, which does not change their median


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


def median_interval(
    values: Sequence[float], confidence: float = CONFIDENCE, seed: int = 1, block: bool = False
) -> Interval:
    """Return the interval of the median, by resampling (percentile bootstrap: Efron and Tibshirani 1993, chapter 13).

    `block`: length of blocks, for values in the order of time whose neighbours are alike; without it values must be
    independent.
    """
    return _interval(sorted(_resampled(values, random.Random(seed), block)), confidence)


def ratio_interval(
    before: Sequence[float],
    after: Sequence[float],
    confidence: float = CONFIDENCE,
    seed: int = 1,
    block: bool = False,
) -> Interval:
    """Return the interval of median(after) / median(before), both resampled.

    Nan if one has no values or is not above 0.
    """
    source = random.Random(seed)
    pairs = zip(_resampled(before, source, block), _resampled(after, source, block), strict=True)
    return _interval(sorted(new / old if old > 0.0 < new else nan for old, new in pairs), confidence)


def _resampled(values: Sequence[float], source: random.Random, block: bool) -> list[float]:
    thin = values[:: -(-len(values) // MAX_RESAMPLED) or 1]
    if not thin:
        return [nan] * RESAMPLES
    draw = _drawn_by_block if block else _drawn
    return [median(draw(thin, source)) for _ in range(RESAMPLES)]


def _drawn(values: Sequence[float], source: random.Random) -> list[float]:
    return source.choices(values, k=len(values))


def _drawn_by_block(values: Sequence[float], source: random.Random) -> list[float]:
    """Resample in blocks of neighbours, the first following the last (Politis and Romano 1992)."""
    length = ceil(sqrt(len(values)))
    ring = [*values, *values[: length - 1]]
    starts = source.choices(range(len(values)), k=ceil(len(values) / length))
    return [value for start in starts for value in ring[start : start + length]][: len(values)]


def _interval(ordered: list[float], confidence: float) -> Interval:
    if not all(map(isfinite, ordered)):
        return Interval(nan, nan)
    tail = (1.0 - confidence) / 2.0
    return Interval(quantile(ordered, tail), quantile(ordered, 1.0 - tail))

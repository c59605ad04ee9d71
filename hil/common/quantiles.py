"""Quantiles of measured values, with one definition for the whole project."""

from collections.abc import Sequence
from math import ceil, nan

_ROUNDING = 1e-12  # relative; above the rounding error of a product of two floats, below one of 10^9 values


def rank(share: float, count: int) -> int:
    """Return the nearest rank: which of `count` ordered values, from 1, is the quantile of `share` (0..1).

    It is the first value that at least `share` of all do not exceed: the 99 % quantile of 100 values is the 99th.
    Rounding errors of floats are ignored: 0.07 * 100 is slightly more than 7.
    """
    return min(max(ceil(share * count * (1.0 - _ROUNDING)), 1), count)


def quantile(ordered: Sequence[float], share: float) -> float:
    """Return the smallest of the `ordered` values that at least `share` (0..1) of all do not exceed; nan if empty.

    By the nearest rank the result is always a measured value, never an interpolated one.
    """
    return ordered[rank(share, len(ordered)) - 1] if ordered else nan

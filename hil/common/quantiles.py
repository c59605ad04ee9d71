"""Quantiles of measured values: one definition for all."""

from collections.abc import Sequence
from math import ceil, nan

_ROUNDING = 1e-12  # relative; more than the rounding of a product of two floats, and less than one of 10^9 values


def rank(share: float, count: int) -> int:
    """Return which of `count` ordered values, from 1, is the quantile of `share` (0..1): the nearest rank.

    It is the first that at least `share` of all do not exceed, so that the 99 % of 100 values is the 99th. What
    floats make of a share like 0.07 does not count: 0.07 * 100 is more than 7.
    """
    return min(max(ceil(share * count * (1.0 - _ROUNDING)), 1), count)


def quantile(ordered: Sequence[float], share: float) -> float:
    """Return the smallest of the `ordered` values that at least `share` (0..1) of all do not exceed; nan of none.

    Nearest rank: what is given out was measured, nothing between two values is made up.
    """
    return ordered[rank(share, len(ordered)) - 1] if ordered else nan

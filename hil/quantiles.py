"""Quantiles of what was measured."""

from collections.abc import Sequence
from math import nan


def quantile(ordered: Sequence[float], share: float) -> float:
    """The smallest of the `ordered` values that at least `share` (0..1) of all do not exceed; nan of none.

    Nearest rank: what is given out was measured, nothing between two values is made up.
    """
    if not ordered:
        return nan
    rank = -(-share * len(ordered) // 1)  # rounded up
    return ordered[min(max(int(rank), 1), len(ordered)) - 1]

"""Linear interpolation in tables."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise


class PiecewiseLinear:
    """Linear interpolation of a table with several columns; constant before its first and after its last point.

    `at` is strictly increasing; each column has one value for each. A call returns one value of each column, in order.
    """

    def __init__(self, at: Sequence[float], *columns: Sequence[float]) -> None:
        self._at = tuple(at)
        self._rows = list(zip(*columns, strict=True))
        self._last = len(self._rows) - 1

    def __call__(self, x: float) -> tuple[float, ...]:
        """Return the value of every column at `x`."""
        after = bisect_right(self._at, x)
        if after == 0:
            return self._rows[0]
        if after > self._last:
            return self._rows[self._last]
        start = self._at[after - 1]
        share = (x - start) / (self._at[after] - start)
        return tuple([a + share * (b - a) for a, b in zip(self._rows[after - 1], self._rows[after], strict=True)])

    def numbers(self) -> list[float]:
        """Return the rows of the table as one flat list, each with its `at` first, from which the C twin is made."""
        return [x for at, row in zip(self._at, self._rows, strict=True) for x in (at, *row)]


def validate_columns(axis: str, at: Sequence[float], **columns: Sequence[float]) -> str | None:
    """Return what is wrong with a table, or None: `at` does not increase, or a column has another length than `at`.

    An empty column means that it was left out; this is allowed.
    """
    if not at:
        return f"{axis}: give at least one"
    if any(b <= a for a, b in pairwise(at)):
        return f"{axis}: each must be greater than the one before"
    for name, column in columns.items():
        if column and len(column) != len(at):
            return f"{name}: expected {len(at)} values, one for each {axis}, found {len(column)}"
    return None


def interpolate(at: Sequence[float], values: Sequence[float], x: float) -> float:
    """Return the linear interpolation at `x`, constant outside the table; `at` is strictly increasing."""
    after = bisect_right(at, x)
    if after == 0:
        return values[0]
    if after == len(at):
        return values[-1]
    share = (x - at[after - 1]) / (at[after] - at[after - 1])
    return values[after - 1] + share * (values[after] - values[after - 1])


def nearest_pulse(pulses: Sequence[float], thrusts: Sequence[float], thrust: float) -> int:
    """Return the pulse (us) that makes a thrust other than 0. Thrusts outside the table get its first or last pulse.

    `thrusts` never decreases. Where several pulses make the same thrust, the one nearest to neutral is returned: it
    takes the least power.
    """
    after = bisect_left(thrusts, thrust) if thrust > 0.0 else bisect_right(thrusts, thrust)
    if after in (0, len(thrusts)):
        return round(pulses[0] if after == 0 else pulses[-1])
    low, high = thrusts[after - 1], thrusts[after]
    return round(pulses[after - 1] + (thrust - low) / (high - low) * (pulses[after] - pulses[after - 1]))

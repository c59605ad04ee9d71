"""Linear interpolation in tables."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise


class PiecewiseLinear:
    """Straight lines through the points of a table; before its first and after its last point the ends hold.

    `at` grows strictly; each column has one value for each. A call gives the columns' values in order.
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
        """Return the table row after row, each with its place first: what the C twin is made of."""
        return [x for at, row in zip(self._at, self._rows, strict=True) for x in (at, *row)]


def validate_columns(axis: str, at: Sequence[float], **columns: Sequence[float]) -> str | None:
    """Return what is wrong with a table whose rows stand at `at`, or None: not growing, or of uneven length.

    An empty column was left out, which is no fault.
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
    """Return the value at `x` on straight lines between the points, the ends' outside; `at` grows strictly."""
    after = bisect_right(at, x)
    if after == 0:
        return values[0]
    if after == len(at):
        return values[-1]
    share = (x - at[after - 1]) / (at[after] - at[after - 1])
    return values[after - 1] + share * (values[after] - values[after - 1])


def nearest_pulse(pulses: Sequence[float], thrusts: Sequence[float], thrust: float) -> int:
    """Return the pulse of a thrust that is not 0; the ends hold outside. `thrusts` never falls.

    Of a flat stretch it is the pulse nearest neutral: the least power for the same thrust.
    """
    after = bisect_left(thrusts, thrust) if thrust > 0.0 else bisect_right(thrusts, thrust)
    if after in (0, len(thrusts)):
        return round(pulses[0] if after == 0 else pulses[-1])
    low, high = thrusts[after - 1], thrusts[after]
    return round(pulses[after - 1] + (thrust - low) / (high - low) * (pulses[after] - pulses[after - 1]))

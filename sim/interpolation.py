"""Tables read between their lines."""

from bisect import bisect_right
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
        """The value of every column at `x`."""
        after = bisect_right(self._at, x)
        if after == 0:
            return self._rows[0]
        if after > self._last:
            return self._rows[self._last]
        start = self._at[after - 1]
        share = (x - start) / (self._at[after] - start)
        return tuple([a + share * (b - a) for a, b in zip(self._rows[after - 1], self._rows[after], strict=True)])


def table_problem(axis: str, at: Sequence[float], **columns: Sequence[float]) -> str | None:
    """What is wrong with a table whose rows stand at `at`: none, not growing, or of uneven length.

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

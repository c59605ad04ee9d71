"""Format text tables whose columns are as wide as their widest cell."""

from collections.abc import Sequence

from hil.common.text import clean


def aligned(rows: Sequence[Sequence[str]], right: bool = False, rule: bool = False) -> list[str]:
    """`rows` of equally many cells as lines, cells at their left or, as numbers like it, at their right.

    With `rule` a line of dashes comes below the first row. What does not print in a cell is replaced.
    """
    rows = [[clean(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    pad = str.rjust if right else str.ljust
    ruled = [*rows[:1], ["-" * width for width in widths], *rows[1:]] if rule else rows
    return ["  ".join([pad(cell, width) for cell, width in zip(row, widths, strict=True)]).rstrip() for row in ruled]

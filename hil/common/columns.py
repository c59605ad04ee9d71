"""Format text that fits the terminal: tables whose columns are as wide as their widest cell, and paragraphs."""

import re
from collections.abc import Sequence

from hil.common.text import clean

GAP = "  "
PIECES = re.compile(r" +|[^ /]*/|[^ /]+")  # what stays on one line if it can
LEAST = 6  # letters; a column is never made narrower


def aligned(
    rows: Sequence[Sequence[str]], right: bool = False, rule: bool = False, indent: str = "", width: int = 0
) -> list[str]:
    """Return `rows` of equally many cells as lines; each cell is aligned left or, for numbers, right.

    With `rule` a line of dashes comes below the first row. What does not print in a cell is replaced. No line is longer
    than `width` letters, 0: the terminal's, or 80 where the output is no terminal; longer cells go on in the next line.
    """
    rows = [[clean(cell) for cell in row] for row in rows]
    widths = _fitted(list(zip(*rows, strict=True)), (width or terminal_width()) - len(indent))
    pad = str.rjust if right else str.ljust
    ruled = [*rows[:1], ["-" * width for width in widths], *rows[1:]] if rule else rows
    lines = [line for row in ruled for line in _lines(row, widths)]
    return [
        (indent + GAP.join([pad(cell, width) for cell, width in zip(line, widths, strict=True)])).rstrip()
        for line in lines
    ]


def paragraph(text: str, indent: str = "") -> str:
    """Return a text as lines that fit the terminal; those after the first begin with `indent`. Words stay whole."""
    from textwrap import fill  # by few commands

    return fill(text, terminal_width(), subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)


def terminal_width() -> int:
    """Return the columns of the terminal, 80 where the output is none."""
    from shutil import get_terminal_size

    return get_terminal_size((80, 24)).columns


def _fitted(columns: Sequence[Sequence[str]], total: int) -> list[int]:
    """Return the widths of columns: the widest made narrower until all fit in `total`, words whole if they can be."""
    widths = [max(map(len, column)) for column in columns]
    words = [
        max(len(piece.rstrip()) for cell in column for piece in PIECES.findall(cell) or [""]) for column in columns
    ]
    for floors in (words, [LEAST] * len(widths)):
        while sum(widths) + len(GAP) * (len(widths) - 1) > total:
            spare = [width if width > floor else 0 for width, floor in zip(widths, floors, strict=True)]
            if not any(spare):
                break
            widths[spare.index(max(spare))] -= 1
    return widths


def _lines(row: Sequence[str], widths: Sequence[int]) -> list[list[str]]:
    """Return the lines of one row, each with as many cells."""
    wrapped = [_wrap(cell, width) for cell, width in zip(row, widths, strict=True)]
    count = max(map(len, wrapped))
    return [[cell[number] if number < len(cell) else "" for cell in wrapped] for number in range(count)]


def _wrap(text: str, width: int) -> list[str]:
    """Return a text as lines: broken at spaces and after slashes, else anywhere."""
    lines = [""]
    for piece in PIECES.findall(text) if len(text) > width else [text]:
        if len(lines[-1]) + len(piece.rstrip()) > width and lines[-1]:
            lines[-1] = lines[-1].rstrip()
            lines.append("")
        if lines[-1] or not piece.isspace():
            lines[-1] += piece
        while len(lines[-1].rstrip()) > width:
            lines.append(lines[-1][width:])
            lines[-2] = lines[-2][:width]
    return [line.rstrip() for line in lines]

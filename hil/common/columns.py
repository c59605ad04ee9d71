"""Format text to fit the terminal: tables with columns as wide as their widest cell, paragraphs, and help."""

import argparse
import re
import sys
from collections.abc import Sequence
from itertools import groupby

from hil.common.text import clean, wrap_command

GAP = "  "
PIECES = re.compile(r" +|[^ /]*/|[^ /]+")  # pieces that are kept on one line if possible
MIN_WIDTH = 6  # minimum width of a column, in characters
MAX_WIDTH = 100_000  # characters of a line that a program reads


def aligned(
    rows: Sequence[Sequence[str]], right: bool = False, rule: bool = False, indent: str = "", width: int = 0
) -> list[str]:
    """Return `rows` of equally many cells as lines; cells are aligned left, or right with `right`, for numbers.

    With `rule` a line of dashes follows the first row. Characters that do not print are replaced. No line is longer
    than `width` characters (0: the terminal's width, or 80 without a terminal); longer cells continue on the next line.
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
    from textwrap import fill  # not needed by most commands

    return fill(text, terminal_width(), subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)


def fit_to_terminal(text: str, indent: str = "    ") -> str:
    """Return each line of a text as a `paragraph` if the output is a terminal, else the text as it is."""
    return "\n".join(paragraph(line, indent) for line in text.split("\n")) if sys.stdout.isatty() else text


def shorten_status(text: str) -> str:
    """Return as many parts of a status line as one line of the terminal has room for.

    Parts are separated by two spaces. A wrapped status line cannot be overwritten by the next one.
    """
    while len(text) >= terminal_width() and GAP in text.strip():
        text = text.rpartition(GAP)[0].rstrip()
    return text


class HelpFormatter(argparse.HelpFormatter):
    """Wrap the paragraphs of a text to the terminal's width; leave indented lines, such as examples, as they are."""

    def start_section(self, heading: str | None) -> None:
        """Begin a group of options."""
        super().start_section("\n".join(self._split_lines(heading, self._width - 1)) if heading else heading)

    def _split_lines(self, text: str, width: int) -> list[str]:
        """Return the lines of an option's help; unlike argparse, do not break names and commands at hyphens."""
        from textwrap import wrap  # needed only for help

        return wrap(" ".join(text.split()), width, break_on_hyphens=False)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines: list[str] = []
        for is_prose, group in groupby(text.splitlines(), lambda line: line[:1] not in ("", " ")):
            if is_prose:
                lines += [f"{indent}{line}" for line in self._split_lines(" ".join(group), width - len(indent))]
            else:
                lines += [piece for line in group for piece in wrap_command(line, width)]
        return "\n".join(lines)


def terminal_width() -> int:
    """Return the number of columns of the terminal; 80 if the output is not a terminal."""
    from shutil import get_terminal_size

    return get_terminal_size((80, 24)).columns


def result_width() -> int:
    """Return the width for results: that of the terminal, without limit in a pipe or file, for `grep` and the like."""
    return terminal_width() if sys.stdout.isatty() else MAX_WIDTH


def _fitted(columns: Sequence[Sequence[str]], total: int) -> list[int]:
    """Return the column widths: reduce the widest until all fit into `total`, if possible without breaking words."""
    widths = [max(map(len, column)) for column in columns]
    words = [
        max(len(piece.rstrip()) for cell in column for piece in PIECES.findall(cell) or [""]) for column in columns
    ]
    for floors in (words, [MIN_WIDTH] * len(widths)):
        while sum(widths) + len(GAP) * (len(widths) - 1) > total:
            spare = [width if width > floor else 0 for width, floor in zip(widths, floors, strict=True)]
            if not any(spare):
                break
            widths[spare.index(max(spare))] -= 1
    return widths


def _lines(row: Sequence[str], widths: Sequence[int]) -> list[list[str]]:
    """Return the lines of one row, each with the same number of cells."""
    wrapped = [_wrap(cell, width) for cell, width in zip(row, widths, strict=True)]
    count = max(map(len, wrapped))
    return [[cell[number] if number < len(cell) else "" for cell in wrapped] for number in range(count)]


def _wrap(text: str, width: int) -> list[str]:
    """Return a text as lines, broken at spaces and after slashes; longer words are broken anywhere."""
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

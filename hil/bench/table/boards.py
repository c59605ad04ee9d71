"""The HIL table of several boards or runs side by side, beside the reference platform's: as text, files, a picture."""

import csv
import io
from collections.abc import Sequence
from math import ceil, floor, log10
from textwrap import wrap
from typing import Any, NamedTuple

from boards import Budgets, load_board
from hil.bench.harness import SLAVE_PREFIX, labels_of
from hil.bench.record import Figure, Record
from hil.bench.table.hil_table import PAPER_BOARDS
from hil.bench.table.run import ROWS, Row
from hil.common.columns import aligned
from hil.plots.plotting import pyplot, save_figure
from hil.ros.diagnostics import Diagnostics

DRAWN = ("master_cpu", "startup", "memory_share", "delay_p50")  # the figures that the paper has too
CLOCKED = ("startup", "delay_p50", "delay_p99", "delay_max")  # between instants of two processes
HERE = "this machine"
NAME, LINE = 28, 190  # characters of a name and of a line below, in the picture
MARGIN = 0.5  # decades beside the outermost points, for their numbers


class Column(NamedTuple):
    """One board's, or one earlier run's, figures.

    `about`: which machine, and when. `labels`: under which conditions. `warnings`: reasons to doubt those figures that
    depend on the clock of another process.
    """

    title: str
    figures: dict[str, Figure]
    about: str = ""
    labels: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def doubts(self, row: Row) -> tuple[str, ...]:
        """Return the reasons to doubt its figure in this row."""
        return self.warnings if row.name in CLOCKED else ()


def paper() -> list[Column]:
    """Return the reference platform's two boards; it gives one number each, without spread."""
    return [
        Column(
            f"{board.title}, 2022",
            {
                "master_cpu": Figure([board.master_cpu * 100.0], "% of a core"),
                "startup": Figure([board.startup_s], "s"),
                "memory_share": Figure([board.memory * 100.0], "%"),
                "delay_p50": Figure([board.delay_s * 1e3], "ms"),
            },
        )
        for board in PAPER_BOARDS
    ]


def ratios(column: Column, board: str) -> str:
    """Return a line: ratio of the reference platform's figure on the same board to each figure of a column.

    board: the name of the board's profile. "" where the platform had no such board, or where the column's labels
    say that its machine is emulated or limited.
    """
    theirs = next((place for place, one in enumerate(PAPER_BOARDS) if load_board(one.profile).name == board), None)
    if theirs is None or column.labels:
        return ""
    reference = paper()[theirs]
    texts = [
        f"{row.title} {reference.figures[row.name].median / column.figures[row.name].median:.1f} x less"
        for row in ROWS
        if row.name in DRAWN and _is_comparable(row, column)
    ]
    return f"{column.title} against {reference.title}: {', '.join(texts)}" if texts else ""


def _is_comparable(row: Row, column: Column) -> bool:
    figure = column.figures.get(row.name)
    return figure is not None and figure.median > 0.0 and not column.doubts(row)


def columns_of(record: Record, title: str = "") -> list[Column]:
    """Return the columns of one record of `bench table`; `title` stands before each slave's name."""
    by_slave: dict[str, dict[str, Figure]] = {}
    for name, figure in record.figures.items():
        row, _, slave = name.partition(" @ ")
        by_slave.setdefault(slave, {})[row] = figure
    return [_column(record, slave, figures, title) for slave, figures in by_slave.items()]


def _column(record: Record, slave: str, figures: dict[str, Figure], title: str) -> Column:
    """Return the column of the slave at an endpoint, "" for the local one; a record describes its master's machine."""
    detail = record.details.get(slave or HERE, {})
    master = f"{record.machine.get('cpu') or 'unknown processor'}, {record.machine.get('cores', '?')} cores"
    diagnostics = Diagnostics(detail.get("slave"))
    board = diagnostics.board or "?"
    about = f"board: {board}; master: {master}" if slave else master
    labels = record.labels
    if slave:
        ours = (f"master: {label}" for label in labels if not label.startswith(SLAVE_PREFIX))
        labels = (*ours, *labels_of(diagnostics))
    name = " ".join(filter(None, (title, slave)))
    return Column(name, figures, f"{about}; {record.made[:10]}", labels, tuple(detail.get("warnings", ())))


def remarks(columns: Sequence[Column]) -> list[str]:
    """Return a line for each column: its machine, when it was measured, and its labels and warnings."""
    lines = []
    for column in columns:
        labels = [f"label: {label}" for label in column.labels]
        warnings = [f"WARNING: {text}" for text in column.warnings]
        remark = "; ".join(filter(None, (column.about, *labels, *warnings)))
        if remark:
            lines.append(f"{column.title}: {remark}")
    return lines


def text(columns: Sequence[Column]) -> str:
    """Return the table for a terminal: medians, and in brackets the middle half where there are several runs."""
    return "\n".join(aligned(_cells(columns), rule=True))


def markdown(columns: Sequence[Column]) -> str:
    """Return the table for a document, with the remarks on each column below it."""
    head, *body = _cells(columns)
    lines = [head, ["---"] * len(head), *body]
    table = [f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines]
    notes = [f"- {line}" for line in remarks(columns)]
    return "\n".join([*table, *([""] if notes else []), *notes])


def comma_separated(columns: Sequence[Column]) -> str:
    """Return CSV: a line a figure and column, with the number of runs, the labels, and the figure's warnings."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(("column", "figure", "unit", "median", "spread", "runs", "labels", "warnings"))
    for column in columns:
        for row in ROWS:
            figure = column.figures.get(row.name)
            if figure and figure.values:
                spread = figure.spread if len(figure.values) > 1 else ""
                notes = "; ".join(column.labels), "; ".join(column.doubts(row))
                writer.writerow((column.title, row.name, row.unit, figure.median, spread, len(figure.values), *notes))
    return out.getvalue()


def draw(columns: Sequence[Column], path: str) -> None:
    """Draw the four figures of the paper as points on logarithmic scales. Raises ConfigError, MissingExtraError."""
    plt = pyplot()
    below = [part for line in remarks(columns) for part in wrap(line, LINE, subsequent_indent="    ")]
    names = ["\n".join(wrap(column.title, NAME)) for column in columns]
    lines = sum(1 + name.count("\n") for name in names)
    size = 11, 2.0 + 0.5 * lines + 0.16 * len(below)
    figure, axes = plt.subplots(2, 2, figsize=size, layout="constrained", sharey=True)
    for panel, row in zip(axes.flat, (row for row in ROWS if row.name in DRAWN), strict=True):
        _draw_row(panel, row, columns)
        panel.set_yticks(range(len(columns)), names)
    axes[0][0].set_ylim(len(columns) - 0.5, -0.6)  # the first on top, with room for its number
    figure.supxlabel("\n".join(below), x=0.01, ha="left", fontsize="x-small")
    save_figure(figure, path)


def _draw_row(panel: Any, row: Row, columns: Sequence[Column]) -> None:
    """Draw one figure of each column: its median, the middle half, and its number above."""
    panel.set(xscale="log", title=f"{row.title} ({row.unit})")
    plotted = []
    for index, column in enumerate(columns):
        figure = column.figures.get(row.name)
        number = _number(row, column)
        if figure and figure.median > 0.0:
            middle = figure.median
            ends = [[middle - figure.at(0.25)], [figure.at(0.75) - middle]]
            panel.errorbar(middle, index, xerr=ends, fmt="o", color=f"C{index % 10}", capsize=3)
            label = {"xy": (middle, index), "xytext": (0, 5), "textcoords": "offset points", "ha": "center"}
            plotted += [value for value in (figure.at(0.25), figure.at(0.75)) if value > 0.0]
        else:  # a logarithmic scale has no zero
            label = {"xy": (0.02, index), "xycoords": panel.get_yaxis_transform(), "va": "center"}
        panel.annotate(number or "not measured", fontsize="small", **label)
    low, high = floor(log10(min(plotted, default=1.0))), ceil(log10(max(plotted, default=1.0)))
    panel.set_xlim(10 ** (low - MARGIN), 10 ** (max(high, low + 1) + MARGIN))


def missed(column: Column, budgets: Budgets) -> list[str]:
    """Return the budgets that the medians exceed, in words. A figure that is missing exceeds its budget."""
    resident = column.figures.get("memory_alone")
    limits = {
        "startup": budgets.startup,
        # a board runs one slave, which shares memory with no other; its own diagnostics are used
        "memory_alone" if resident and resident.values else "memory": budgets.memory,
        "slave_cpu": budgets.slave_cpu * 100.0,
        "delay_p50": budgets.delay_p50 * 1e3,
        "delay_p99": budgets.delay_p99 * 1e3,
    }
    return [
        _miss(row, column, limits[row.name])
        for row in ROWS
        if row.name in limits and not _is_within(row, column, limits[row.name])
    ]


def _is_within(row: Row, column: Column, limit: float) -> bool:
    figure = column.figures.get(row.name)
    return figure is not None and figure.median <= limit and not column.doubts(row)


def _miss(row: Row, column: Column, limit: float) -> str:
    figure = column.figures.get(row.name)
    budget = f"{row.form.format(limit)} {row.unit}"
    if figure is None or not figure.values:
        return f"{row.title}: not measured, the budget is {budget}"
    measured = f"{row.title}: {row.form.format(figure.median)} {row.unit}"
    doubts = column.doubts(row)
    return f"{measured} is not to be trusted: {doubts[0]}" if doubts else f"{measured}, the budget is {budget}"


def _cells(columns: Sequence[Column]) -> list[list[str]]:
    head = ["", *(column.title for column in columns)]
    return [head, *([f"{row.title} ({row.unit})", *(_cell(row, column) for column in columns)] for row in ROWS)]


def _cell(row: Row, column: Column) -> str:
    figure = column.figures.get(row.name)
    spread = f" ({row.form.format(figure.spread)})" if figure and len(figure.values) > 1 else ""
    return _number(row, column) + spread or "-"


def _number(row: Row, column: Column) -> str:
    """Return the median; "" where there is none."""
    figure = column.figures.get(row.name)
    if figure is None or not figure.values:
        return ""
    return row.form.format(figure.median) + (" (!)" if column.doubts(row) else "")

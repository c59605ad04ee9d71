"""The HIL table of several boards or runs side by side, beside the source paper's: text, Markdown, CSV, a picture."""

import csv
import io
import os
from collections.abc import Sequence
from typing import NamedTuple

from boards import Budgets
from hil.bench.plotting import pyplot
from hil.bench.record import Figure, Record
from hil.bench.table import PAPER_DELAY_S, PAPER_MASTER_CPU, PAPER_MEMORY, PAPER_STARTUP_S
from hil.bench.table_run import ROWS, Row
from hil.columns import aligned
from hil.errors import ConfigError

DRAWN = ("master_cpu", "startup", "memory_share", "delay_p50")  # what the paper has too


class Column(NamedTuple):
    """One board's, or one earlier run's, figures."""

    title: str
    figures: dict[str, Figure]


def paper() -> list[Column]:
    """The source paper's two boards; it gives one number each, without spread."""
    boards = ("paper: Pi 4B", "paper: Jetson Nano")
    return [
        Column(
            title,
            {
                "master_cpu": Figure([PAPER_MASTER_CPU * 100.0], "% of a core"),
                "startup": Figure([PAPER_STARTUP_S[place]], "s"),
                "memory_share": Figure([PAPER_MEMORY[place] * 100.0], "%"),
                "delay_p50": Figure([PAPER_DELAY_S[place] * 1e3], "ms"),
            },
        )
        for place, title in enumerate(boards)
    ]


def columns_of(record: Record, title: str = "") -> list[Column]:
    """The columns of one record of `bench table`; `title` stands before each slave's name."""
    found: dict[str, dict[str, Figure]] = {}
    for name, figure in record.figures.items():
        row, _, slave = name.partition(" @ ")
        found.setdefault(slave, {})[row] = figure
    return [Column(" ".join(filter(None, (title, slave))), figures) for slave, figures in found.items()]


def text(columns: Sequence[Column]) -> str:
    """For a terminal: medians, and in brackets the range of the middle half where there are several runs."""
    return "\n".join(aligned(_cells(columns), rule=True))


def markdown(columns: Sequence[Column]) -> str:
    """The same for a document."""
    head, *body = _cells(columns)
    lines = [head, ["---"] * len(head), *body]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)


def comma_separated(columns: Sequence[Column]) -> str:
    """A line a figure and column, with the number of runs."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(("column", "figure", "unit", "median", "spread", "runs"))
    for column in columns:
        for row in ROWS:
            figure = column.figures.get(row.name)
            if figure and figure.values:
                spread = figure.spread if len(figure.values) > 1 else ""
                writer.writerow((column.title, row.name, row.unit, figure.median, spread, len(figure.values)))
    return out.getvalue()


def draw(columns: Sequence[Column], path: str) -> None:
    """The four figures of the paper as bars on a logarithmic scale. Raises ConfigError, MissingExtraError."""
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(11, 2.2 + 0.7 * len(columns)), layout="constrained")
    for panel, row in zip(axes.flat, (row for row in ROWS if row.name in DRAWN), strict=True):
        for place, column in enumerate(columns):
            found = column.figures.get(row.name)
            if found and found.values:
                bar = panel.barh(place, found.median, xerr=found.spread / 2, color=f"C{place % 10}")
                panel.bar_label(bar, [f" {row.form.format(found.median)}"], fontsize="small")
        panel.set(xscale="log", title=f"{row.title} ({row.unit})", yticks=range(len(columns)))
        panel.set_yticklabels([column.title for column in columns])
        panel.tick_params(axis="x", which="minor", labelbottom=False)
        panel.invert_yaxis()
        panel.margins(x=0.2)
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{os.path.abspath(path)}: cannot be written: {error}") from None
    finally:
        plt.close(figure)


def missed(column: Column, budgets: Budgets) -> list[str]:
    """The budgets that the medians do not keep, in words. A figure that could not be had keeps none."""
    limits = {
        "startup": budgets.startup,
        "memory": budgets.memory,
        "slave_cpu": budgets.slave_cpu * 100.0,
        "delay_p50": budgets.delay_p50 * 1e3,
        "delay_p99": budgets.delay_p99 * 1e3,
    }
    return [
        _miss(row, column.figures.get(row.name), limits[row.name])
        for row in ROWS
        if row.name in limits and not _keeps(column.figures.get(row.name), limits[row.name])
    ]


def _keeps(figure: Figure | None, limit: float) -> bool:
    return figure is not None and figure.median <= limit


def _miss(row: Row, figure: Figure | None, limit: float) -> str:
    budget = f"{row.form.format(limit)} {row.unit}"
    if figure is None or not figure.values:
        return f"{row.title}: not measured, the budget is {budget}"
    return f"{row.title}: {row.form.format(figure.median)} {row.unit}, the budget is {budget}"


def _cells(columns: Sequence[Column]) -> list[list[str]]:
    lines = [["", *(column.title for column in columns)]]
    for row in ROWS:
        cells = [_cell(row, column.figures.get(row.name)) for column in columns]
        lines.append([f"{row.title} ({row.unit})", *cells])
    return lines


def _cell(row: Row, figure: Figure | None) -> str:
    if figure is None or not figure.values:
        return "-"
    spread = f" ({row.form.format(figure.spread)})" if len(figure.values) > 1 else ""
    return row.form.format(figure.median) + spread

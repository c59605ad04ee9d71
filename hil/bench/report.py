"""Show figures of several configurations or machines side by side: as a table, and as a picture."""

from collections.abc import Iterable, Sequence
from textwrap import wrap
from typing import Any, NamedTuple

from hil.bench.record import Better, Figure
from hil.common.columns import aligned
from hil.plots.plotting import pyplot, save_figure

NAME, LINE = 28, 190  # characters of a name and of a line below, in the picture
DECADE = 10.0  # a greater range has a logarithmic scale


class Row(NamedTuple):
    """One quantity: its name in records, what people call it, its unit, and how it is written.

    `is_clocked`: it lies between instants of two processes, so that a wrong clock makes it wrong.
    """

    name: str
    title: str
    unit: str
    form: str
    better: Better = "lower"
    is_clocked: bool = False


class Column(NamedTuple):
    """The figures of one configuration, one board, or one earlier run, by the names of their rows.

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
        return self.warnings if row.is_clocked else ()

    def number(self, row: Row) -> str:
        """Return the median in this row; "" where there is none."""
        figure = self.figures.get(row.name)
        if figure is None or not figure.values:
            return ""
        return row.form.format(figure.median) + (" (!)" if self.doubts(row) else "")

    def cell(self, row: Row) -> str:
        """Return the median, and in brackets the middle half where there are several values."""
        figure = self.figures.get(row.name)
        spread = f" ({row.form.format(figure.spread)})" if figure and len(figure.values) > 1 else ""
        return self.number(row) + spread or "-"


def text(columns: Sequence[Column], rows: Sequence[Row], column_by_line: bool = False) -> str:
    """Return the table for a terminal, if there are many columns with a line for each of them."""
    cells = _cells(columns, rows)
    return "\n".join(aligned([*zip(*cells, strict=True)] if column_by_line else cells, rule=True))


def remarks(columns: Iterable[Column]) -> list[str]:
    """Return a line for each column: its machine, when it was measured, and its labels and warnings."""
    lines = []
    for column in columns:
        labels = [f"label: {label}" for label in column.labels]
        warnings = [f"WARNING: {text}" for text in column.warnings]
        remark = "; ".join(filter(None, (column.about, *labels, *warnings)))
        if remark:
            lines.append(f"{column.title}: {remark}")
    return lines


def draw(columns: Sequence[Column], rows: Sequence[Row], path: str, footer: str = "") -> None:
    """Draw a panel for each row: every value, the median and the middle half. Raises ConfigError, MissingExtraError."""
    plt = pyplot()
    below = [part for line in (*remarks(columns), *footer.splitlines()) for part in wrap(line, LINE)]
    names = ["\n".join(wrap(column.title, NAME)) for column in columns]
    high = -(-len(rows) // 2)
    lines = sum(1 + name.count("\n") for name in names)
    size = 11, high * (1.0 + 0.25 * lines) + 0.16 * len(below)
    figure, axes = plt.subplots(high, 2, figsize=size, layout="constrained", sharey=True, squeeze=False)
    for panel, row in zip(axes.flat, rows, strict=False):
        _draw_row(panel, row, columns)
        panel.set_yticks(range(len(columns)), names)
    for panel in axes.flat[len(rows) :]:
        panel.set_visible(False)
    axes[0][0].set_ylim(len(columns) - 0.5, -0.6)  # the first on top, with room for its number
    figure.supxlabel("\n".join(below), x=0.01, ha="left", fontsize="x-small")
    save_figure(figure, path)


def _draw_row(panel: Any, row: Row, columns: Sequence[Column]) -> None:
    figures = [column.figures.get(row.name) or Figure([], row.unit) for column in columns]
    drawn = [value for figure in figures for value in figure.values]
    panel.set(title=f"{row.title} ({row.unit})")
    if drawn and 0.0 < DECADE * min(drawn) < max(drawn):
        panel.set_xscale("log")
        panel.xaxis.set_minor_formatter("")
    panel.margins(x=0.15)
    for index, (column, figure) in enumerate(zip(columns, figures, strict=True)):
        label: dict[str, Any] = {"xy": (0.02, index), "xycoords": panel.get_yaxis_transform(), "va": "center"}
        if figure.values:
            middle, color = figure.median, f"C{index % 10}"
            ends = [[middle - figure.at(0.25)], [figure.at(0.75) - middle]]
            panel.plot(figure.values, [index] * len(figure.values), "|", color=color, alpha=0.3)
            panel.errorbar(middle, index, xerr=ends, fmt="o", color=color, capsize=3)
            label = {"xy": (middle, index), "xytext": (0, 5), "textcoords": "offset points", "ha": "center"}
        panel.annotate(column.number(row) or "not measured", fontsize="small", **label)


def _cells(columns: Sequence[Column], rows: Sequence[Row]) -> list[list[str]]:
    head = ["", *(column.title for column in columns)]
    return [head, *([f"{row.title} ({row.unit})", *(column.cell(row) for column in columns)] for row in rows)]

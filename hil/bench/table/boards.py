"""The columns of the HIL table: boards, earlier runs, and the reference platform's; and the budgets they miss."""

from boards import Budgets, load_board
from hil.bench.harness import SLAVE_PREFIX, labels_of
from hil.bench.record import Figure, Record
from hil.bench.report import Column, Row
from hil.bench.table.hil_table import DRAWN, PAPER_BOARDS, ROWS, paper
from hil.ros.diagnostics import Diagnostics

HERE = "this machine"


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
    name = " ".join(filter(None, (title, slave))) or HERE
    return Column(name, figures, f"{about}; {record.made[:10]}", labels, tuple(detail.get("warnings", ())))


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

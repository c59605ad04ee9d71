"""The table of a case: rows of simulated runs and of runs with slaves, as text and JSON."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isfinite
from statistics import fmean, stdev
from typing import Any

from hil.cases.record import Result
from hil.common.columns import aligned
from hil.common.tables import csv_text, save_text
from hil.common.text import json_text

# Columns of means: heading, value of a flight, decimals. Columns of worst values: heading, value, min or max, format
_MEAN: tuple[tuple[str, Callable[[Result], float], int], ...] = (
    ("travelled m", lambda r: r.path_length, 1),
    ("over optimum", lambda r: r.ratio, 3),
    ("time s", lambda r: r.duration, 1),
    ("energy kJ", lambda r: r.energy / 1e3, 2),
    ("off path rms m", lambda r: r.cross_track_rms, 2),
    ("goal error m", lambda r: r.goal_error, 2),
)
_WORST: tuple[tuple[str, Callable[[Result], float], Callable[[Iterable[float]], float], str], ...] = (
    ("least clearance m", lambda r: r.least_clearance, min, "{:.2f}"),
    ("master CPU", lambda r: r.master_cpu, max, "{:.1%}"),
    ("planner CPU", lambda r: r.planner_cpu, max, "{:.1%}"),
    ("delay p50 ms", lambda r: r.delay_p50, max, "{:.2f}"),
    ("delay p99 ms", lambda r: r.delay_p99, max, "{:.2f}"),
)
HEADINGS = ["case", "mode", "success", "collisions", "events", *(row[0] for row in _MEAN), *(row[0] for row in _WORST)]


def summary(results: Sequence[Result]) -> list[list[str]]:
    """Return the headings and a row for each case and mode: means with standard deviations, and worst values."""
    groups = list(dict.fromkeys((result.case, result.mode) for result in results))
    return [HEADINGS, *(_row([r for r in results if (r.case, r.mode) == group]) for group in groups)]


def _row(results: Sequence[Result]) -> list[str]:
    first = results[0]
    return [
        first.case,
        first.mode.upper(),
        f"{sum(r.success for r in results)} of {len(results)}",
        str(sum(r.collided for r in results)),
        str(sum(len(r.events) for r in results)),
        *(_mean_text([value(r) for r in results], digits) for _, value, digits in _MEAN),
        *(_worst([value(r) for r in results], choose, form) for _, value, choose, form in _WORST),
    ]


def _mean_text(values: Sequence[float], digits: int) -> str:
    finite = [value for value in values if isfinite(value)]
    if not finite:
        return "-"
    spread = f" ± {stdev(finite):.{digits}f}" if len(finite) > 1 else ""
    return f"{fmean(finite):.{digits}f}{spread}"


def _worst(values: Sequence[float], choose: Callable[[Iterable[float]], float], form: str) -> str:
    finite = [value for value in values if isfinite(value)]
    return form.format(choose(finite)) if finite else "-"


def render(results: Sequence[Result]) -> str:
    """Return the table for a terminal, transposed: a line per value, a column per case and mode; then the failures."""
    lines = aligned(list(zip(*summary(results), strict=True)))
    return "\n".join([*lines, *failures(results)])


def failures(results: Sequence[Result]) -> list[str]:
    """Return a line for each failed flight, with its reason, and one for each event of any flight."""
    lines = []
    for result in results:
        flight = f"{result.case} {result.mode.upper()}, seed {result.seed}"
        lines += [] if result.success else [f"{flight}: {result.reason}"]
        lines += [f"{flight}: EVENT: {event}" for event in result.events]
    return lines


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; the first row has the headings."""
    head, *body = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([head, "|" + " --- |" * len(rows[0]), *body])


def write_rows(path: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV; missing values are left empty. Raises ConfigError if the file cannot be written."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    save_text(path, csv_text([columns, *([row.get(key, "") for key in columns] for row in rows)]))


def write_json(path: str, results: Sequence[Result]) -> None:
    """Write all flights as a JSON list of objects; values that are not finite are null.

    Raises ConfigError if the file cannot be written.
    """
    save_text(path, json_text([result._asdict() | {"extra": dict(result.extra)} for result in results], indent=2))

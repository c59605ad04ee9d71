"""The campaign's result: a JSON file, a table in Markdown."""

import json
from collections.abc import Sequence
from math import isnan
from pathlib import Path
from statistics import median
from typing import Any

from hil.bench.machine import describe
from tools.faults.rows import Row

COLUMNS = ("fault", "link", "neutral, s", "limit, s", "executes again, s", "old commands", "reported", "left behind")
PRIVATE = ("name", "interpreter")  # values of the machine that are not published
LONGEST_REPORT = 90  # characters of a line in the table


def save(rows: Sequence[Row], folder: Path, seconds: float) -> None:
    """Write faults.json and faults.md there; the folder is made."""
    folder.mkdir(parents=True, exist_ok=True)
    machine = {key: value for key, value in describe()[0].items() if key not in PRIVATE}
    result = {"machine": machine, "seconds": round(seconds, 1), "rows": [_as_json(row) for row in rows]}
    (folder / "faults.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (folder / "faults.md").write_text(markdown(rows), encoding="utf-8")


def line_of(row: Row) -> str:
    """Return a row as text for the terminal."""
    verdict = "ok  " if row.passed else "FAIL"
    neutral, recovery = _number(row.neutral_s), _number(row.recovery_s)
    again = f" (attempt {row.attempts})" if row.attempts > 1 else ""
    text = (
        f"{verdict} {row.room:8} {row.fault:34} {row.link:20} neutral {neutral:>5} executes again {recovery:>5}{again}"
    )
    return "\n".join([text, *(f"     {problem}" for problem in row.problems)])


def markdown(rows: Sequence[Row]) -> str:
    """Return the tables, one for each kind of fault."""
    lines: list[str] = []
    for room in dict.fromkeys(row.room for row in rows):
        lines += [f"## {room.capitalize()}", "", f"| {' | '.join(COLUMNS)} |", "|---|---|--:|--:|--:|--:|---|---|"]
        lines += [f"| {' | '.join(_cells(row))} |" for row in rows if row.room == room]
        lines.append("")
    return "\n".join(lines)


def summary(rows: Sequence[Row]) -> str:
    """Return the result in one sentence."""
    failed = sum(not row.passed for row in rows)
    neutral = [row.neutral_s for row in rows if not isnan(row.neutral_s)]
    worst = f"; outputs neutral after {median(neutral):.2f} s (median), {max(neutral):.2f} s at most" if neutral else ""
    return f"{len(rows)} rows, {failed} failed, {sum(row.stale for row in rows)} old commands executed{worst}"


def _cells(row: Row) -> list[str]:
    reported = row.reported if len(row.reported) <= LONGEST_REPORT else row.reported[: LONGEST_REPORT - 3] + "..."
    name = row.fault if row.passed else f"**{row.fault}: {'; '.join(row.problems)}**"
    numbers = [_number(row.neutral_s), _number(row.limit_s), _number(row.recovery_s), str(row.stale)]
    return [text.replace("|", "/") for text in (name, row.link, *numbers, reported, row.leaked or "nothing")]


def _number(value: float) -> str:
    return "" if isnan(value) else f"{value:.2f}"


def _as_json(row: Row) -> dict[str, Any]:
    values = {key: None if isinstance(value, float) and isnan(value) else value for key, value in row._asdict().items()}
    return {**values, "passed": row.passed}

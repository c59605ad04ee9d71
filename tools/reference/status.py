"""Reference page of what is tested: statements with their tests and the day of the last run, and what was tried.

python -m tools.check --results build/results      a whole run that keeps its results
python -m tools.reference --results build/results  puts the days of these tests on the page
"""

import json
from collections.abc import Iterable, Iterator
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from hil.common.tables import parse_toml

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "status.json"
HEAD = """\
# Status: what is tested, and what was tried

Each statement names the tests that hold it. The last column is the day on which a whole run last ran them, and all of
them passed. This page is made by `python -m tools.reference` from `statements.toml`, and from the results of that run.

"""


class Statement(NamedTuple):
    """What holds, and the tests that hold it: "FILE::FUNCTION", or "FILE" for all of a file."""

    text: str
    tests: tuple[str, ...]


class Tried(NamedTuple):
    """Software or hardware of others: its versions, how it was tried, and the tests that try it again."""

    what: str
    version: str
    how: str
    tests: tuple[str, ...] = ()


@cache
def statements() -> tuple[list[Tried], dict[str, dict[str, list[Statement]]]]:
    """Return what was tried; and the statements of each page of the explanation, by section."""
    values = parse_toml((FOLDER / "statements.toml").read_text(encoding="utf-8"))
    tried = [Tried(**row | {"tests": tuple(row.get("tests", ()))}) for row in values.pop("tried")]
    pages: dict[str, dict[str, list[Statement]]] = {page: {} for page in values}
    for page, sections in values.items():
        for section, rows in sections.items():
            pages[page][section] = [Statement(row["text"], tuple(row["tests"])) for row in rows]
    return tried, pages


def page() -> str:
    """Return the page."""
    tried, pages = statements()
    days = json.loads(RESULTS.read_text(encoding="utf-8"))
    lines = ["## Software and hardware of others", "", "| what | version | how | last passed |", "|---|---|---|---|"]
    lines += [f"| {row.what} | {row.version} | {row.how} | {_day(row.tests, days)} |" for row in tried]
    for name, sections in pages.items():
        lines += ["", f"## {name.replace('_', ' ').capitalize()}"]
        for section, rows in sections.items():
            lines += ["", f"### {section}", "", "| statement | test | last passed |", "|---|---|---|"]
            lines += [f"| {row.text} | {_named(row.tests)} | {_day(row.tests, days)} |" for row in rows]
    return HEAD + "\n".join(lines) + "\n"


def merge(folder: Path, day: str = "") -> None:
    """Note the day of the tests that ran, from the files of JUnit in a folder; skipped ones keep their day."""
    days: dict[str, str] = json.loads(RESULTS.read_text(encoding="utf-8"))
    named = {test for rows in _all() for test in rows}
    outcomes: dict[str, list[bool]] = {}
    for test, passed in _outcomes(folder.glob("*.xml")):
        for name in {test, test.partition("::")[0]} & named:
            outcomes.setdefault(name, []).append(passed)
    day = day or date.today().isoformat()
    days |= {name: day if all(passed) else f"failed on {day}" for name, passed in outcomes.items()}
    kept = {name: days[name] for name in sorted(days) if name in named}
    RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def _all() -> Iterator[tuple[str, ...]]:
    tried, pages = statements()
    yield from (row.tests for row in tried)
    yield from (row.tests for sections in pages.values() for rows in sections.values() for row in rows)


def _outcomes(files: Iterable[Path]) -> Iterator[tuple[str, bool]]:
    """Yield the tests that ran, "FILE::FUNCTION", and whether they passed."""
    for file in files:
        for case in ElementTree.parse(file).iter("testcase"):
            results = {result.tag for result in case} & {"failure", "error", "skipped"}
            if "skipped" not in results:
                path = case.get("classname", "").replace(".", "/")
                yield f"{path}.py::{case.get('name', '').partition('[')[0]}", not results


def _named(tests: tuple[str, ...]) -> str:
    return ", ".join(f"`{test}`" for test in tests)


def _day(tests: tuple[str, ...], days: dict[str, Any]) -> str:
    """Return the day on which all of these tests passed; of several days the earliest."""
    return min((days.get(test, "-") for test in tests), default="-")

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
from tools.reference.records import rows

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "status.json"


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
        for section, stated in sections.items():
            pages[page][section] = [Statement(row["text"], tuple(row["tests"])) for row in stated]
    return tried, pages


def tried() -> str:
    """Return the rows of what was tried."""
    days = json.loads(RESULTS.read_text(encoding="utf-8"))
    return rows((row.what, row.version, row.how, _day(row.tests, days)) for row in statements()[0])


def tested() -> str:
    """Return the statements of each page of the explanation, with their tests."""
    days = json.loads(RESULTS.read_text(encoding="utf-8"))
    parts = []
    for name, sections in statements()[1].items():
        parts.append(f"## {name.replace('_', ' ').capitalize()}\n")
        for section, stated in sections.items():
            named = [", ".join(f"`{test}`" for test in row.tests) for row in stated]
            table = rows((row.text, tests, _day(row.tests, days)) for row, tests in zip(stated, named, strict=True))
            parts.append(f"### {section}\n\n| statement | test | last passed |\n|---|---|---|\n{table}")
    return "\n".join(parts)


def merge(folder: Path, day: str = "") -> None:
    """Note the day of the tests that ran, from the files of JUnit in a folder; skipped ones keep their day."""
    days: dict[str, str] = json.loads(RESULTS.read_text(encoding="utf-8"))
    named = {test for tests in _all() for test in tests}
    outcomes: dict[str, list[bool]] = {}
    for test, passed in _outcomes(folder.glob("*.xml")):
        for name in {test, test.partition("::")[0]} & named:
            outcomes.setdefault(name, []).append(passed)
    day = day or date.today().isoformat()
    days |= {name: day if all(passed) else f"failed on {day}" for name, passed in outcomes.items()}
    kept = {name: days[name] for name in sorted(days) if name in named}
    RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def _all() -> Iterator[tuple[str, ...]]:
    others, pages = statements()
    yield from (row.tests for row in others)
    yield from (row.tests for sections in pages.values() for stated in sections.values() for row in stated)


def _outcomes(files: Iterable[Path]) -> Iterator[tuple[str, bool]]:
    """Yield the tests that ran, "FILE::FUNCTION", and whether they passed."""
    for file in files:
        for case in ElementTree.parse(file).iter("testcase"):
            results = {result.tag for result in case} & {"failure", "error", "skipped"}
            if "skipped" not in results:
                path = case.get("classname", "").replace(".", "/")
                yield f"{path}.py::{case.get('name', '').partition('[')[0]}", not results


def _day(tests: tuple[str, ...], days: dict[str, Any]) -> str:
    """Return the day on which all of these tests passed; of several days the earliest."""
    return min((days.get(test, "-") for test in tests), default="-")

"""The reference pages are those of the code, and every key of every file has a meaning."""

import re
from pathlib import Path

import pytest

from hil.cli import COMMANDS
from hil.schemas.meanings import meanings
from tools.reference import files, pages
from tools.reference.records import Section, describe

FOLDER = Path(__file__).parents[3] / "docs" / "reference"


@pytest.mark.parametrize("name", sorted(pages()))
def test_the_page_is_that_of_the_code(name: str) -> None:
    assert (FOLDER / f"{name}.md").read_text(encoding="utf-8") == pages()[name], "run python -m tools.reference"


def test_every_meaning_belongs_to_a_key(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Section] = []

    def collect(section: Section) -> str:
        shown.append(section)
        return describe(section)

    monkeypatch.setattr(files, "describe", collect)
    for page in files.PAGES.values():
        page()
    fields = {section.record.__name__: set(section.record._fields) for section in shown}
    for record, keys in meanings().items():
        if record != "common":
            assert record in fields, f"no page shows {record}"
            assert set(keys) <= fields[record], f"{record} has no such keys: {set(keys) - fields[record]}"
    assert set(meanings()["common"]) <= set.union(*fields.values())


ROWS = re.compile(
    r"^\| `(?P<key>\w+)` \| (?P<type>.*?) \| (?P<unit>.*?) \| (?P<default>.*?) \| .*? \| (?P<meaning>.*) \|$", re.M
)


@pytest.mark.parametrize("name", files.PAGES)
def test_no_key_lacks_a_unit_a_default_or_a_meaning(name: str) -> None:
    rows = list(ROWS.finditer(files.PAGES[name]()))
    assert len(rows) > 20
    for row in rows:
        assert row["meaning"].endswith((".", ")")), row[0]
        assert row["default"], row[0]
        assert row["unit"] or "number" not in row["type"], f"{row[0]}: write its unit into hil/schemas/meanings.toml"


def test_every_command_is_on_the_page() -> None:
    page = pages()["commands"]
    for name in COMMANDS:
        assert f"\n## {name}\n" in page

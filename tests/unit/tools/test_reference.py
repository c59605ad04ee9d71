"""The reference pages agree with the code, and every key of every file has a description."""

import re
from importlib import import_module
from math import pi
from pathlib import Path
from typing import Annotated

import pytest

from hil.cli import COMMANDS
from hil.common.schema import Range
from hil.schemas.meanings import meanings
from tools.reference import TEMPLATES, pages
from tools.reference.records import kind_of

FOLDER = Path(__file__).parents[3] / "docs" / "reference"
PAGES = pages()
RECORDS = re.findall(r"@keys (.*)@", "".join(path.read_text(encoding="utf-8") for path in TEMPLATES.glob("*.md")))


@pytest.mark.parametrize("name", PAGES)
def test_every_page_is_current(name: str) -> None:
    assert (FOLDER / f"{name}.md").read_text(encoding="utf-8") == PAGES[name], "run python -m tools.reference"


def test_every_description_belongs_to_a_key() -> None:
    records = [getattr(import_module(module), name) for module, name in (path.split(":") for path in RECORDS)]
    fields = {record.__name__: set(record._fields) for record in records}
    for name, keys in meanings().items():
        if name != "common":
            assert name in fields, f"no page shows {name}"
            assert set(keys) <= fields[name], f"{name} has no such keys: {set(keys) - fields[name]}"
    assert set(meanings()["common"]) <= set.union(*fields.values())


ROWS = re.compile(
    r"^\| `(?P<key>\w+)` \| (?P<type>.*?) \| (?P<unit>.*?) \| (?P<default>.*?) \| .*? \| (?P<meaning>.*) \|$", re.M
)


@pytest.mark.parametrize("name", ["scenario", "sensor_keys", "vehicle", "world", "board", "frame"])
def test_every_key_has_a_unit_a_default_and_a_description(name: str) -> None:
    rows = list(ROWS.finditer(PAGES[name]))
    assert len(rows) > 20
    for row in rows:
        assert row["meaning"].endswith((".", ")")), row[0]
        assert row["default"], row[0]
        assert row["unit"] or "number" not in row["type"], f"{row[0]}: write its unit into hil/schemas/meanings.toml"


def test_every_command_is_on_the_page() -> None:
    for name in COMMANDS:
        assert f"# {name}\n" in PAGES["commands"]


def test_an_array_shows_the_ranges_of_all_its_numbers() -> None:
    degrees = tuple[Annotated[float, Range(-90.0, 90.0, "deg")], Annotated[float, Range(-180.0, 180.0, "deg")]]
    assert kind_of(degrees)[:3] == ("array of 2 numbers", "deg", "-90 to 90; -180 to 180")
    assert kind_of(tuple[Annotated[float, Range(0.0, 1.0, "T")], Annotated[float, Range(0.0, 1.0, "rad")]]).unit == ""


def test_the_range_limits_on_a_page_are_accepted_in_a_file() -> None:
    """The limits on a page are rounded inwards."""
    low, high = map(float, kind_of(Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]).range.split(" to "))
    assert -2.0 * pi <= low < -6.283 < 6.283 < high <= 2.0 * pi

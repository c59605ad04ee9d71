"""The page about the cases of the reference platform, compared with its flights."""

import re
import tempfile
from pathlib import Path

import pytest

from hil.cases.case import CASES
from hil.cases.flights import fly_one

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "cases.md"


def page_figures(name: str) -> dict[str, float]:
    """Return the page's figures of a case (seed 1, simulated time) by the titles of their rows."""
    section = PAGE.read_text(encoding="utf-8").partition(f"\n## {CASES[name]['title']}\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| ([a-z ]+) \| ([0-9.]+) (?:m|s|kJ) \|", section, re.MULTILINE)
    return {words: float(number) for words, number in rows}


def check_page(name: str) -> None:
    """Fly seed 1 again and check the page's figures, except the last digits, in which processors may differ."""
    with tempfile.TemporaryDirectory() as folder:
        flown = fly_one(name, "sil", 1, folder).result
    assert page_figures(name) == {
        "length": pytest.approx(flown.path_length, rel=0.003),
        "time": pytest.approx(flown.duration, rel=0.003),
        "energy": pytest.approx(flown.energy / 1000.0, rel=0.01),
        "least clearance": pytest.approx(flown.least_clearance, abs=0.02),
    }

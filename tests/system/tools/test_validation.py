"""The page validation.md: its figures are within their bounds, and a value beyond its bound stops the tool."""

import re
from collections.abc import Sequence
from math import nan
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from PIL import Image

from tools.pages import validation
from tools.validations.sheet import Finding, Sheet, above, below, near

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs" / "reference"
SHEETS = {sheet.name: sheet for sheet in validation.SHEETS}


@pytest.mark.parametrize("name", sorted(SHEETS))
def test_every_result_is_within_its_bound(name: str, tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    findings = validation.draw(SHEETS[name], path)
    assert findings
    assert [finding for finding in findings if not finding.holds] == []
    with Image.open(path) as picture:
        assert picture.width > 500
        assert len(picture.convert("RGB").getcolors(1 << 20) or []) > 8  # not empty
    assert path.stat().st_size < 60_000
    text = (DOCS / "validation.md").read_text(encoding="utf-8")
    assert all(finding.what in text for finding in findings), "run python tools/pages/validation.py"


def test_the_page_shows_all_pictures_and_no_other() -> None:
    text = (DOCS / "validation.md").read_text(encoding="utf-8")
    shown = re.findall(r"!\[.*?\]\(validation/(.*?)\.png\)", text)
    assert shown == list(SHEETS)
    files = list((DOCS / "validation").iterdir())
    assert {file.name for file in files} == {f"{name}.png" for name in SHEETS}
    assert sum(file.stat().st_size for file in files) < 1_500_000
    for sheet in SHEETS.values():
        assert f"\n## {sheet.title}\n" in text
        assert " ".join((sheet.draw.__doc__ or "").split()) in text, "run python tools/pages/validation.py"


def test_links_of_the_table_lead_to_sections() -> None:
    text = (DOCS / "validation.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[(.*?)\]\(#(.*?)\)", text, re.MULTILINE)
    assert [title for title, _ in rows] == [sheet.title for sheet in SHEETS.values()]
    for title, anchor in rows:
        assert re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") == anchor


@pytest.mark.parametrize(
    ("finding", "holds"),
    [
        (below("", 0.9, 1.0), True),
        (below("", 1.0, 1.0), False),
        (below("", nan, 1.0), False),
        (above("", 1.1, 1.0), True),
        (above("", nan, 1.0), False),
        (near("", -1.02, -1.0, rel=0.03), True),
        (near("", -1.02, -1.0, rel=0.01), False),
        (near("", 0.02, 0.0, within=0.03), True),
        (near("", nan, 0.0, within=0.03), False),
    ],
)
def test_a_finding_holds_within_its_bounds_only(finding: Finding, holds: bool) -> None:
    assert finding.holds is holds


def test_a_result_beyond_its_bound_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    value = 2.0

    def small(panels: Sequence[Axes]) -> list[Finding]:
        """Draw a line, with one finding."""
        panels[0].plot([0.0, 1.0])
        return [below("size", value, 1.0)]

    monkeypatch.setattr(validation, "SHEETS", [Sheet("Small", small, columns=1)])
    with pytest.raises(SystemExit, match="1 beyond the bounds"):
        validation.main(["--out", str(tmp_path)])
    assert "BEYOND: size: 2, bound < 1" in capsys.readouterr().out
    assert not (tmp_path / "validation.md").exists()
    value = 0.5
    validation.main(["--out", str(tmp_path)])
    text = (tmp_path / "validation.md").read_text(encoding="utf-8")
    assert "| [Small](#small) | size | 0.5 | < 1 |" in text
    assert "| size | 0.5 | < 1 |" in text
    assert (tmp_path / "validation" / "small.png").exists()

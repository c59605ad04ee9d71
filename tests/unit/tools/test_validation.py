"""The page validation.md: its pictures and tests exist, and a value beyond its bound stops the tool."""

import re
from collections.abc import Sequence
from itertools import pairwise
from math import atan2, cos, degrees, log2, nan, radians, sin
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from PIL import Image

from hil.autonomy.control.allocation import pseudo_inverse
from tests.unit.autonomy import test_allocation as sharing
from tests.unit.sim.test_von_benzon import HEAVY
from tools.pages import validation
from tools.validations.allocation import clip
from tools.validations.bluerov2 import LINEAR, errors_by_step
from tools.validations.sheet import Finding, Sheet, above, below, near

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs" / "explanation"
# Each takes well under half a second.
QUICK = (
    "derivatives", "published_speeds", "added_mass", "fins", "hull", "t200", "advance", "lags", "battery",
    "allocation", "dvl", "defects",
)  # fmt: skip
SHEETS = {sheet.name: sheet for sheet in validation.SHEETS}


@pytest.mark.parametrize("name", QUICK)
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


def test_every_result_names_an_existing_test() -> None:
    text = (DOCS / "validation.md").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.endswith(".py) |")]
    assert len(lines) > 100
    for line in lines:
        test, file = re.findall(r"\[(test_\w+)\]\(\.\./\.\./(tests/(?:\w+/)*test_\w+\.py)\)", line)[0]
        assert f"\ndef {test}(" in (ROOT / file).read_text(encoding="utf-8"), line


def test_links_of_the_table_lead_to_sections() -> None:
    text = (DOCS / "validation.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[(.*?)\]\(#(.*?)\)", text, re.MULTILINE)
    assert [title for title, _ in rows] == [sheet.title for sheet in SHEETS.values()]
    for title, anchor in rows:
        assert re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") == anchor


@pytest.mark.parametrize(
    ("finding", "holds"),
    [
        (below("", 0.9, 1.0, ""), True),
        (below("", 1.0, 1.0, ""), False),
        (below("", nan, 1.0, ""), False),
        (above("", 1.1, 1.0, ""), True),
        (above("", nan, 1.0, ""), False),
        (near("", -1.02, -1.0, "", rel=0.03), True),
        (near("", -1.02, -1.0, "", rel=0.01), False),
        (near("", 0.02, 0.0, "", within=0.03), True),
        (near("", nan, 0.0, "", within=0.03), False),
    ],
)
def test_a_finding_holds_within_its_bounds_only(finding: Finding, holds: bool) -> None:
    assert finding.holds is holds


def test_a_finding_is_printed_with_its_bound() -> None:
    found = near("", 10.953, 10.95, "", "m", within=0.02)
    assert (found.result, found.bound) == ("10.95 m", "10.95 m ± 0.02 m")
    assert below("", 1.8765e-9, 1e-8, "").result == "1.88e-09"


def test_a_result_beyond_its_bound_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    value = 2.0

    def small(panels: Sequence[Axes]) -> list[Finding]:
        """Draw a line, with one finding."""
        panels[0].plot([0.0, 1.0])
        return [below("size", value, 1.0, "unit/tools/test_validation.py::test_a_finding_is_printed_with_its_bound")]

    monkeypatch.setattr(validation, "SHEETS", [Sheet("Small", small, columns=1)])
    with pytest.raises(SystemExit, match="1 beyond the bounds"):
        validation.main(["--out", str(tmp_path)])
    assert "BEYOND: size: 2, bound < 1" in capsys.readouterr().out
    assert not (tmp_path / "validation.md").exists()
    value = 0.5
    validation.main(["--out", str(tmp_path)])
    text = (tmp_path / "validation.md").read_text(encoding="utf-8")
    link = "[test_a_finding_is_printed_with_its_bound](../../tests/unit/tools/test_validation.py)"
    assert f"| [Small](#small) | size | 0.5 | < 1 | {link} |" in text
    assert f"| size | 0.5 | < 1 | {link} |" in text
    assert (tmp_path / "validation" / "small.png").exists()


def test_clipping_each_thrust_turns_the_force() -> None:
    """A clipped 200 N of thrusters of 50 N turns by more than 20 degrees. The allocator's keeps its direction."""
    inverse, _ = pseudo_inverse(sharing.HEAVY)
    rotated = []
    for heading in range(0, 360, 2):
        x, y = 200.0 * cos(radians(heading)), 200.0 * sin(radians(heading))
        force = sharing.wrench_of(sharing.HEAVY, clip(inverse, [x, y, 0.0, 0.0, 0.0, 0.0]))
        rotated.append(abs(degrees(atan2(force[0] * y - force[1] * x, force[0] * x + force[1] * y))))
    assert 20.0 < max(rotated) < 23.0


def test_runge_kutta_is_of_fourth_order_with_linear_drag() -> None:
    """A halved step divides the error by 16: what lowers the order with quadratic drag is the kink of the drag."""
    orders = [log2(a / b) for a, b in pairwise(errors_by_step(LINEAR, "rk4"))]
    assert all(3.95 < order < 4.3 for order in orders)
    kinked = errors_by_step(HEAVY, "rk4")
    assert log2(kinked[3] / kinked[4]) < 3.2

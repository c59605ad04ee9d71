"""docs/reference/sensors.md equals the output of tools/pages/sensor_gallery.py, and its code runs."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from sim.sensors.kinds import SENSORS
from tests.support.lazy import import_lazily

sensor_gallery = import_lazily("tools.pages.sensor_gallery")

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "reference" / "sensors.md").read_text()


def test_the_page_is_up_to_date() -> None:
    """The page's texts and numbers are those of the sensors' source; if not: python -m tools.pages.sensor_gallery."""
    assert sensor_gallery.page(sensor_gallery.ENTRIES, "sensors") == PAGE


def test_every_picture_exists_and_no_other() -> None:
    named = {picture.__name__ for entry in sensor_gallery.ENTRIES for picture in entry.pictures}
    assert {path.stem for path in (ROOT / "docs" / "reference" / "sensors").glob("*.png")} == named
    assert {entry.sensor for entry in sensor_gallery.ENTRIES} <= set(SENSORS)


def test_the_code_of_the_page_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    assert len(re.findall(r"\[ *\d+ +\d+ +\d+\]", done.stdout)) == 3


def test_a_picture_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["sensor_gallery", "--out", str(tmp_path), "--only", "camera_lamps"])
    assert sensor_gallery.main() == 0
    (made,) = (tmp_path / "sensors").iterdir()
    assert made.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert made.stat().st_size > 3000

"""The code of docs/reference/sensors.md runs, and its pictures are those of the folder beside it."""

import re
import subprocess
import sys
from pathlib import Path

from tools.reference.tables import ENTRIES

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "reference" / "sensors.md").read_text()


def test_every_picture_exists_and_no_other() -> None:
    named = {name for entry in ENTRIES.values() for name in entry.get("pictures", ())}
    assert {path.stem for path in (ROOT / "docs" / "reference" / "sensors").glob("*.png")} == named


def test_the_code_of_the_page_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    assert len(re.findall(r"\[ *\d+ +\d+ +\d+\]", done.stdout)) == 3

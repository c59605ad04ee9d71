"""What the documents show is run as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

from tests.processes import Program

ROOT = Path(__file__).parent.parent


def test_the_library_in_your_software(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "links.md").read_text(), flags=re.DOTALL)
    port = f"pty:{tmp_path / 'stm32'}"
    with Program(tmp_path, "stm32", "--port", port) as stm32:
        stm32.expect("Ctrl-C")
        script = code.replace("pty:/tmp/uuv-hil-stm32", port)
        done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=30)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[-1].startswith("50 (1550, 1550, 1550, 1550, 1550, 1550) 0")
    assert len(lines) >= 50


def test_files_are_called_by_what_they_are() -> None:
    """In the README one name is a scenario or a vehicle, and a check needs what only a slave records."""
    lines = (ROOT / "README.md").read_text().splitlines()
    tuned = [line for line in lines if line.startswith("    uuv-hil tune ")]
    assert tuned
    assert not any("mine.toml" in line for line in tuned)
    checks = [line for line in lines if line.startswith("    uuv-hil replay ") and "--check" in line]
    assert checks
    assert all("slave = true" in line for line in checks)


def test_links_of_the_documents_lead_somewhere() -> None:
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"

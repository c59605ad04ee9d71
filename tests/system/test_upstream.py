"""The scripts of the reports for other projects in docs/upstream reproduce the faults."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.busy import retry_when_busy
from tests.support.processes import ROOT, free_port

REPORTS = ROOT / "docs" / "upstream"


@pytest.mark.parametrize(("seconds", "is_read"), [("0", True), ("0.6", False)])
def test_the_report_of_an_unread_link_is_reproduced(seconds: str, is_read: bool, tmp_path: Path) -> None:
    """Remove `hil.network.workarounds.unread_link` if this fails with the sleep."""
    script, text = tmp_path / "zenoh_pause.py", (REPORTS / "zenoh_pause.py").read_text()

    def shows_it() -> None:
        script.write_text(text.replace("17447", str(free_port())).replace("< 300", "< 30"))
        try:
            process = subprocess.run([sys.executable, script, seconds], capture_output=True, text=True, timeout=40)
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"neither link is read: {error.output}") from None
        assert process.returncode == 0, process.stderr
        count = ast.literal_eval(process.stdout.splitlines()[-1].partition("}")[0] + "}")
        assert (count["data"] > count["urgent"] / 2) is is_read

    retry_when_busy(shows_it, "the window that it shows may catch the other link too")


def test_the_report_of_a_late_undeclaration_is_reproduced(tmp_path: Path) -> None:
    """Remove `hil.network.workarounds.late_undeclaration` if this fails."""
    script, text = tmp_path / "zenoh_undeclare.py", (REPORTS / "zenoh_undeclare.py").read_text()
    script.write_text(text.replace("17448", str(free_port())))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60)
    assert done.stdout == "undeclared after 10.0 s\n", done.stderr


def test_the_report_of_a_kept_session_is_reproduced() -> None:
    """Remove `hil.network.workarounds.kept_session` if this fails."""
    script = REPORTS / "zenoh_publisher.py"
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    freed, kept = [float(line.split()[2]) for line in done.stdout.splitlines()]
    assert freed < 10.0 < 20.0 < kept

"""The project runs on the oldest supported Python: `UUV_HIL_OLDEST_PYTHON` is a 3.10 with the packages of a slave.

Behaviour that differs there is tested on the present Python too.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hil.common.children import ROOT, python_command

TRAP = "print('ran what lies in the current folder')\n"


@pytest.mark.parametrize("oldest", [True, False], ids=["3.10", "this"])
@pytest.mark.parametrize(
    "arguments", [("-c", "import tabnanny, sys; print(sys.argv[1:])", "a"), ("-X", "utf8", "-m", "tabnanny")]
)
def test_modules_of_the_current_folder_are_not_run(
    arguments: tuple[str, ...], oldest: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`tabnanny` stands for any module of the standard library that nothing needs at the start."""
    for name in ("tabnanny", "tokenize", "getopt"):
        (tmp_path / f"{name}.py").write_text(TRAP)
    if oldest:
        monkeypatch.setattr(sys, "version_info", (3, 10))
    command = python_command(*arguments)
    monkeypatch.undo()
    assert ("-P" in command) != (oldest or sys.version_info < (3, 11))
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert "current folder" not in done.stdout + done.stderr
    assert "['a']" in done.stdout or "Usage" in done.stderr + done.stdout, done


@pytest.mark.skipif("UUV_HIL_OLDEST_PYTHON" not in os.environ, reason="UUV_HIL_OLDEST_PYTHON names no interpreter")
def test_a_flight_under_the_oldest_python_is_the_same(tmp_path: Path) -> None:
    oldest = os.environ["UUV_HIL_OLDEST_PYTHON"]
    version = subprocess.run([oldest, "-c", "import sys; print(sys.version_info[:2])"], capture_output=True, text=True)
    assert version.stdout.strip() == "(3, 10)"
    reported = []
    for python in (oldest, sys.executable):
        command = [python, "-m", "hil", "sim", "paper_field", "--fast", "--json"]
        completed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        assert completed.returncode == 0, completed.stderr
        reported.append(
            {key: value for key, value in json.loads(completed.stdout).items() if not key.endswith(("cpu_s", "took_s"))}
        )
    assert reported[0] == reported[1]

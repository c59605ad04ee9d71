"""What a shell is told when somebody presses Tab, asked as the shell does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hil.commands.completion import SHELLS

BASH = Path("/bin/bash")


def completions(line: str, folder: Path) -> list[str]:
    """What may follow a line, by argcomplete's protocol: the answer comes on a descriptor of its own."""
    answers = folder / "answers"
    environment = {
        **os.environ, "_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answers), "_ARGCOMPLETE_IFS": "\n", "PYTHONPATH": os.pathsep.join(sys.path),
    }  # fmt: skip
    subprocess.run([sys.executable, "-m", "hil"], env=environment, cwd=folder, check=False, timeout=60)
    return answers.read_text().split("\n") if answers.exists() else []


def test_commands_options_and_scenarios_are_completed(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").touch()
    (tmp_path / "other.txt").touch()
    assert set(completions("uuv-hil s", tmp_path)) == {"slave", "scenario", "schema", "sim", "stm32"}
    assert {"--fast", "--seed", "--set"} <= set(completions("uuv-hil sim --", tmp_path))
    assert set(completions("uuv-hil slave pa", tmp_path)) == {"paper_field", "path_planning"}
    assert completions("uuv-hil slave mi", tmp_path) == ["mine.toml "]
    assert completions("uuv-hil bench st", tmp_path) == ["startup", "stream"]
    assert "--hours" in completions("uuv-hil bench soak --h", tmp_path)
    assert completions("uuv-hil scenario ch", tmp_path) == ["check "]


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_gets_its_script(shell: str) -> None:
    command = [sys.executable, "-m", "hil", "completion", shell]
    script = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    assert "uuv-hil" in script
    if shell == "bash" and BASH.exists():
        subprocess.run([str(BASH), "-n"], input=script, text=True, check=True, timeout=60)

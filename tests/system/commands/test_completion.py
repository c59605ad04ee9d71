"""Completion of command lines, requested as a shell does at Tab."""

import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hil.commands.completion import SHELLS
from hil.common.errors import ConfigError
from hil.scenario.config import load_scenario
from hil.schemas.files import dotted_keys

# How each shell starts without a person's own settings, and what it needs before it reads a script.
STARTS = {
    "bash": (["bash", "--norc", "--noprofile", "-i"], ""),
    "zsh": (["zsh", "-f", "-i"], "autoload -U compinit; compinit -u; "),
    "fish": (["fish", "--no-config", "-i"], ""),
}  # fmt: skip
PATIENCE_S = 60.0


def completions(line: str, folder: Path) -> list[str]:
    """Return what may follow a line, by argcomplete's protocol: the reply is written to a separate file descriptor."""
    output = folder / "answers"
    environment = {
        **os.environ, "_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE_STDOUT_FILENAME": str(output), "_ARGCOMPLETE_IFS": "\n", "PYTHONPATH": os.pathsep.join(sys.path),
    }  # fmt: skip
    subprocess.run([sys.executable, "-m", "hil"], env=environment, cwd=folder, check=False, timeout=60)
    return output.read_text().split("\n") if output.exists() else []


def test_commands_options_and_scenarios_are_completed(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").touch()
    (tmp_path / "other.txt").touch()
    assert set(completions("uuv-hil s", tmp_path)) == {"slave", "scenario", "sim", "stm32"}
    assert {"--fast", "--seed", "--set"} <= set(completions("uuv-hil sim --", tmp_path))
    assert set(completions("uuv-hil slave pa", tmp_path)) == {"paper_field", "path_planning"}
    assert completions("uuv-hil slave mi", tmp_path) == ["mine.toml "]
    assert completions("uuv-hil link loopback --protocol ve", tmp_path) == ["vesc "]
    assert set(completions("uuv-hil gateway ros", tmp_path)) == {"ros1", "ros2", "rosbridge"}


def test_keys_of_a_scenario_are_completed(tmp_path: Path) -> None:
    assert "master.speed=" in completions("uuv-hil sim paper_field --set ma", tmp_path)
    assert completions("uuv-hil sim --set modem.source", tmp_path) == ["modem.source_level="]
    assert completions("uuv-hil campaign --vary master.sp", tmp_path) == ["master.speed="]


def test_every_offered_key_is_a_key_of_a_scenario() -> None:
    keys = dotted_keys("scenario")
    assert len(keys) == len(set(keys)) > 500
    unknown_words = []
    for key in keys:
        try:
            load_scenario("paper_field", {key: "nonsense"})
        except ConfigError as error:
            unknown_words += [key] if "no key" in str(error) else []
    assert not [key for key in unknown_words if not key.startswith("sensors.")], "those of instruments need one"


class Terminal:
    """An interactive shell on a terminal. Use as a context."""

    def __init__(self, command: list[str], folder: Path) -> None:
        programs = folder / "bin"
        programs.mkdir()
        (programs / "uuv-hil").write_text(f'#!/bin/sh\nexec {sys.executable} -m hil "$@"\n')
        (programs / "uuv-hil").chmod(0o755)
        environment = {
            **os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "HOME": str(folder), "TERM": "xterm", "PS1": "$ ",
            "PYTHONPATH": os.pathsep.join(sys.path),
        }  # fmt: skip
        self._process, self._descriptor = pty.fork()  # which makes it the terminal of the shell's session
        if not self._process:
            os.chdir(folder)
            os.execvpe(command[0], command, environment)
        self._text = ""

    def __enter__(self) -> "Terminal":
        return self

    def __exit__(self, *_: object) -> None:
        os.kill(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)
        os.close(self._descriptor)

    def shows(self, text: str, pattern: str) -> bool:
        """Type and wait until the screen shows `pattern`; fails with what it shows if that does not come in time."""
        self._text = ""
        os.write(self._descriptor, text.encode())
        deadline = time.monotonic() + PATIENCE_S
        while not re.search(pattern, re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", self._text)):
            assert time.monotonic() < deadline, f"no {pattern!r} in {self._text!r}"
            if select.select([self._descriptor], [], [], 0.2)[0]:
                self._text += os.read(self._descriptor, 4096).decode(errors="replace")
        return True


@pytest.mark.parametrize("shell", SHELLS)
def test_a_real_shell_completes(shell: str, tmp_path: Path) -> None:
    if not shutil.which(shell):
        pytest.skip(f"needs {shell}, which .ci/run installs")
    command = [sys.executable, "-m", "hil", "completion", shell]
    script = tmp_path / "completion"
    script.write_text(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout)
    start, before = STARTS[shell]
    with Terminal(start, tmp_path) as terminal:
        assert terminal.shows(f"{before}source {script}; echo rea''dy\n", "ready")
        assert terminal.shows("uuv-hil scenario ch\t", "scenario +check ")
        assert terminal.shows("\x15uuv-hil slave path_pl\t", "slave +path_planning ")
        assert terminal.shows("\x15uuv-hil sim --set master.sp\t0.5", r"--set +master\.speed=0\.5")

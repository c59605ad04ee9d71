"""Standard streams that are closed, full or limited to ASCII, Ctrl-C during imports, and errors of one line."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hil import cli
from hil.common import lifeline
from tests.support.processes import ROOT

TIMEOUT_S = 60.0


def run(command: str, **environment: str) -> tuple[int, str]:
    """Run a line of shell, in which UUV is the command; return exit code and standard error."""
    line = command.replace("UUV", f"{sys.executable} -m hil.cli")
    completed = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line],
        cwd=ROOT, env=os.environ | environment, capture_output=True, text=True, timeout=TIMEOUT_S, errors="replace",
    )  # fmt: skip
    assert "Traceback" not in completed.stderr
    assert "Exception ignored" not in completed.stderr
    return completed.returncode, completed.stderr


@pytest.mark.parametrize("buffered", ["", "1"])
@pytest.mark.parametrize(
    ("command", "codes", "message"),
    [
        ("UUV --help | head -1", {0, 141}, ""),
        ("UUV sim --help | true", {0, 141}, ""),
        ("UUV --help > /dev/full", {3}, "uuv-hil: the output: No space left on device; free some space"),
        ("UUV sim --help > /dev/full", {3}, "uuv-hil sim: the output: No space left"),
        ("UUV vehicle > /dev/full", {3}, "uuv-hil vehicle: the output: No space left"),
        ("UUV --help >&-", {2}, "uuv-hil: standard output is closed"),
        ("UUV --help >&- 2>&-", {2}, ""),
        ("UUV frame list 2>&- <&-", {0}, ""),
    ],
)
def test_a_closed_or_full_output_is_at_most_one_line_of_error(
    command: str, codes: set[int], message: str, buffered: str
) -> None:
    code, output = run(command, PYTHONUNBUFFERED=buffered)
    assert code in codes, output
    assert output.startswith(message)
    assert output.count("\n") == bool(message)


def test_a_closed_descriptor_is_not_given_to_a_file(tmp_path: Path) -> None:
    """The output of children would otherwise go into the first file that is opened."""
    code = """
import os, sys
from hil.common import streams
try:
    streams.prepare()
except streams.ConfigError:
    print(os.open("/", 0), file=sys.stderr)
"""
    completed = subprocess.run(
        ["bash", "-c", f'exec {sys.executable} -c "$CODE" >&- <&-'],
        cwd=ROOT, env=os.environ | {"CODE": code}, capture_output=True, text=True, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert int(completed.stderr) > 2


@pytest.mark.parametrize("name", ["/usr/bin/uuv-hil", "/usr/lib/python3/hil/__main__.py"])
def test_ctrl_c_while_modules_load_ends_quietly(name: str) -> None:
    """The handler is set before the command's own module is loaded."""
    code = f"""
import os, signal, sys
sys.argv = [{name!r}]
class Find:
    @staticmethod
    def find_spec(name, *_):
        if name == "hil.common.streams":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Find)
import hil.cli
"""
    completed = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    assert (completed.returncode, completed.stderr) == (130, "")


def test_ctrl_c_is_an_exception_again_once_all_is_loaded() -> None:
    before = signal.getsignal(signal.SIGINT)
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        lifeline.leave_on_ctrl_c()
        assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
        assert cli.main(["link", "frame", "list"]) == 0
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # nohup, or in the background of a script
        lifeline.leave_on_ctrl_c()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)

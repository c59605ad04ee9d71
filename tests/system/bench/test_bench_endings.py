"""Ctrl-C in the middle of a benchmark: results so far are saved and labelled as incomplete, and no process is left."""

import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import psutil
import pytest

from hil.bench.record import load
from hil.common.errors import STOPPED
from tests.support.processes import ROOT, wait_for

PATIENCE_S = 60.0


class Case(NamedTuple):
    """A benchmark, its output in the first and in the second configuration, and what its record has after the first.

    `place` is where it is stopped, `most` the number of values a figure may have, `missing` begins the names
    of figures without values.
    """

    words: list[str]
    first: str
    second: str
    place: str
    most: dict[str, int]  # values of each figure: a busy machine may lose a command
    missing: str
    printed: str
    pictured: bool = False


CASES = [
    Case(
        ["stream", "--seconds", "3", "--repeat", "9"],
        "run 1 of 9: listening", "run 2 of 9: listening", "run 2 of 9",
        {"rate [imu]": 1}, "nothing else", "medians of up to 9 runs",
    ),
    Case(
        ["load", "--vehicles", "1,2", "--seconds", "3"],
        "1 of 4: as it is", "2 of 4: 1 vehicle", "2 of 4: 1 vehicle",
        {"cpu [as it is]": 3}, "1 vehicle", "as it is", pictured=True,
    ),
    Case(
        ["startup", "--repeat", "3"],
        "warm: 1 of 3", "cold: 2 of 3", "cold: ",
        {"all [warm]": 3, "all [cold]": 2}, "nothing else", "medians of up to 3 starts",
    ),
    Case(
        ["delay", "--load", "0,1", "--seconds", "3", "--steps", "0"],
        "1 of 2: load 0", "2 of 2: load 1", "2 of 2: load 1",
        {"delay [load 0]": 60}, "load 1", "load 0",
    ),
]  # fmt: skip
for_each_case = pytest.mark.parametrize("case", CASES, ids=[case.words[0] for case in CASES])


def processes_of_folder(folder: Path) -> list[int]:
    """Return the processes that use the folder for temporary files, as those of a benchmark do."""
    own = ((process.pid, process.info["environ"] or {}) for process in psutil.process_iter(["environ"]))
    return [pid for pid, variables in own if variables.get("TMPDIR", "").startswith(str(folder))]


def is_shown(terminal: int, text: str) -> bool:
    """Return True if the terminal shows these words in time."""
    output, deadline = "", time.monotonic() + PATIENCE_S
    while text not in output and select.select((terminal,), (), (), deadline - time.monotonic())[0]:
        output += os.read(terminal, 4096).decode()
    return text in output


def is_ready(folder: Path) -> bool:
    """Return True if a slave of that benchmark is ready."""
    return any("ready" in log.read_text() for log in folder.glob("uuv-hil-scratch-bench-*/slave-*.log"))


def interrupt(folder: Path, arguments: list[str], when: str) -> tuple[int, str]:
    """Send Ctrl-C once these words are on the terminal and a slave runs; return exit code and output."""
    terminal, theirs = pty.openpty()
    with (folder / "printed").open("w") as printed:
        process = subprocess.Popen(
            [sys.executable, "-m", "hil.cli", "bench", *arguments],
            stdout=printed,
            stderr=theirs,
            cwd=ROOT,
            env={**os.environ, "TMPDIR": str(folder)},
            start_new_session=True,
        )
    os.close(theirs)
    try:
        assert is_shown(terminal, when)
        assert wait_for(lambda: is_ready(folder), PATIENCE_S)
        process.send_signal(signal.SIGINT)
        return process.wait(PATIENCE_S), (folder / "printed").read_text()
    finally:
        process.kill()
        process.wait()
        os.close(terminal)


@pytest.fixture(autouse=True)
def _nothing_left(tmp_path: Path) -> Iterator[None]:
    yield
    left = processes_of_folder(tmp_path)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert left == []
    assert not list(tmp_path.glob("uuv-hil-scratch-bench-*"))


@for_each_case
def test_results_before_ctrl_c_are_saved(case: Case, tmp_path: Path) -> None:
    file, png = tmp_path / "found.json", tmp_path / "found.png"
    picture = ["--plot", str(png)] if case.pictured else []
    code, output = interrupt(tmp_path, [*case.words, "--output", str(file), *picture], case.second)
    assert code == STOPPED
    assert case.printed in output
    assert f"label: STOPPED: {case.place}" in output
    record = load(str(file))
    assert record.labels[-1].startswith(f"STOPPED: {case.place}")
    assert all(0 < len(record.figures[name].values) <= most for name, most in case.most.items())
    assert not any(f"[{case.missing}" in name for name in record.figures)
    assert not any(line.startswith(case.missing) for line in output.splitlines())
    assert png.exists() == case.pictured


@for_each_case
def test_ctrl_c_before_any_result_leaves_no_file(case: Case, tmp_path: Path) -> None:
    file = tmp_path / "found.json"
    assert interrupt(tmp_path, [*case.words, "--output", str(file)], case.first) == (STOPPED, "")
    assert not file.exists()

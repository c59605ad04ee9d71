"""A killed program leaves no process, no port in use, and no folder that the next start does not remove."""

import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.commands.demo import require_free
from hil.common.scratch import ScratchFolder
from tests.support.processes import Program, children_of, command_line, is_running, wait_for, write_scenario

PATIENCE_S = 60.0
CAMERA = "[sensors.camera]\nwidth = 16\nheight = 16\nrate = 2\n"
HOSTILE = "select", "numpy", "joblib", "tempfile", "hashlib"


def descendants(pid: int) -> list[int]:
    """Return all running descendants of a process."""
    return [child for child in children_of(pid, recursive=True) if is_running(child)]


def kill(program: Program, least: int) -> None:
    """Kill the program; assert that none of its descendants is left."""
    family = descendants(program.process.pid)
    assert len(family) >= least, program.output
    program.process.kill()
    try:
        assert wait_for(lambda: not any(map(is_running, family)), PATIENCE_S)
    finally:
        for pid in filter(is_running, family):
            os.kill(pid, signal.SIGKILL)


@pytest.fixture
def scratch(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Provide a folder for temporary files; after the next start nothing is in it.

    Its path is short, because the path of a UNIX socket has at most 107 bytes.
    """
    folder = Path(tempfile.mkdtemp(dir="/tmp"))
    for name in ("TMPDIR", "XDG_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(folder))
    monkeypatch.setattr(tempfile, "tempdir", None)
    yield folder
    ScratchFolder("next").close()
    assert not list(folder.iterdir())
    folder.rmdir()


@pytest.mark.parametrize(
    ("kind", "more"), [("process", ""), ("native", ""), ("python", CAMERA)], ids=lambda word: word[:8]
)
def test_a_killed_slave_leaves_no_process(tmp_path: Path, scratch: Path, kind: str, more: str) -> None:
    scenario, port = write_scenario(tmp_path, top=f'stm32 = "{kind}"')
    scenario.write_text(scenario.read_text() + more)
    with Program(tmp_path, "slave", scenario) as program:
        program.expect("ready", PATIENCE_S)
        assert wait_for(lambda: descendants(program.process.pid), PATIENCE_S)
        kill(program, 1)
    require_free(f"tcp/127.0.0.1:{port}")


def test_a_killed_demo_leaves_no_process(tmp_path: Path, scratch: Path) -> None:
    scenario, port = write_scenario(tmp_path, top='stm32 = "process"')
    with Program(tmp_path, "demo", scenario, "--output", tmp_path / "run") as program:
        log = tmp_path / "run/slave.log"
        assert wait_for(lambda: log.exists() and "ready" in log.read_text(), PATIENCE_S), program.output
        kill(program, 3)  # master, slave, and the slave's STM32
    require_free(f"tcp/127.0.0.1:{port}")


def test_a_killed_benchmark_leaves_no_process(tmp_path: Path, scratch: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    with Program(tmp_path, "bench", "delay", scenario, "--seconds", "600", "--load", "1") as program:

        def is_ready() -> bool:
            return any("ready" in log.read_text() for log in scratch.glob("uuv-hil-scratch-bench-*/slave-*.log"))

        assert wait_for(is_ready, PATIENCE_S), program.output
        assert wait_for(lambda: len(descendants(program.process.pid)) >= 3, PATIENCE_S)  # slave, echo, burner
        kill(program, 3)
    assert list(scratch.iterdir()), "it had a folder"


@pytest.mark.parametrize("name", ["campaign", "case"])
def test_a_killed_campaign_or_case_leaves_no_worker(tmp_path: Path, name: str) -> None:
    what = [write_scenario(tmp_path)[0]] if name == "campaign" else ["path_planning", "--output", tmp_path / "out"]
    with Program(tmp_path, name, *what, "--seeds", "10000", "--jobs", "2") as program:
        assert wait_for(lambda: len(workers(program)) == 2, PATIENCE_S), program.output
        kill(program, 2)


def workers(program: Program) -> list[int]:
    """Return joblib's processes that have begun to work, so that they belong to the program."""
    return [pid for pid in descendants(program.process.pid) if "LokyProcess" in command_line(pid)]


COMMANDS = {
    "demo": ["demo", "{scenario}", "--output", "run"],
    "bench": ["bench", "delay", "{scenario}", "--seconds", "1", "--steps", "0", "--load", "1"],
    "campaign": ["campaign", "{scenario}", "--seeds", "2", "--jobs", "2"],
    "case": ["case", "path_planning", "--output", "out", "--seeds", "2", "--jobs", "2"],
    "doctor": ["doctor", "{scenario}"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_no_module_of_the_current_folder_is_executed(tmp_path: Path, name: str) -> None:
    """The installed program does not search that folder either, so only a child could execute such a module."""
    scenario, _ = write_scenario(tmp_path, top='stm32 = "process"')
    scenario.write_text(scenario.read_text() + CAMERA)
    folder = tmp_path / "here"
    folder.mkdir()
    for module in HOSTILE:
        (folder / f"{module}.py").write_text(
            f"open({str(tmp_path / 'executed')!r}, 'a').write('{module} ')\nraise SystemExit(99)"
        )
    words = [word.format(scenario=scenario) for word in COMMANDS[name]]
    with Program(
        tmp_path, *words, cwd=folder, command=[os.path.join(os.path.dirname(sys.executable), "uuv-hil")]
    ) as program:
        program.wait(300)
    executed = tmp_path / "executed"
    assert not executed.exists(), executed.read_text() + program.output


def test_a_user_defined_class_is_found_in_the_current_folder(tmp_path: Path) -> None:
    """The scenario names the class; the interpreter itself does not search the current folder."""
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(f'{scenario.read_text()}[planner]\nclass = "mine:Mine"\n')
    (tmp_path / "mine.py").write_text("from hil.master.follow import Follow\nclass Mine(Follow):\n    pass\n")
    with Program(tmp_path, "demo", scenario, "--output", "run", cwd=tmp_path) as program:
        program.expect("starting the slave", PATIENCE_S)
        assert program.wait(120) == 0, program.output

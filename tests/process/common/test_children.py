"""Child processes end with their parent, however the parent ends."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from hil.common import lifeline
from hil.common.children import ROOT, foreign_command, module_command, open_lifeline, package_environment, start_child
from tests.support.processes import is_running, wait_for

PATIENCE_S = 30.0

PARENT = """
import sys, time, threading
from hil.common.children import *
{start}
print(child.pid, flush=True)
time.sleep(600)
"""
ENDLESS = "import time; from hil.common.lifeline import die_with_parent; die_with_parent(); time.sleep(600)"


@pytest.fixture
def process_ids() -> Iterator[list[int]]:
    """Provide a list of process numbers, and end those processes in any case."""
    pids: list[int] = []
    yield pids
    for pid in filter(is_running, pids):
        os.kill(pid, signal.SIGKILL)


@contextmanager
def parent_of(start: str) -> Iterator[subprocess.Popen[str]]:
    """Provide a process that has started `child` in that way."""
    command = [sys.executable, "-c", PARENT.format(start=start)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as parent:
        try:
            yield parent
        finally:
            parent.kill()


START_METHODS = {
    "our own program": f"child = start_child([sys.executable, '-c', {ENDLESS!r}])",
    "a program of others": "child = start_child(foreign_command('sleep', '600'))",
    "a shell in between": "child = start_child(['sh', '-c', 'exec \"$@\"', '', *foreign_command('sleep', '600')])",
    "with all that it has started": "child = start_child(foreign_command('sh', '-c', 'sleep 600; true'))",
    "by a thread that ends": """
started = []
thread = threading.Thread(target=lambda: started.append(start_child(foreign_command('sleep', '600'))))
thread.start(); thread.join()
child = started[0]""",
}


@pytest.mark.parametrize("start_method", START_METHODS)
def test_a_child_ends_with_its_parent_and_not_before(start_method: str, process_ids: list[int]) -> None:
    with parent_of(START_METHODS[start_method]) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        process_ids += [parent.pid, child]
        group = wait_for(lambda: [pid for pid in group_of(child) if command_of(pid) == "sleep"] or is_ours(child))
        assert group, "it has not come up"
        assert is_running(child)
        process_ids += group_of(child)
        parent.kill()
        assert wait_for(lambda: not group_of(child), PATIENCE_S)


def is_ours(pid: int) -> list[int]:
    """Return the process, if its descriptors tell that the kernel will signal it."""
    for name in os.listdir(f"/proc/{pid}/fdinfo"):
        with suppress(FileNotFoundError):  # closed meanwhile
            flags = int(Path(f"/proc/{pid}/fdinfo/{name}").read_text().split("flags:")[1].split()[0], 8)
            if flags & os.O_ASYNC:
                return [pid]
    return []


def group_of(leader: int) -> list[int]:
    """Return the living processes of a group."""
    process_ids = []
    for pid in psutil.pids():
        with suppress(ProcessLookupError):
            if os.getpgid(pid) == leader and is_running(pid):
                process_ids.append(pid)
    return process_ids


def command_of(pid: int) -> str:
    return psutil.Process(pid).name() if psutil.pid_exists(pid) else ""


def test_a_child_whose_parent_ended_during_its_start_ends(tmp_path: Path, process_ids: list[int]) -> None:
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    slow = f"open({str(gate)!r}).read(); import os; open({str(tmp_path / 'late')!r}, 'w').write(str(os.getppid())); "
    with parent_of(f"child = start_child([sys.executable, '-c', {slow + ENDLESS!r}])") as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        process_ids += [parent.pid, child]
        parent.kill()
        parent.wait()
        assert is_running(child), "it does not know yet"
        gate.write_text("go")
        assert wait_for(lambda: not is_running(child), PATIENCE_S)
    assert int((tmp_path / "late").read_text()) != parent.pid


def test_a_process_with_another_parent_continues() -> None:
    lifeline.die_with_parent()  # there is no such parent
    with subprocess.Popen([sys.executable, "-c", ENDLESS + "\n"], cwd=ROOT) as child:
        with pytest.raises(subprocess.TimeoutExpired):
            child.wait(0.3)
        child.kill()


def test_an_invalid_descriptor_number_is_not_used_as_lifeline(monkeypatch: pytest.MonkeyPatch) -> None:
    end, other = os.pipe()
    os.close(other)  # to take it for the lifeline would be the end
    for text in ("", "x", "1", "-1:1", "999999:1", f"{'9' * 30}:1", f"{end}:0", f"{end}:x", f"{end}"):
        monkeypatch.setenv(lifeline.VARIABLE, text)
        lifeline.die_with_parent()
        assert lifeline.VARIABLE not in os.environ, "what this process starts is not to take it for its own"
    os.close(end)


def test_children_of_one_parent_do_not_end_with_each_other() -> None:
    children = [start_child(foreign_command("sleep", "600")) for _ in range(3)]
    try:
        children[0].kill()
        children[0].wait()
        assert wait_for(lambda: all(command_of(child.pid) == "sleep" for child in children[1:]), PATIENCE_S)
    finally:
        for child in children:
            child.kill()
            child.wait()


def test_a_child_leaves_no_open_descriptor() -> None:
    os.close(open_lifeline())
    before = os.listdir("/proc/self/fd")
    for _ in range(3):
        start_child(["true"]).wait()
    with pytest.raises(FileNotFoundError):
        start_child(["/there/is/none"])
    assert os.listdir("/proc/self/fd") == before


def test_a_fork_does_not_hold_the_lifeline_of_its_parent() -> None:
    os.close(open_lifeline())
    code = "import os, time; from hil.common import children; from hil.common.children import *\n"
    code += "os.close(open_lifeline())\n"
    code += "if os.fork() == 0: os._exit(len(children._pipe))\nprint(os.waitstatus_to_exitcode(os.wait()[1]))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "0\n", done.stderr


def test_a_foreign_program_has_default_signal_handling() -> None:
    child = start_child(foreign_command("cat", "/proc/self/status"), stdout=subprocess.PIPE, text=True)
    output = dict(line.split(":\t") for line in child.communicate()[0].splitlines())
    assert int(output["SigIgn"], 16) & (1 << (signal.SIGPIPE - 1) | 1 << (signal.SIGXFSZ - 1)) == 0


def test_a_foreign_program_does_not_see_the_lifeline_variable() -> None:
    child = start_child(foreign_command("env"), environment={"PATH": os.environ["PATH"]}, stdout=subprocess.PIPE)
    assert lifeline.VARIABLE.encode() not in child.communicate()[0]


def test_modules_of_the_current_folder_are_not_imported(tmp_path: Path) -> None:
    (tmp_path / "select.py").write_text("open('executed', 'w')")
    command = [*module_command("hil.cli"), "--version"]
    done = start_child(command, environment=package_environment(), cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert done.communicate()[0].startswith("uuv-hil "), "our packages are found"
    assert not (tmp_path / "executed").exists()


def test_children_started_by_several_threads_at_once_end_with_the_parent(process_ids: list[int]) -> None:
    code = """
import threading
start, started = threading.Barrier(4), []
def run():
    start.wait()
    started.append(start_child(foreign_command('sleep', '600')))
threads = [threading.Thread(target=run) for _ in range(4)]
for thread in threads: thread.start()
for thread in threads: thread.join()
for child in started: print(child.pid)
"""
    with parent_of(code) as parent:
        assert parent.stdout is not None
        children = [int(parent.stdout.readline()) for _ in range(5)][:4]  # the last is printed twice
        process_ids += [parent.pid, *children]
        assert wait_for(lambda: all(command_of(child) == "sleep" for child in children), PATIENCE_S)
        parent.kill()
        assert wait_for(lambda: not any(map(is_running, children)), PATIENCE_S)


def test_closing_one_lifeline_descriptor_does_not_end_children() -> None:
    end = open_lifeline()
    other = open_lifeline()
    os.close(other)
    child = start_child(foreign_command("sleep", "600"))
    os.close(end)
    try:
        assert wait_for(lambda: command_of(child.pid) == "sleep", PATIENCE_S)
        assert is_running(child.pid)
    finally:
        child.kill()
        child.wait()


def test_every_started_interpreter_ignores_the_current_folder() -> None:
    """`python -m` looks for modules in the current folder first: only `hil.common.children` writes such a command."""
    child_command = re.compile(r'sys\.executable, "-[cm]"')
    folders = [Path(ROOT) / name for name in ("hil", "sim", "boards", "firmware_stub")]
    paths = [path for folder in folders for path in folder.rglob("*.py") if path.name != "children.py"]
    assert len(paths) > 300
    assert not [path for path in paths if child_command.search(path.read_text(encoding="utf-8"))]

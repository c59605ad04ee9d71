"""Faults of the slave's machine: its disk, its memory, its clock."""

import json
import os
import resource
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import psutil

from firmware_stub.build import native_compiler
from hil.common.errors import DeviceError, NetworkError
from tools.faults.rig import START_S, Rig
from tools.faults.rows import Fault

HOUR_S = 3600
WRONG_CLOCK = "clock_step.so"
DISK_KIB = 2048
ROOM_KIB = 512  # memory that the slave may still allocate
UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
RECORDING = '[recording]\nslave = true\nfolder = "{disk}"\nkeep_free = 0\n'


def disk(rig: Rig) -> Path:
    """Return the folder in which the slave records; a small disk of its own after `prepare`."""
    return rig.folder / "disk"


def prepare(rig: Rig) -> None:
    """Mount a disk of 2 MiB for recordings if permitted, and compile the wrong clock if there is a compiler."""
    if not _needs_compiler(rig):
        source = str(Path(__file__).with_name("clock_step.c"))
        _run(*native_compiler(), "-O2", "-shared", "-fPIC", source, "-o", str(rig.folder / WRONG_CLOCK), "-ldl")
    disk(rig).mkdir()
    if _root_only(rig):
        return
    command = ["mount", "-t", "tmpfs", "-o", f"size={DISK_KIB}k", "tmpfs", str(disk(rig))]
    if subprocess.run(command, capture_output=True, check=False).returncode == 0:
        rig.at_end(lambda: _run("umount", "-l", str(disk(rig))))
        rig.has_disk = True


def _root_only(_: Rig) -> str:
    return "" if os.geteuid() == 0 else "needs root, to mount a small disk"


def _needs_disk(rig: Rig) -> str:
    return _root_only(rig) or ("" if rig.has_disk else "this machine mounts nothing")


def _needs_compiler(_: Rig) -> str:
    try:
        native_compiler()
    except DeviceError as error:
        return str(error)
    return ""


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise DeviceError(f"{' '.join(command)}: {done.stderr.strip()}")


def _fill(rig: Rig) -> None:
    with (disk(rig) / "full").open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))


def _free(rig: Rig) -> None:
    (disk(rig) / "full").unlink()


def _limit(rig: Rig, which: int, most: int) -> None:
    resource.prlimit(rig.processes["slave"].pid, which, (most, resource.RLIM_INFINITY))


def _unlimit(rig: Rig, which: int) -> None:
    """Remove the limit; restart a slave that ended because of it, as its service manager would."""
    if rig.processes["slave"].running:
        resource.prlimit(rig.processes["slave"].pid, which, UNLIMITED)
    else:
        rig.processes.pop("slave").wait(10.0)
        rig.start_slave()


def _no_more_memory(rig: Rig) -> None:
    """Limit the slave's memory to what it has, and connect a second planner, which needs some."""
    used = psutil.Process(rig.processes["slave"].pid).memory_info().vms
    _limit(rig, resource.RLIMIT_AS, used + ROOM_KIB * 1024)
    with suppress(NetworkError):
        rig.start_planner("second", patience_s=2.0)
    rig.end("second")


def _with_clock(process: str, step_s: int) -> Callable[[Rig], None]:
    """Restart a process with a wall clock that is wrong by `step_s`."""

    def start(rig: Rig) -> None:
        preload = {"LD_PRELOAD": str(rig.folder / WRONG_CLOCK), "CLOCK_STEP_S": str(step_s)}
        rig.environments[process] = preload if step_s else {}
        if process == "slave":
            rig.signal("slave", signal.SIGKILL)
            rig.processes.pop("slave").wait(10.0)
            rig.start_slave()
        else:
            rig.end("planner")
            rig.start_planner("planner")

    return start


def _check_planner(rig: Rig) -> None:
    """Check that the planner still sees the vehicle: a wrong clock must not make it look absent."""
    rig.instruct("astern")
    rig.await_pins("astern", START_S)
    end_s = time.monotonic() + START_S
    while True:
        rig.instruct("ask")
        line = rig.processes["planner"].expect("figures", 10.0)
        figures = json.loads(line.partition(" ")[2])
        if figures["present"] or time.monotonic() > end_s:  # it executes commands before it is reported as present
            break
    if figures["problem"] or not figures["present"]:
        raise NetworkError(f"the planner reports: {figures['problem'] or 'the vehicle is lost'}")


FAULTS = (
    Fault("disk", "file size limit reached", lambda rig: _limit(rig, resource.RLIMIT_FSIZE, 0),
          lambda rig: _unlimit(rig, resource.RLIMIT_FSIZE), cuts=False, hold_s=1.5, quick=True),
    Fault("disk", "full", _fill, _free, cuts=False, hold_s=1.5, unavailable=_needs_disk),
    Fault("memory", "limit of the slave reached", _no_more_memory, lambda rig: _unlimit(rig, resource.RLIMIT_AS),
          cuts=False, steady=False),
    Fault("clock", "slave restarted, 1 h behind", _with_clock("slave", -HOUR_S), _check_planner, hold_s=0.0,
          unavailable=_needs_compiler),
    Fault("clock", "slave restarted, clock set", _with_clock("slave", 0), _check_planner, hold_s=0.0,
          unavailable=_needs_compiler),
    Fault("clock", "planner restarted, 1 h ahead", _with_clock("planner", HOUR_S), _check_planner, hold_s=0.0,
          unavailable=_needs_compiler),
    Fault("clock", "planner restarted, clock set", _with_clock("planner", 0), _check_planner, hold_s=0.0,
          unavailable=_needs_compiler),
)  # fmt: skip

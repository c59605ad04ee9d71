"""Faults of the slave's machine: its disk, its memory, its clock."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import psutil

from firmware_stub.build import native_compiler
from hil.common.children import module_command
from hil.common.errors import DeviceError, NetworkError
from tools.faults.rig import START_S, Rig
from tools.faults.rows import Fault

HOUR_S = 3600
STEPS_S = (HOUR_S, -2 * HOUR_S)  # unlike each other, as they are set right again
CLOCK_S = 2.0  # between two steps of a clock
CLOCKS = ("slave", "planner", "recorder", "gateway")
BESIDE = {  # process -> its command, when it is ready, and its last line if all is well
    "recorder": (("recording", "make"), "recording tcp", "none lost"),
    "gateway": (("gateway", "json"), "connected: uuv1", "connected: uuv1"),
}
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
        for process in CLOCKS:
            _set_clock(rig, process, 0)
            step = {"CLOCK_STEP_FILE": str(_step_file(rig, process))}
            rig.environments[process] = {"LD_PRELOAD": str(rig.folder / WRONG_CLOCK), **step}
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


def _step_file(rig: Rig, process: str) -> Path:
    return rig.folder / f"{process}.clock"


def _set_clock(rig: Rig, process: str, step_s: int) -> None:
    """Set the wall clock of a process, now, to be wrong by `step_s`; the file stays, because it is mapped."""
    _step_file(rig, process).touch()
    with _step_file(rig, process).open("r+b") as file:
        file.write(step_s.to_bytes(8, sys.byteorder, signed=True))


def _set_running(process: str, step_s: int) -> Callable[[Rig], None]:
    """Set the clock of the running slave or planner; a slave reports it in its log. 0 sets it right."""

    def apply(rig: Rig) -> None:
        _set_clock(rig, process, step_s)
        if not step_s:
            _check_planner(rig)
        elif process == "slave":
            rig.processes["slave"].expect(f"clock was set by {step_s:+.3f} s", START_S)

    return apply


def _set_beside(process: str, step_s: int) -> Callable[[Rig], None]:
    """Set the clock of a recorder or gateway beside the slave, and set it right; it must run on and miss nothing."""

    def apply(rig: Rig) -> None:
        words, ready, good = BESIDE[process]
        place = ["--listen", "127.0.0.1:0"]
        if process == "recorder":
            place = ["--scenario", str(rig.scenario), "-o", str(disk(rig) / f"{process}{step_s}")]
        command = module_command("hil.cli", *words, "--connect", f"tcp/127.0.0.1:{rig.port}", *place)
        with rig.beside(process, command, ready) as started:
            for step in (step_s, 0):
                rig.pause(CLOCK_S)
                _set_clock(rig, process, step)
            rig.pause(CLOCK_S)
        if good not in started.last_line:
            raise NetworkError(f"the {process} {started.ending}")

    return apply


def _with_clock(process: str, step_s: int) -> Callable[[Rig], None]:
    """Restart a process with a wall clock that is wrong by `step_s`."""

    def start(rig: Rig) -> None:
        _set_clock(rig, process, step_s)
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
        # It executes commands before it is reported as present, and before its first sample after a restart.
        if (figures["present"] and not figures["problem"]) or time.monotonic() > end_s:
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
    *(Fault("clock", f"{process}'s clock set {step / HOUR_S:+.0f} h", *how, cuts=False, unavailable=_needs_compiler)
      for process in CLOCKS for step in STEPS_S
      for how in [(_set_beside(process, step), _check_planner) if process in BESIDE
                  else (_set_running(process, step), _set_running(process, 0))]),
)  # fmt: skip

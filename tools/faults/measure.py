"""Measure one row: apply a fault, and measure its effects at the STM32's end."""

import os
import re
import time
from math import isfinite, nan

import psutil

from hil.common.errors import HilError
from tools.faults.rig import Rig
from tools.faults.rows import RECOVERY_S, Fault, Row, judge

BEGIN_S = 20.0  # limit until the outputs follow the planner at the start
SETTLE_S = 0.3  # from the start of a fault that does not cut control to the planner's silence
LONG_S = 10.0  # longest wait for neutral outputs
AFTER_S = 0.4  # time in which old commands may still show after the vehicle executes commands again
LEAK_S = 5.0  # limit until sockets of lost connections are closed
SPARE = 2  # permitted further descriptors, such as a thread's event or a log
# Lines that a slave logs without any fault.
USUAL = re.compile(
    r"ready |scheduling:|memory:|garbage|idle processors|master \S+ is connected|commands arrive|real-time"
)


def measure(rig: Rig, fault: Fault) -> Row:
    """Apply the fault to a running `rig`, then remove it; return the measured and judged row."""
    problems: list[str] = []
    logs = _Logs(rig)
    rig.instruct("ahead")
    if rig.await_pins("ahead", BEGIN_S) != rig.await_pins("ahead", 0.0):
        problems.append("the vehicle executed no commands before the fault")
    time.sleep(0.1)
    descriptors, files = rig.descriptors, _files(rig)
    began = time.monotonic()
    try:
        fault.apply(rig)
        if not fault.cuts:
            time.sleep(SETTLE_S)
            if fault.steady and rig.pins.executed("neutral", began):
                problems.append("the outputs fell to neutral under the planner's commands")
            began = time.monotonic()
            rig.instruct("silent")
        neutral_s = nan if fault.after_removal else rig.await_pins("neutral", LONG_S) - began
        rig.instruct("silent" if fault.after_removal else "astern")
        time.sleep(fault.hold_s)
        repaired = time.monotonic()
        fault.remove(rig)
        if fault.after_removal:
            neutral_s = max(0.0, rig.await_pins("neutral", LONG_S) - repaired)
            rig.instruct("astern")
        recovery_s = rig.await_pins("astern", 2.0 * RECOVERY_S) - repaired
    except HilError as error:
        problems.append(str(error))
        neutral_s = recovery_s = nan
    time.sleep(AFTER_S)
    limit_s = rig.link.limit_s + fault.extra_s
    measured = isfinite(recovery_s) or isfinite(neutral_s)
    stale = rig.pins.executed("ahead", rig.ahead_until_s + limit_s) + rig.foreign if measured else 0
    rig.foreign = 0
    reported = logs.new()
    row = Row(
        fault.room, fault.name, rig.link.name, max(neutral_s, 0.0) if neutral_s == neutral_s else nan, limit_s,
        max(recovery_s, 0.0) if recovery_s == recovery_s else nan, stale, reported, _leaked(rig, descriptors, files),
        (*problems, *(["a traceback: " + logs.last_words] if "Traceback" in logs.text else [])),
    )  # fmt: skip
    return judge(row)


class _Logs:
    """Text that slaves log after this object was made."""

    def __init__(self, rig: Rig) -> None:
        self._folder = rig.folder
        self._before = {path: path.stat().st_size for path in rig.folder.glob("slave-*.log")}

    @property
    def text(self) -> str:
        """Return all of it."""
        output = ""
        for path in sorted(self._folder.glob("slave-*.log")):
            output += path.read_bytes()[self._before.get(path, 0) :].decode(errors="replace")
        return output

    @property
    def last_words(self) -> str:
        """Return its last line."""
        return (self.text.strip().splitlines() or [""])[-1]

    def new(self) -> str:
        """Return the first line that is not `USUAL`, without its time."""
        for line in self.text.splitlines():
            text = re.sub(r"^\[ *[\d.]+\] slave: ", "", line)
            if text and not USUAL.match(text):
                return text.replace(str(self._folder), "...")
        return ""


def _files(rig: Rig) -> set[str]:
    """Return the temporary files of the rig, except logs."""
    return {path.name for path in rig.folder.iterdir() if path.suffix != ".log"}


def _leaked(rig: Rig, descriptors: int, files: set[str]) -> str:
    """Return leaked resources: further descriptors of the slave, processes that outlive their parents, files."""
    deadline = time.monotonic() + LEAK_S
    while True:
        leftovers = []
        more = rig.descriptors - descriptors
        if descriptors and more > SPARE:
            leftovers.append(f"{more} descriptors")
        if strays := _strays(rig):
            leftovers.append(f"processes {' '.join(map(str, strays))}")
        if rest := _files(rig) - files:
            leftovers.append(f"files {' '.join(sorted(rest))}")
        if not leftovers or time.monotonic() > deadline:
            return ", ".join(leftovers)
        time.sleep(0.1)


def _strays(rig: Rig) -> list[int]:
    """Return processes that name a file of the rig in their command line but do not belong to it."""
    own_pids = {process.pid for process in rig.processes.values()} | {rig.stm32.pid if rig.stm32 else 0, os.getpid()}
    pids = []
    for process in psutil.process_iter(["cmdline", "ppid"]):
        named = any(str(rig.folder) in word for word in process.info["cmdline"] or ())
        if named and process.pid not in own_pids and process.info["ppid"] not in own_pids:
            pids.append(process.pid)
    return pids

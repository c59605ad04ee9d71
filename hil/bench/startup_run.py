"""What a start costs: a slave's, phase by phase, beside interpreters that do nothing, cold and warm."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

from hil.bench.harness import READY_S, ROOT, Bench, await_vehicle, open_text
from hil.clock import NS_PER_MS, to_wall_ns
from hil.errors import ConfigError, NetworkError

FLOORS = {"bare interpreter": "pass", "numpy and zenoh": "import numpy, zenoh"}
# The slave's own instants, and what has gone on until each of them.
PHASES = {
    "python": "interpreter",
    "scenario": "scenario",
    "imports": "imports",
    "simulator": "simulator",
    "link": "thruster link",
    "session": "network session",
    "ready": "first step",
}
AT_MASTER = "first sample at the master"
DROP_CACHES = "/proc/sys/vm/drop_caches"


class Start(NamedTuple):
    """One start, all in ms after the exec: when each phase ended, and the first sample at the master last."""

    ends: dict[str, float]

    @property
    def total(self) -> float:
        """Until the first sample at the master."""
        return self.ends[AT_MASTER]

    def phases(self) -> dict[str, float]:
        """What each phase took, ms."""
        before, took = 0.0, {}
        for name, end in self.ends.items():
            took[name] = end - before
            before = end
        return took


def start(bench: Bench) -> Start:
    """Start a slave while a master dials, and end both. Raises NetworkError."""
    with bench.client() as client:
        slave = bench.start_slave()
        await_vehicle(client, slave)
        health = client.diagnostics()
        sample = (client.first_sample_wall_ns - to_wall_ns(slave.exec_ns)) / NS_PER_MS
        ends = {title: float(health[f"startup_{name}_ms"]) for name, title in PHASES.items()}
        slave.stop()
    return Start({**dict(sorted(ends.items(), key=lambda end: end[1])), AT_MASTER: sample})


def time_floor(code: str) -> float:
    """How long an interpreter takes that runs `code`, from exec until it has ended, ms."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
    return (time.perf_counter() - began) * 1e3


def files_of_a_start(bench: Bench) -> list[str]:
    """The files that the slave and the floors read: modules as the interpreter tells of them, and what is mapped."""
    found: set[str] = set()
    with bench.client() as client:
        slave = bench.start_slave(environment={"PYTHONVERBOSE": "1"})
        if not client.wait_for_vehicle(READY_S):
            raise NetworkError(f"the slave did not start: {slave.last_words}")
        found |= set(re.findall(r"/\S+", open_text(f"/proc/{slave.pid}/maps")))
        slave.stop()
        found |= _modules(slave.said)
    for code in FLOORS.values():
        done = subprocess.run([sys.executable, "-v", "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
        found |= _modules(done.stderr)
    return sorted(path for path in found if os.path.isfile(path) and not path.startswith(("/dev/", "/proc/")))


def _modules(text: str) -> set[str]:
    """Of what `python -v` says: "# code object from '...'", "# ... matches ...", "... loaded from '...'"."""
    quoted = re.findall(r"(?:from|loaded from) '(/[^']+)'", text)
    compared = re.findall(r"# (/\S+) matches (/\S+)", text)
    return {*quoted, *(path for pair in compared for path in pair)}


def coldness(files: Iterable[str], whole_machine: bool) -> tuple[Callable[[], None], str]:
    """What makes the next start cold, and how, in words. Raises ConfigError when that is not allowed."""
    if whole_machine:
        if not os.access(DROP_CACHES, os.W_OK):
            raise ConfigError(f"{DROP_CACHES}: only root may; without --drop-caches only the files of a start go")
        return _drop_all, f"all caches dropped ({DROP_CACHES})"
    kept = list(files)
    text = f"{len(kept)} files dropped (posix_fadvise); pages that a running process has mapped stay, such as Python's"
    return lambda: _drop(kept), text


def _drop_all() -> None:
    os.sync()
    with open(DROP_CACHES, "w") as file:
        file.write("3")


def _drop(files: Iterable[str]) -> None:
    for path in files:
        try:
            descriptor = os.open(path, os.O_RDONLY)
        except OSError:
            continue
        try:
            os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        finally:
            os.close(descriptor)

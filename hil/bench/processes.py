"""What processes cost over time, thread by thread, from /proc."""

import os
import time
from typing import NamedTuple

from hil.process import pss_mib

_TICK = 1.0 / os.sysconf("SC_CLK_TCK")


class Threads(NamedTuple):
    """Processor time (s) that each thread of some processes has used, by "process id/thread id name"; memory (MiB)."""

    cpu_s: dict[str, float]
    pss_mib: float
    descriptors: int
    at_s: float


def look(pids: list[int]) -> Threads:
    """As they are now; what has ended is left out."""
    found: dict[str, float] = {}
    for pid in pids:
        for thread in _names(f"/proc/{pid}/task"):
            cpu = _thread_cpu_s(f"/proc/{pid}/task/{thread}")
            if cpu is not None:
                found[f"{pid}/{thread} {cpu[0]}"] = cpu[1]
    descriptors = sum(len(_names(f"/proc/{pid}/fd")) for pid in pids)
    return Threads(found, sum(map(pss_mib, pids)), descriptors, time.monotonic())


def shares(before: Threads, after: Threads) -> dict[str, float]:
    """What share of a core each thread used between two looks; a thread that was not there before began with 0."""
    seconds = after.at_s - before.at_s
    return {name: (cpu - before.cpu_s.get(name, 0.0)) / seconds for name, cpu in after.cpu_s.items()}


def by_name(threads: dict[str, float]) -> dict[str, float]:
    """Shares of threads of equal name together, the largest first."""
    found: dict[str, float] = {}
    for name, share in threads.items():
        plain = name.partition(" ")[2]
        found[plain] = found.get(plain, 0.0) + share
    return dict(sorted(found.items(), key=lambda row: -row[1]))


def _thread_cpu_s(folder: str) -> tuple[str, float] | None:
    """A thread's name and processor time: of /proc's schedstat, in ns, else of its clock ticks."""
    try:
        with open(f"{folder}/comm") as file:
            name = file.read().strip()
        with open(f"{folder}/schedstat") as file:
            ran_ns = int(file.read().split()[0])
        if ran_ns:
            return name, ran_ns * 1e-9
        with open(f"{folder}/stat", "rb") as stat:
            fields = stat.read().rpartition(b")")[2].split()
    except (OSError, ValueError, IndexError):
        return None
    return name, (int(fields[11]) + int(fields[12])) * _TICK


def _names(folder: str) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []

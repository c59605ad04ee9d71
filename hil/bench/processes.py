"""What processes cost over time, thread by thread, from /proc."""

import os
import time
from typing import NamedTuple

_TICK = 1.0 / os.sysconf("SC_CLK_TCK")


class Memory(NamedTuple):
    """Of one process or several, MiB: with its share of what others use too, and what is its own alone."""

    pss_mib: float
    private_mib: float


class Threads(NamedTuple):
    """Processor time (s) that each thread of some processes has used, by "process id/thread id name"; memory by pid."""

    cpu_s: dict[str, float]
    memory: dict[int, Memory]
    descriptors: int
    at_s: float

    @property
    def pss_mib(self) -> float:
        """The proportional set size of all of them."""
        return sum(each.pss_mib for each in self.memory.values())

    @property
    def private_mib(self) -> float:
        """What is theirs alone: it does not move when others come or go that use the same files."""
        return sum(each.private_mib for each in self.memory.values())


def look(pids: list[int]) -> Threads:
    """As they are now; what has ended is left out."""
    found: dict[str, float] = {}
    for pid in pids:
        for thread in _names(f"/proc/{pid}/task"):
            cpu = _thread_cpu_s(f"/proc/{pid}/task/{thread}")
            if cpu is not None:
                found[f"{pid}/{thread} {cpu[0]}"] = cpu[1]
    descriptors = sum(len(_names(f"/proc/{pid}/fd")) for pid in pids)
    return Threads(found, {pid: memory_of(pid) for pid in pids}, descriptors, time.monotonic())


def shares(before: Threads, after: Threads) -> dict[str, float]:
    """What share of a core each thread used between two looks; a thread that was not there before began with 0."""
    seconds = after.at_s - before.at_s
    return {name: (cpu - before.cpu_s.get(name, 0.0)) / seconds for name, cpu in after.cpu_s.items()}


def thread_names(keys: set[str]) -> dict[str, str]:
    """What to call each thread within its process: its name, numbered where several have the same.

    keys: "process id/thread id name".
    """
    found: dict[str, str] = {}
    seen: dict[tuple[str, str], int] = {}
    for key in sorted(keys, key=_ids):
        pid, name = key.partition("/")[0], key.partition(" ")[2]
        number = seen[pid, name] = seen.get((pid, name), 0) + 1
        found[key] = f"{name} #{number}" if number > 1 else name
    return found


def role(pid: int, slave: int) -> str:
    """What a process of a slave's family does: "slave", "imaging" or "STM32"."""
    if pid == slave:
        return "slave"
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as file:
            return "imaging" if b"imaging" in file.read() else "STM32"
    except OSError:
        return "STM32"


def memory_of(pid: int) -> Memory:
    """Of one process, from its smaps_rollup; 0 when it is gone or not ours to look at."""
    found = dict.fromkeys((b"Pss:", b"Private_Clean:", b"Private_Dirty:"), 0)
    try:
        with open(f"/proc/{pid}/smaps_rollup", "rb") as file:
            for name, kib, *_ in map(bytes.split, file.readlines()[1:]):
                if name in found:
                    found[name] = int(kib)
    except OSError:
        pass
    pss, clean, dirty = found.values()
    return Memory(pss / 1024, (clean + dirty) / 1024)


def _ids(key: str) -> tuple[int, int]:
    pid, _, thread = key.partition(" ")[0].partition("/")
    return int(pid), int(thread)


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

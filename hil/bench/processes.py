"""Measure the cost of processes over time, per thread, with psutil."""

import time
from collections.abc import Iterable
from contextlib import suppress
from math import nan
from typing import NamedTuple

import psutil


class Memory(NamedTuple):
    """Memory of processes in MiB: proportional set size, and private memory."""

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
        """Private memory of all (MiB): it does not change with other processes that use the same files."""
        return sum(each.private_mib for each in self.memory.values())


def read_threads(pids: list[int]) -> Threads:
    """Read the present figures of all threads; those that have ended are left out."""
    cpu: dict[str, float] = {}
    memory: dict[int, Memory] = {}
    descriptors = 0
    for pid in pids:
        with suppress(psutil.Error):
            process = psutil.Process(pid)
            cpu |= _threads(process)
            memory[pid] = _memory(process)
            descriptors += process.num_fds()
    return Threads(cpu, memory, descriptors, time.monotonic())


def shares(before: Threads, after: Threads) -> dict[str, float]:
    """Return what share of a core each thread used between two samples.

    A thread that was not there before began with 0.
    """
    seconds = after.at_s - before.at_s
    return {name: (cpu - before.cpu_s.get(name, 0.0)) / seconds for name, cpu in after.cpu_s.items()}


def thread_names(keys: set[str]) -> dict[str, str]:
    """Return a unique name for each thread within its process: its name, numbered where several have the same.

    keys: "process id/thread id name".
    """
    names: dict[str, str] = {}
    seen: dict[tuple[str, str], int] = {}
    for key in sorted(keys, key=_ids):
        pid, name = key.partition("/")[0], key.partition(" ")[2]
        number = seen[pid, name] = seen.get((pid, name), 0) + 1
        names[key] = f"{name} #{number}" if number > 1 else name
    return names


def role(pid: int, slave: int) -> str:
    """Return the role of a process of a slave's family: "slave", "imaging" or "STM32"."""
    if pid == slave:
        return "slave"
    with suppress(psutil.Error):
        if any("imaging" in word for word in psutil.Process(pid).cmdline()):
            return "imaging"
    return "STM32"


def family(pid: int) -> list[int]:
    """Return a process and all its descendants; none if it has ended."""
    try:
        process = psutil.Process(pid)
        return [pid, *(child.pid for child in process.children(recursive=True))]
    except psutil.Error:
        return []


def cpu_s(pids: Iterable[int]) -> float:
    """Return the processor time (s, user and system) that processes have used; those that have ended count 0."""
    total = 0.0
    for pid in pids:
        with suppress(psutil.Error):
            used = psutil.Process(pid).cpu_times()
            total += used.user + used.system
    return total


def resident_mib(pids: Iterable[int]) -> float:
    """Return the resident memory (MiB) of processes, shared pages included; nan if none is left.

    From their mappings, as the kernel's quick sum may lag behind.
    """
    total = 0
    for pid in pids:
        with suppress(psutil.Error):
            total += sum(mapping.rss for mapping in psutil.Process(pid).memory_maps())
    return total / 2**20 if total else nan


def mapped_files(pid: int) -> set[str]:
    """Return the paths of the files that a process has mapped; none if it has ended."""
    try:
        return {mapping.path for mapping in psutil.Process(pid).memory_maps() if mapping.path.startswith("/")}
    except psutil.Error:
        return set()


def _memory(process: psutil.Process) -> Memory:
    memory = process.memory_full_info()
    return Memory(memory.pss / 2**20, memory.uss / 2**20)


def _threads(process: psutil.Process) -> dict[str, float]:
    seconds = {}
    for thread in process.threads():
        with suppress(psutil.Error):  # it has ended meanwhile
            name = psutil.Process(thread.id).name()  # a thread has an entry of its own below /proc
            seconds[f"{process.pid}/{thread.id} {name}"] = thread.user_time + thread.system_time
    return seconds


def _ids(key: str) -> tuple[int, int]:
    pid, _, thread = key.partition(" ")[0].partition("/")
    return int(pid), int(thread)

"""Measure the cost of processes over time with psutil."""

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


class Usage(NamedTuple):
    """What some processes have used: processor time (s) and memory of each by pid, threads and descriptors of all."""

    cpu_s: dict[int, float]
    memory: dict[int, Memory]
    threads: int
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


def read_usage(pids: list[int]) -> Usage:
    """Read the present figures of processes; those that have ended are left out."""
    cpu: dict[int, float] = {}
    memory: dict[int, Memory] = {}
    threads = descriptors = 0
    for pid in pids:
        with suppress(psutil.Error):
            process = psutil.Process(pid)
            used = process.cpu_times()
            cpu[pid] = used.user + used.system
            memory[pid] = _memory(process)
            threads += process.num_threads()
            descriptors += process.num_fds()
    return Usage(cpu, memory, threads, descriptors, time.monotonic())


def shares(before: Usage, after: Usage) -> dict[int, float]:
    """Return what share of a core each process used between two samples.

    A process that was not there before began with 0.
    """
    seconds = after.at_s - before.at_s
    return {pid: (cpu - before.cpu_s.get(pid, 0.0)) / seconds for pid, cpu in after.cpu_s.items()}


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


def _memory(process: psutil.Process) -> Memory:
    memory = process.memory_full_info()
    return Memory(memory.pss / 2**20, memory.uss / 2**20)

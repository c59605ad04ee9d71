"""Read the memory and processor time of the slave and its children from /proc, once a second.

psutil would cost the slave's start 13 to 20 ms of processor time and 1.5 MiB (measured with 7.2.2 on a PC; a Raspberry
Pi 4B is several times slower). All other rooms use psutil (hil/bench/processes.py).
"""

import os
import time
from math import inf
from typing import TYPE_CHECKING

from hil.common.clock import return_memory

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics

_PAGE_MIB = os.sysconf("SC_PAGE_SIZE") / 2**20


def pss_mib(pid: int | str = "self") -> float:
    """Return the proportional set size of a process (MiB): its own pages, and its share of pages shared with others.

    Return 0 if the process has ended or may not be read.
    """
    try:
        with open(f"/proc/{pid}/smaps_rollup", "rb") as file:
            for line in file:
                if line.startswith(b"Pss:"):
                    return int(line.split()[1]) / 1024
    except OSError:
        pass
    return 0.0


def resident_mib(pid: int | str = "self") -> float:
    """Return the resident memory of a process (MiB), shared pages counted in full; 0 if the process has ended."""
    try:
        with open(f"/proc/{pid}/statm", "rb") as file:
            return int(file.read().split()[1]) * _PAGE_MIB
    except OSError:
        return 0.0


def cpu_s(pid: int) -> float:
    """Return the processor time (s, user and system, resolution one clock tick) of a process; 0 if it has ended."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:
            fields = file.read().rpartition(b")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def own_cpu_s(children: tuple[int, ...] = ()) -> float:
    """Return the processor time (s) of this process with all its threads, and of its children."""
    return time.process_time() + sum(map(cpu_s, children))


def own_pss_mib(children: tuple[int, ...] = ()) -> float:
    """Return the proportional set size (MiB) of this process and of its children."""
    return pss_mib() + sum(map(pss_mib, children))


class Memory:
    """The proportional set size of this process and its children, cached for frequent reads.

    The kernel walks through all pages to compute it, 1 ms for 20 MiB, but knows the resident size at once. So it is
    read again when the resident size has changed by more than `CHANGE_MIB`, and when the value is `OLDEST_S` old,
    because other processes that share pages may have started or ended.
    """

    CHANGE_MIB = 0.0625
    OLDEST_S = 10.0

    def __init__(self) -> None:
        self._mib = 0.0
        self._resident_mib = -inf
        self._read_s = 0.0

    def pss_mib(self, children: tuple[int, ...] = ()) -> float:
        """Return the value of `own_pss_mib`, up to `OLDEST_S` old."""
        now = time.monotonic()
        resident = resident_mib() + sum(map(resident_mib, children))
        if abs(resident - self._resident_mib) > self.CHANGE_MIB or now - self._read_s >= self.OLDEST_S:
            self._mib, self._resident_mib, self._read_s = own_pss_mib(children), resident, now
        return self._mib

    def add_figures(self, figures: "Diagnostics", children: tuple[int, ...]) -> None:
        """Add memory and processor time of this process and its children."""
        figures.processes = 1 + len(children)
        figures.cpu_s = own_cpu_s(children)
        figures.pss_mib = self.pss_mib(children)
        figures.rss_mib = resident_mib() + sum(map(resident_mib, children))


class ReturnedMemory:
    """Return freed memory to the system after a growth of `GROWN_MIB`, as thousands of declarations of a peer cause."""

    GROWN_MIB, LEAST_MIB = 3.0, 0.5

    def __init__(self) -> None:
        self._least_mib = inf

    def check(self) -> None:
        """Compare the resident size with the least so far; a growth of which nothing can be returned is in use."""
        resident = resident_mib()
        if resident > self._least_mib + self.GROWN_MIB:
            return_memory()
            left = resident_mib()
            if resident - left < self.LEAST_MIB:
                self._least_mib = left
        self._least_mib = min(self._least_mib, resident)


def ram_mib() -> float:
    """Return the total memory of this machine, as the kernel reports it (MiB)."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**20

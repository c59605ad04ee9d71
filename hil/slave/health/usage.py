"""Read the memory and processor time of the slave and its children from /proc, once a second.

psutil would cost the slave's start 13 to 20 ms of processor time and 1.5 MiB (measured with 7.2.2 on a PC; a Raspberry
Pi 4B is several times slower). All else uses it (hil/bench/processes.py).
"""

import os
import time
from math import inf

_PAGE_MIB = os.sysconf("SC_PAGE_SIZE") / 2**20


def pss_mib(pid: int | str = "self") -> float:
    """Proportional set size of a process (MiB): its own pages, and its share of those it shares.

    0 when the process is gone or not ours to look at.
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
    """Resident memory of a process (MiB), with all of what it shares; 0 when the process is gone."""
    try:
        with open(f"/proc/{pid}/statm", "rb") as file:
            return int(file.read().split()[1]) * _PAGE_MIB
    except OSError:
        return 0.0


def cpu_s(pid: int) -> float:
    """Processor time (s, user and system, to one clock tick) that another process has used; 0 when it is gone."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:
            fields = file.read().rpartition(b")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def own_cpu_s(children: tuple[int, ...] = ()) -> float:
    """Processor time (s) of this process with all its threads, and of its children."""
    return time.process_time() + sum(map(cpu_s, children))


def own_pss_mib(children: tuple[int, ...] = ()) -> float:
    """Proportional set size (MiB) of this process and of its children."""
    return pss_mib() + sum(map(pss_mib, children))


class Memory:
    """The proportional set size of this process and its children, for who wants to know it often.

    The kernel walks through all pages to tell it, a millisecond for 20 MiB; how many are resident it knows. So it is
    read again when those have changed by more than `CHANGE_MIB`, and when it is `OLDEST_S` old, as others may have
    come or gone that share some.
    """

    CHANGE_MIB = 0.0625
    OLDEST_S = 10.0

    def __init__(self) -> None:
        self._mib = 0.0
        self._resident_mib = -inf
        self._read_s = 0.0

    def pss_mib(self, children: tuple[int, ...] = ()) -> float:
        """Return what `own_pss_mib` gives, or gave a little while ago."""
        now = time.monotonic()
        resident = resident_mib() + sum(map(resident_mib, children))
        if abs(resident - self._resident_mib) > self.CHANGE_MIB or now - self._read_s >= self.OLDEST_S:
            self._mib, self._resident_mib, self._read_s = own_pss_mib(children), resident, now
        return self._mib


def ram_mib() -> float:
    """Return all memory of this machine, as the kernel sees it (MiB)."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**20

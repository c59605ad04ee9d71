"""Figures of a process's threads, for tests of the benchmarks."""

from hil.bench.processes import Memory, Threads


def threads(cpu_s: dict[str, float], at_s: float, **mib: float) -> Threads:
    """Return figures of threads of the processes 1 and 2."""
    return Threads(cpu_s, {int(pid[1:]): Memory(each, each / 2) for pid, each in mib.items()}, 5, at_s)

"""Figures of processes, for tests of the benchmarks."""

from hil.bench.processes import Memory, Usage


def usage(cpu_s: dict[int, float], at_s: float, **mib: float) -> Usage:
    """Return figures of the processes 1 and 2."""
    return Usage(cpu_s, {int(pid[1:]): Memory(each, each / 2) for pid, each in mib.items()}, 3, 5, at_s)

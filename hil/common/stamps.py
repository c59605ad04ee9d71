"""Convert simulation time to message stamps: time since 1970 by the machine's clock at that instant.

A step of the simulation stands for an instant of the loop's schedule. Steps that are skipped are time that passes
without the simulation, and a clock that is set counts otherwise from then on: either begins a new epoch, which is the
wall time of simulation time 0. What was measured before keeps the epoch it was measured in, however late it arrives.
"""

import time

from hil.common.clock import now_ns

SET_NS = 500_000  # a clock that is off by more has been set: both of a machine's clocks are disciplined alike
_KEPT = 64  # epochs; a sample that is under way for longer than so many does not occur


def wall_offset_ns() -> int:
    """Return what the wall clock (ns since 1970) is ahead of the monotonic one; the nearest two of three readings."""
    readings = []
    for _ in range(3):
        before = now_ns()
        wall = time.time_ns()
        after = now_ns()
        readings.append((after - before, wall - (before + after) // 2))
    return min(readings)[1]


class Stamps:
    """The present epoch, `epoch_ns`, and the earlier ones.

    `offset_ns` is what the wall clock is ahead of the monotonic one by what the epoch was made with; `found_ns` what
    the clock watch has found since, which the loop takes up.
    """

    def __init__(self, epoch_ns: int, offset_ns: int | None = None) -> None:
        self.epoch_ns = epoch_ns
        self.offset_ns = self.found_ns = wall_offset_ns() if offset_ns is None else offset_ns
        self._since_ns = -1  # of simulation time: to what is not later belongs an older one
        self._older: tuple[tuple[int, int], ...] = ()  # since when, and which; the newest first

    def stamp(self, time_ns: int) -> int:
        """Return the wall time (ns since 1970) of simulation time."""
        if time_ns > self._since_ns:
            return time_ns + self.epoch_ns
        held = [epoch_ns for since_ns, epoch_ns in self._older if time_ns > since_ns]
        return time_ns + (held[0] if held else self._older[-1][1])

    def begin(self, time_ns: int, epoch_ns: int) -> None:
        """Use another epoch for what is measured after this simulation time."""
        if time_ns > self._since_ns:  # else nothing was measured in the one that ends
            self._older = ((self._since_ns, self.epoch_ns), *self._older)[:_KEPT]
        self.epoch_ns, self._since_ns = epoch_ns, time_ns

    def monotonic_ns(self, time_ns: int) -> int:
        """Return the instant on the monotonic clock of simulation time in the present epoch."""
        return time_ns + self.epoch_ns - self.offset_ns

    def wall_ns(self, monotonic_ns: int) -> int:
        """Return a monotonic instant by the wall clock, as it goes now."""
        return monotonic_ns + self.found_ns

    def check_clock(self, offset_ns: int) -> int:
        """Take up how the clocks stand to each other; by how much (ns) the wall clock was set meanwhile, or 0."""
        step_ns = offset_ns - self.found_ns
        if abs(step_ns) <= SET_NS:
            return 0
        self.found_ns = offset_ns
        return step_ns

"""Convert simulation time to message stamps: ns since 1970 by the machine's clock at that time.

Each simulation step corresponds to a time in the loop's schedule. A new epoch, the wall time of simulation time 0,
begins when steps were skipped, because time then passed without the simulation, and when the clock was set. Each sample
is stamped with the epoch in which it was measured, however late it arrives.
"""

from hil.common.clock import SET_NS, wall_offset_ns

_STORED = 64  # epochs that are stored; no sample is delayed for longer than these


class Stamps:
    """The present epoch, `epoch_ns`, and the earlier ones.

    `offset_ns` is the wall clock minus the monotonic clock when the epoch was made. `found_ns` is the newest offset
    that `check_clock` has found; the loop begins a new epoch with it.
    """

    def __init__(self, epoch_ns: int, offset_ns: int | None = None) -> None:
        self.epoch_ns = epoch_ns
        self.offset_ns = self.found_ns = wall_offset_ns() if offset_ns is None else offset_ns
        self._since_ns = -1  # simulation time at which the present epoch began; times up to it have an older epoch
        self._older: tuple[tuple[int, int], ...] = ()  # (begin in simulation time, epoch), the newest first

    def stamp(self, time_ns: int) -> int:
        """Return the wall time (ns since 1970) of a simulation time (ns)."""
        if time_ns > self._since_ns:
            return time_ns + self.epoch_ns
        held = [epoch_ns for since_ns, epoch_ns in self._older if time_ns > since_ns]
        return time_ns + (held[0] if held else self._older[-1][1])

    def begin(self, time_ns: int, epoch_ns: int) -> None:
        """Use another epoch for samples measured after this simulation time."""
        if time_ns > self._since_ns:  # else nothing was measured in the present epoch
            self._older = ((self._since_ns, self.epoch_ns), *self._older)[:_STORED]
        self.epoch_ns, self._since_ns = epoch_ns, time_ns

    def monotonic_ns(self, time_ns: int) -> int:
        """Return the monotonic time (ns) of a simulation time in the present epoch."""
        return time_ns + self.epoch_ns - self.offset_ns

    def wall_ns(self, monotonic_ns: int) -> int:
        """Return a monotonic time as wall time (ns since 1970), by the newest offset."""
        return monotonic_ns + self.found_ns

    def check_clock(self, offset_ns: int) -> int:
        """Store a new offset of the clocks; return by how much (ns) the wall clock was set, 0 if it was not."""
        step_ns = offset_ns - self.found_ns
        if abs(step_ns) <= SET_NS:
            return 0
        self.found_ns = offset_ns
        return step_ns

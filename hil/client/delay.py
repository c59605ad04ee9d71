"""Compute command delays from traces: the time of each hop, and the offset between the two machines' clocks."""

from array import array
from typing import NamedTuple

from hil.common.clock import NS_PER_S
from hil.common.quantiles import quantile
from hil.network.clock_offset import ClockOffset, Estimate

HOPS = ("network", "wake-up", "control", "link encode", "wire and STM32")
INSTANTS = 7  # length of a trace
HISTORY = 1 << 8  # windows stored for the clock offset, a second each
LONG_HISTORY = 1 << 16  # for 18 hours of a recording
LONGEST_NS = 60 * NS_PER_S  # from command to trace by one clock; more, or less than 0, means that the clock was set
UNSURE = 0.75  # share of a delay; a larger uncertainty of the clock offset makes it doubtful
MIN_COMMANDS = 1 << 11  # least number of commands stored: 100 s at 20 Hz; full within minutes, and so bounded
WIDTH = 1 + len(HOPS)  # numbers stored for a command


class Sample(NamedTuple):
    """Delays of one command in ns: when it was published, and the time of each of `HOPS`, not yet corrected."""

    published_ns: int
    hops: tuple[int, int, int, int, int]

    @property
    def total_ns(self) -> int:
        """Time (ns) from the master's publish until the STM32 has applied the pulse widths."""
        return sum(self.hops)


class Quantiles(NamedTuple):
    """Quantiles of durations, in milliseconds."""

    p50_ms: float
    p90_ms: float
    p99_ms: float
    max_ms: float


def quantiles(values_ns: list[int]) -> Quantiles:
    """Return nearest-rank quantiles of durations in ns; all nan without values."""
    ordered = sorted(values_ns)
    return Quantiles(*(quantile(ordered, share) / 1e6 for share in (0.5, 0.9, 0.99, 1.0)))


class DelayMeter:
    """Collect traces. Every trace is also a clock exchange: sent, received there, sent back, received here.

    On one machine the offset is 0. Across machines `clock` estimates it from these exchanges and from others added to
    it; each delay is corrected by the offset at its own time. `len` gives the number of all traces so far. The newest
    are stored: at least `min_commands`, or all if that is 0.
    """

    def __init__(self, min_commands: int = MIN_COMMANDS) -> None:
        self.min_commands = min_commands
        self._left_out = 0
        self._rows = array("q")  # 48 bytes a command, where a list of samples has 370
        self.clock = ClockOffset(LONG_HISTORY if min_commands > MIN_COMMANDS else HISTORY)
        self.malformed = 0  # traces that cannot be, or during which a clock was set
        self.same_clock = True

    def add(self, instants: list[int], sent_ns: int, received_ns: int) -> None:
        """Add one trace (see `hil.slave.loop.Trace`), sent and received at these wall times (ns)."""
        if len(instants) != INSTANTS:
            self.malformed += 1
            return
        _, published, received, taken, written, applied, computed = instants
        hops = (received - published, taken - received, computed - taken, written - computed, applied - written)
        if not (0 <= received_ns - published < LONGEST_NS and 0 <= sent_ns - received < LONGEST_NS):
            self.malformed += 1
            return
        try:
            self._rows.extend(array("q", (published, *hops)))
        except OverflowError:  # instants of another program that cannot be times
            self.malformed += 1
            return
        if self.min_commands and len(self._rows) >= 2 * WIDTH * self.min_commands:  # rarely, as it copies
            del self._rows[: WIDTH * self.min_commands]
            self._left_out += self.min_commands
        self.clock.add(published, received, sent_ns, received_ns)

    def store(self, min_commands: int = 0) -> None:
        """Store at least so many commands from now on, or all, for a measurement whose end is known."""
        self.min_commands, self.clock.history = min_commands, LONG_HISTORY

    def __len__(self) -> int:
        return self._left_out + self.stored

    @property
    def stored(self) -> int:
        """Number of commands that are stored, the newest ones."""
        return len(self._rows) // WIDTH

    def clock_at(self, time_ns: int) -> Estimate:
        """Return the slave's clock minus the master's at a wall time (ns) of the master; on one machine exactly 0.

        Even on one machine it is measured if the wall clock was set between the starts of the two processes.
        """
        is_one = self.same_clock and self.clock.may_be_zero(time_ns)
        return (None if is_one else self.clock.at(time_ns)) or Estimate(0, 0, 0.0)

    def offset_ns(self) -> tuple[int, int]:
        """Return the slave's clock minus the master's at the newest command, and its uncertainty (ns)."""
        if not self._rows:
            return 0, 0
        offset, uncertainty, _ = self.clock_at(self._rows[-WIDTH])
        return offset, uncertainty

    def samples(self, newest: int = 0) -> list[Sample]:
        """Return the stored samples, or the `newest` only, oldest first."""
        rows = self._rows[-WIDTH * newest :] if newest else self._rows
        return [
            Sample(rows[at], (rows[at + 1], rows[at + 2], rows[at + 3], rows[at + 4], rows[at + 5]))
            for at in range(0, len(rows), WIDTH)
        ]

    def totals_ns(self, newest: int = 0) -> list[int]:
        """Return the delay (ns) from publish to applied for each command, or for the `newest` only, by one clock."""
        return [sample.total_ns - self.clock_at(sample.published_ns).offset_ns for sample in self.samples(newest)]

    def hop_ns(self, hop: int) -> list[int]:
        """Return the time (ns) of one hop, an index of `HOPS`, for each command."""
        if hop:
            return list(self._rows[1 + hop :: WIDTH])
        return [sample.hops[0] - self.clock_at(sample.published_ns).offset_ns for sample in self.samples()]


def find_doubts(meter: DelayMeter) -> list[str]:
    """Return why the delays of `meter` cannot be trusted; empty if they can.

    An offset that is not known well enough shows as negative delays, as exchanges that contradict it, or as an
    uncertainty nearly as large as the delay.
    """
    if not meter.stored:
        return ["no command was answered by the STM32"]
    doubts = []
    totals, network = meter.totals_ns(), meter.hop_ns(0)
    negative = sum(total < 0 or hop < 0 for total, hop in zip(totals, network, strict=False))  # they may grow
    if negative:
        doubts.append(f"{negative} of {len(totals)} commands arrived before they were sent: a clock is wrong")
    middle_ns = quantile(sorted(totals), 0.5)
    return doubts + doubts_of(meter.clock, meter.same_clock, meter.samples(1)[-1].published_ns, middle_ns)


def doubts_of(clock: ClockOffset, same_clock: bool, at_ns: int, middle_ns: float) -> list[str]:
    """Return why durations between another process's clock and ours cannot be trusted; empty if they can.

    at_ns: wall time of the measurement by our clock; middle_ns: median of the durations.
    """
    doubts, estimate = [], clock.at(at_ns)
    if estimate:
        off, uncertainty = estimate.offset_ns / 1e6, estimate.uncertainty_ns / 1e6
        is_one = same_clock and clock.may_be_zero(at_ns)
        if not is_one and estimate.uncertainty_ns > UNSURE * abs(middle_ns):
            doubts.append(f"the clocks' offset of {off:.3f} ms is known only to +-{uncertainty:.3f} ms")
    if clock.steps:
        doubts.append(f"a clock was set {clock.steps} times meanwhile")
    return doubts

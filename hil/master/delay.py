"""Command delay from traces: each hop's share, and the offset between the two machines' clocks."""

from typing import NamedTuple

HOPS = ("network", "wake-up", "control", "link and STM32")


class Sample(NamedTuple):
    """One command's way, all in nanoseconds: four hops by one clock or corrected to one, and the round trip."""

    hops: tuple[int, int, int, int]
    offset_ns: int  # slave's clock minus master's, by this exchange
    round_trip_ns: int

    @property
    def total_ns(self) -> int:
        """From the master's publish until the STM32 had applied the pulse widths."""
        return sum(self.hops)


class Quantiles(NamedTuple):
    """Of a list of durations, in milliseconds."""

    p50_ms: float
    p90_ms: float
    p99_ms: float
    max_ms: float


def quantiles(values_ns: list[int]) -> Quantiles:
    """Nearest-rank quantiles of durations in ns; all nan when there are none."""
    if not values_ns:
        nan = float("nan")
        return Quantiles(nan, nan, nan, nan)
    ordered = sorted(values_ns)
    p50, p90, p99 = (ordered[min(int(share * len(ordered)), len(ordered) - 1)] / 1e6 for share in (0.5, 0.9, 0.99))
    return Quantiles(p50, p90, p99, ordered[-1] / 1e6)


class DelayMeter:
    """Collects traces. Every trace is also a clock exchange: sent, received there, sent back, received here.

    On one machine the two clocks are one and the offset is 0. Across machines it is that of the exchange
    with the shortest round trip (the filter of NTP, RFC 5905 section 10), known to half of that round trip.
    """

    def __init__(self) -> None:
        self._samples: list[Sample] = []
        self.malformed = 0
        self.same_clock = True

    def add(self, instants: list[int], sent_ns: int, received_ns: int) -> None:
        """Take in one trace (see `hil.slave.loop.Trace`), sent and received at these wall instants (ns)."""
        if len(instants) != 6:
            self.malformed += 1
            return
        _, published, received, taken, written, applied = instants
        hops = (received - published, taken - received, written - taken, applied - written)
        offset = ((received - published) + (sent_ns - received_ns)) // 2
        round_trip = (received_ns - published) - (sent_ns - received)
        self._samples.append(Sample(hops, offset, round_trip))

    def __len__(self) -> int:
        return len(self._samples)

    def offset_ns(self) -> tuple[int, int]:
        """The slave's clock minus the master's, and how far that may be wrong (ns)."""
        if self.same_clock or not self._samples:
            return 0, 0
        best = min(self._samples, key=lambda sample: sample.round_trip_ns)
        return best.offset_ns, best.round_trip_ns // 2

    def totals_ns(self, newest: int = 0) -> list[int]:
        """Publish to applied, one a command, by one clock; of the `newest` commands only (0: of all)."""
        offset, _ = self.offset_ns()
        return [sample.total_ns - offset for sample in self._samples[-newest:]]

    def hop_ns(self, hop: int) -> list[int]:
        """One hop of `HOPS`, one value a command."""
        offset = self.offset_ns()[0] if hop == 0 else 0
        return [sample.hops[hop] - offset for sample in self._samples]

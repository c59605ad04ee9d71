"""Estimate the offset between two clocks, and its drift, from timed message exchanges.

Each exchange bounds the offset: it differs from the midpoint estimate by at most half the round trip (NTP, RFC 5905,
section 8). The only assumption is that no message arrives before it was sent. Of each window the exchange with the
shortest round trip is stored, as queues delay it least (the clock filter, section 10). Two such exchanges some seconds
apart bound the drift in the same way. An exchange that contradicts the bound means that a clock was set or stood still;
then all earlier exchanges are discarded.
"""

import threading
from bisect import bisect_right
from typing import NamedTuple

from hil.common.clock import NS_PER_S

WINDOW_NS = NS_PER_S
NEAREST = 16  # stored exchanges that are considered for one time
MAX_DRIFT = 100e-6  # two crystals of 50 ppm each
WANDER = 1e-6  # change of the drift itself with temperature, over the stored history
MIN_SPAN_NS = 8 * NS_PER_S  # between the two exchanges that give the drift
TURNAROUND_NS = 10 * NS_PER_S  # an answer that took longer is rejected


class Estimate(NamedTuple):
    """Offset of the other clock from ours (ns), its uncertainty (ns), and its drift (ns per ns)."""

    offset_ns: int
    uncertainty_ns: int
    drift: float


class _Point(NamedTuple):
    time_ns: int  # our clock, at the midpoint of the exchange
    offset_ns: int
    half_ns: int  # half the round trip


class ClockOffset:
    """Estimate the other clock minus ours. Times are integer ns, each by the clock that measured it.

    `history` is the number of windows (seconds) that are stored. `malformed` counts impossible exchanges, `steps` how
    often a clock was set. Thread-safe.
    """

    def __init__(self, history: int = 64) -> None:
        self.history = history
        self._lock = threading.Lock()
        self._points: list[_Point] = []
        self._best: _Point | None = None  # the best of `_points` for all times after the last
        self._window_ns = 0
        self._drift = 0.0
        self._drift_error = MAX_DRIFT
        self.exchanges = 0
        self.malformed = 0
        self.steps = 0

    def add(self, sent_ns: int, there_ns: int, answered_ns: int, received_ns: int) -> None:
        """Add one exchange: sent (our clock), arrived and answered (the other's), answer received (ours)."""
        round_trip = (received_ns - sent_ns) - (answered_ns - there_ns)
        if round_trip < 0 or not 0 <= answered_ns - there_ns <= TURNAROUND_NS:
            self.malformed += 1
            return
        offset = ((there_ns - sent_ns) + (answered_ns - received_ns)) // 2
        point = _Point((sent_ns + received_ns) // 2, offset, (round_trip + 1) // 2)
        with self._lock:
            self.exchanges += 1
            was_set_back = self._points and point.time_ns < self._points[0].time_ns - TURNAROUND_NS
            if was_set_back or self._contradicts(point):
                self.steps += 1
                self._points, self._drift, self._drift_error = [], 0.0, MAX_DRIFT
            self._add_point(point)
            self._best = self._best_of(self._points, self._points[-1].time_ns)

    def forget(self) -> None:
        """Discard all exchanges, because the other process was replaced."""
        with self._lock:
            self._points, self._best, self._drift, self._drift_error = [], None, 0.0, MAX_DRIFT

    def at(self, time_ns: int) -> Estimate | None:
        """Return the offset at a time (ns) of our clock; None before the first exchange."""
        best, points = self._best, self._points
        if best is None:
            return None
        if points and time_ns < points[-1].time_ns:
            best = self._best_of(points, time_ns)
        passed = time_ns - best.time_ns
        uncertainty = best.half_ns + round(self._drift_error * abs(passed))
        return Estimate(best.offset_ns + round(self._drift * passed), uncertainty, self._drift)

    def may_be_zero(self, time_ns: int) -> bool:
        """Return whether the offset at a time (ns) of our clock may be zero, by all exchanges so far.

        Two processes on one machine have the same clock, unless the wall clock was set between their starts.
        """
        estimate = self.at(time_ns)
        return estimate is None or abs(estimate.offset_ns) <= estimate.uncertainty_ns

    def _best_of(self, points: list[_Point], time_ns: int) -> _Point:
        """Return the exchange with the least uncertainty at a time. After the last exchange it stays the same."""
        later = bisect_right(points, time_ns, key=lambda point: point.time_ns)
        last = min(later + NEAREST // 2, len(points))
        rate = self._drift_error
        near = points[max(last - NEAREST, 0) : last]
        return min(near, key=lambda point: point.half_ns + rate * abs(time_ns - point.time_ns))

    def _contradicts(self, point: _Point) -> bool:
        estimate = self.at(point.time_ns)
        return estimate is not None and (
            abs(point.offset_ns - estimate.offset_ns) > estimate.uncertainty_ns + point.half_ns
        )

    def _add_point(self, point: _Point) -> None:
        points = self._points
        if points and 0 <= point.time_ns - self._window_ns < WINDOW_NS:
            if point.half_ns < points[-1].half_ns:
                points[-1] = point
            return
        if points and point.time_ns < self._window_ns:
            return  # older than the present window: the exchange was overtaken
        self._window_ns = point.time_ns
        points.append(point)
        if len(points) > self.history:
            del points[0]
        self._find_drift()

    def _find_drift(self) -> None:
        """Estimate the drift from the best exchange of the older third to the best of the newer third."""
        third = len(self._points) // 3
        if not third:
            return
        first = min(self._points[:third], key=lambda point: point.half_ns)
        last = min(self._points[-third:], key=lambda point: point.half_ns)
        span = last.time_ns - first.time_ns
        if span < MIN_SPAN_NS:
            return
        error = (first.half_ns + last.half_ns) / span + WANDER
        if error < MAX_DRIFT:
            self._drift = max(-MAX_DRIFT, min((last.offset_ns - first.offset_ns) / span, MAX_DRIFT))
            self._drift_error = error

"""Choose when the live view draws: soon after a sample with a position, and otherwise at a lower rate.

If the view drew by a clock of its own, 20 times a second like the samples, it would show each sample up to one period
late, by the constant offset of the two clocks.
"""

from hil.common.clock import NS_PER_MS

GATHER_NS = 3 * NS_PER_MS  # wait after a sample, because the samples of one instant come one after the other
MIN_NS = 40 * NS_PER_MS  # shortest time between two drawings, however many vehicles send
MAX_NS = 75 * NS_PER_MS  # longest time; more than the period of the samples, so that the samples trigger the drawing


class Pace:
    """Schedule of the drawing; the next is at `due_ns`. All times are monotonic, in ns."""

    def __init__(self, now: int) -> None:
        self._drawn_ns = now
        self.due_ns = now

    def on_sample(self, now: int) -> None:
        """Schedule a drawing soon after a sample that was received at `now`."""
        self.due_ns = min(self.due_ns, max(now + GATHER_NS, self._drawn_ns + MIN_NS))

    def draws(self, now: int) -> bool:
        """Return whether to draw at `now`; if true, schedule the next drawing."""
        if now < self.due_ns:
            return False
        self._drawn_ns, self.due_ns = now, now + MAX_NS
        return True

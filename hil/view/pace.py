"""Choose when the live view draws: soon after a sample of a place, and every now and then without one.

With a clock of its own, 20 times a second as the samples, the view would show each of them up to a period late: always
as late as the two clocks happened to begin.
"""

from hil.common.clock import NS_PER_MS

GATHER_NS = 3 * NS_PER_MS  # after a sample, as those of one instant come one after the other
LEAST_NS = 40 * NS_PER_MS  # between two drawings, however many vehicles send
MOST_NS = 75 * NS_PER_MS  # more than the period of the samples, so that they set the beat


class Pace:
    """The next drawing at `due_ns`. All times are monotonic, in ns."""

    def __init__(self, now: int) -> None:
        self._drawn_ns = now
        self.due_ns = now

    def on_sample(self, now: int) -> None:
        """Draw soon, as a sample has come at `now`."""
        self.due_ns = min(self.due_ns, max(now + GATHER_NS, self._drawn_ns + LEAST_NS))

    def draws(self, now: int) -> bool:
        """Return whether to draw at `now`, and count it as drawn."""
        if now < self.due_ns:
            return False
        self._drawn_ns, self.due_ns = now, now + MOST_NS
        return True

"""Detect that a vehicle answers pings but sends no samples, or that none comes at all.

A session has two links, one for commands and answers, one for samples: either may carry nothing while the other does.
The cause that is known, `hil.network.unread_links` finds by itself; this is for any other.
"""

from collections.abc import Callable

from hil.common.clock import NS_PER_S, now_ns
from hil.network.session import Session
from hil.network.unread_links import CHECK_NS, UnreadLinks

LONGEST_CHECK_NS = NS_PER_S // 2  # that counts between two looks: longer ones are pauses of this process
FIRST_GAP_NS = NS_PER_S  # between two messages of a vehicle: at the least its figures of health come that often
GAPS = 3  # of the longest that was usual, on top of the leases
FORGOTTEN = 0.9  # is what remains of the longest gap at each look at which messages had come
LEASES = 2
CHECK_S = 0.25  # between two looks whether anybody has come
LONGEST_PAUSE_NS = 60 * NS_PER_S  # between two attempts to mend it


class StallDetector:
    """Compare counts of answers and samples several times a second, at times (monotonic ns) that the caller gives.

    A stall is that answers came, or there was a link, and no sample for two leases (of `lease` s) and three gaps: the
    longest usual one between samples, or without answers, which take longer to come back, 1 s. `attempts` counts how
    often it was told since the last sample; each takes twice as long as the one before. `lasted_s` is how long (s) no
    sample has come since the last was told.
    """

    def __init__(self, lease: float) -> None:
        self._least_ns = round(LEASES * lease * NS_PER_S)
        self._updated_ns = 0
        self._answers = self._samples = 0
        self._silent_ns = 0  # in which there were answers
        self._gap_ns = FIRST_GAP_NS
        self.attempts = 0
        self.lasted_s = 0.0

    def is_stalled(self, now: int, answers: int, samples: int, is_deaf: bool = False) -> bool:
        """Return whether it is time to connect again; `answers` and `samples` are how many have come so far.

        `is_deaf`: there is a link to the vehicle, and not even answers come.
        """
        passed_ns = min(now - self._updated_ns, LONGEST_CHECK_NS) if self._updated_ns else 0
        self._updated_ns = now
        if samples != self._samples:
            usual_ns = max(self._silent_ns, round(FORGOTTEN * self._gap_ns))
            self._gap_ns = min(usual_ns, FIRST_GAP_NS)
            self._silent_ns = self.attempts = 0
        elif answers != self._answers or is_deaf:
            self._silent_ns += passed_ns
        self._answers, self._samples = answers, samples
        gap_ns = FIRST_GAP_NS if is_deaf else self._gap_ns
        patience_ns = min((self._least_ns + GAPS * gap_ns) << min(self.attempts, 10), LONGEST_PAUSE_NS)
        if self._silent_ns < patience_ns:
            return False
        self.lasted_s = self._silent_ns / NS_PER_S
        self._silent_ns = 0
        self.attempts += 1
        return True

    def restart(self) -> None:
        """Count the silence from now on: another client of the session has opened it again."""
        self._silent_ns = 0
        self.attempts += 1


def is_linked(session: Session) -> bool:
    """Return whether each peer that we dial has a link, as a lost one has not."""
    return len({peer for peer, *_ in session.links()}) >= max(1, session.dialled)


def mend_links(session: Session, lease: float) -> None:
    """Cut links that the library does not read, so that they are opened again, until it is closed; `lease` in s."""
    unread = UnreadLinks(lease, session.has_pairs)

    def mend() -> None:
        session.has_cut |= unread.mend(session)

    session.every(CHECK_NS / NS_PER_S, mend, "links")


def mend_while_nobody(session: Session, is_anybody: Callable[[], bool], lease: float) -> None:
    """Let a session meet its first vehicle, from a thread of its own until it is closed; `lease` in s.

    What zenoh sends first on a link gets lost now and then on a busy machine, and with it all that we declared: while
    there are links and nobody is there, the session is opened again. A vehicle that is there is watched by
    `hil.client.liveness`.
    """
    stall, met = StallDetector(lease), 0

    def mend() -> None:
        nonlocal met
        openings = session.openings
        is_deaf = not is_anybody() and is_linked(session)
        met += not is_deaf
        if session.is_lost or stall.is_stalled(now_ns(), 0, met, is_deaf):
            session.reopen(openings)

    session.every(CHECK_S, mend, "first contact")

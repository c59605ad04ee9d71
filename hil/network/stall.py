"""Detect that a vehicle answers pings but sends no samples, or that nothing arrives over its link.

A session has two links, one for commands and answers and one for samples; either may fail alone. The one known cause is
found by `hil.network.unread_links`; this module detects any other.
"""

from collections.abc import Callable

from hil.common.clock import NS_PER_S, now_ns
from hil.network.session import Session
from hil.network.unread_links import CHECK_NS, UnreadLinks

LONGEST_CHECK_NS = NS_PER_S // 2  # limit of the time counted between two checks; the rest was a pause of this process
FIRST_GAP_NS = NS_PER_S  # longest usual time between two messages of a vehicle: the period of its diagnostics
GAPS = 3  # gaps without a sample, in addition to the leases
FORGOTTEN = 0.9  # decay factor of the longest gap at each check with new samples
LEASES = 2
CHECK_S = 0.25  # between two checks for the first vehicle
LONGEST_PAUSE_NS = 60 * NS_PER_S  # between two attempts to reopen the session


class StallDetector:
    """Detect a stall from counts of answers and samples, checked some times a second at the caller's monotonic times.

    A stall means: answers arrived, or there was a link, but no sample for two leases (of `lease` s) and three gaps. The
    gap is the longest usual one between samples, or 1 s without answers, which take longer to come back. `attempts`
    counts the stalls detected since the last sample; the time limit doubles with each. `lasted_s` is how long (s) no
    sample had arrived at the last detection.
    """

    def __init__(self, lease: float) -> None:
        self._least_ns = round(LEASES * lease * NS_PER_S)
        self._updated_ns = 0
        self._replies = self._samples = 0
        self._silent_ns = 0  # time with answers, or a link, but without samples
        self._gap_ns = FIRST_GAP_NS
        self.attempts = 0
        self.lasted_s = 0.0

    def is_stalled(self, now: int, replies: int, samples: int, is_unanswered: bool = False) -> bool:
        """Return whether to connect again; `replies` and `samples` are the numbers received so far.

        `is_unanswered`: there is a link to the vehicle, but not even answers arrive.
        """
        passed_ns = min(now - self._updated_ns, LONGEST_CHECK_NS) if self._updated_ns else 0
        self._updated_ns = now
        if samples != self._samples:
            usual_ns = max(self._silent_ns, round(FORGOTTEN * self._gap_ns))
            self._gap_ns = min(usual_ns, FIRST_GAP_NS)
            self._silent_ns = self.attempts = 0
        elif replies != self._replies or is_unanswered:
            self._silent_ns += passed_ns
        self._replies, self._samples = replies, samples
        gap_ns = FIRST_GAP_NS if is_unanswered else self._gap_ns
        patience_ns = min((self._least_ns + GAPS * gap_ns) << min(self.attempts, 10), LONGEST_PAUSE_NS)
        if self._silent_ns < patience_ns:
            return False
        self.lasted_s = self._silent_ns / NS_PER_S
        self._silent_ns = 0
        self.attempts += 1
        return True

    def restart(self) -> None:
        """Restart the measurement, because another client of the session has reopened it."""
        self._silent_ns = 0
        self.attempts += 1


def is_linked(session: Session) -> bool:
    """Return whether there is a link to each peer that we connect to."""
    return len({peer for peer, *_ in session.links()}) >= max(1, session.peer_count)


def close_unread_links(session: Session, lease: float) -> None:
    """Close links that the library does not read, to have them reopened, until the session closes; `lease` in s."""
    unread = UnreadLinks(lease, session.has_pairs)

    def check() -> None:
        session.has_cut |= unread.close_faulty(session)

    session.every(CHECK_NS / NS_PER_S, check, "links")


def reopen_while_no_vehicle(session: Session, is_any_present: Callable[[], bool], lease: float) -> None:
    """Reopen a session that finds no vehicle, from a separate thread until it is closed; `lease` in s.

    On a busy machine zenoh sometimes loses the first messages on a link, and with them all our declarations. So while
    there are links but no vehicle is present, the session is reopened. Once a vehicle is present,
    `hil.client.liveness` monitors it.
    """
    stall, checks_with_vehicle = StallDetector(lease), 0

    def check() -> None:
        nonlocal checks_with_vehicle
        openings = session.openings
        is_unanswered = not is_any_present() and is_linked(session)
        checks_with_vehicle += not is_unanswered
        if session.is_lost or stall.is_stalled(now_ns(), 0, checks_with_vehicle, is_unanswered):
            session.reopen(openings)

    session.every(CHECK_S, check, "first contact")

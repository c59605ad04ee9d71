"""Supervise a session: close faulty links, and open the session again if what should arrive does not.

A session has two links, one for commands and answers and one for samples; either may fail alone. The known causes are
in `hil.network.workarounds`. On a busy machine the library also loses the first messages on a link, and with them all
our declarations; and one client in 5,000 had both links again after a pause, and the library still delivered nothing.
"""

from collections.abc import Callable
from itertools import count
from typing import NamedTuple, Protocol

from hil.common.clock import NS_PER_S, now_ns
from hil.network.sockets import cut, pair_of
from hil.network.workarounds.half_session import IS_HALF, HalfSessions
from hil.network.workarounds.unread_link import UnreadLinks, read_progress

CHECK_S = 0.5  # between two checks
LINKS_NS = NS_PER_S // 2  # between two checks of the links
LONGEST_LINKS_NS = NS_PER_S  # limit of the time counted between two of them; in the rest this process was held up
LONGEST_CHECK_NS = NS_PER_S // 2  # the same for arrivals
FIRST_GAP_NS = NS_PER_S  # longest usual time between two messages of a vehicle: the period of its diagnostics
GAPS = 3  # gaps without a sample, in addition to the leases
FORGOTTEN = 0.9  # decay factor of the longest gap at each check with new samples
LEASES = 2
LONGEST_PAUSE_NS = 60 * NS_PER_S  # between two attempts to reopen the session


class Received(NamedTuple):
    """Numbers of replies and samples received so far. `is_unanswered`: there is a link, but not even replies arrive."""

    replies: int
    samples: int
    is_unanswered: bool = False


class Supervised(Protocol):
    """The part of a session that a supervisor needs, see `hil.network.session.Session`."""

    name: str
    peer_count: int

    @property
    def is_lost(self) -> bool:
        """True while the session is lost and could not be reopened."""

    def links(self) -> list[tuple[str, str, str]]:
        """Return for each link the peer's zenoh id, our address and the peer's address."""

    def reopen(self) -> bool:
        """Replace the library's session by a new one; return whether this was done."""


class Watched:
    """A sender called `name` whose messages must not stop; see `Supervisor.watch` for the functions.

    They have stopped if answers arrived, or there was a link, but no sample for two leases (of `lease` s) and three
    gaps. The gap is the longest usual one between samples, or 1 s without answers, which take longer to come back.
    `attempts` counts the stalls detected since the last sample; the time limit doubles with each. `lasted_s` is how
    long (s) no sample had arrived at the last detection.
    """

    def __init__(
        self,
        name: str,
        lease: float,
        arrivals: Callable[[], Received],
        report: Callable[[str], None] = lambda _: None,
        may_run: Callable[[], bool] = lambda: True,
    ) -> None:
        self.name, self.report, self.may_run, self._arrivals = name, report, may_run, arrivals
        self._least_ns = round(LEASES * lease * NS_PER_S)
        self._updated_ns = 0
        self._newest = Received(0, 0)
        self._silent_ns = 0  # time with answers, or a link, but without samples
        self._gap_ns = FIRST_GAP_NS
        self.attempts = 0
        self.lasted_s = 0.0

    def is_stalled(self, now: int) -> bool:
        """Return whether to connect again; to be called some times a second (`now`: monotonic ns)."""
        passed_ns = min(now - self._updated_ns, LONGEST_CHECK_NS) if self._updated_ns else 0
        before, self._newest, self._updated_ns = self._newest, self._arrivals(), now
        replies, samples, is_unanswered = self._newest
        if samples != before.samples:
            usual_ns = max(self._silent_ns, round(FORGOTTEN * self._gap_ns))
            self._gap_ns = min(usual_ns, FIRST_GAP_NS)
            self._silent_ns = self.attempts = 0
        elif replies != before.replies or is_unanswered:
            self._silent_ns += passed_ns
        gap_ns = FIRST_GAP_NS if is_unanswered else self._gap_ns
        patience_ns = min((self._least_ns + GAPS * gap_ns) << min(self.attempts, 10), LONGEST_PAUSE_NS)
        if self._silent_ns < patience_ns:
            return False
        self.lasted_s = self._silent_ns / NS_PER_S
        self.restart()
        return True

    def restart(self) -> None:
        """Restart the measurement, because the session was opened again."""
        self._silent_ns = 0
        self.attempts += 1

    @property
    def stall(self) -> str:
        """The last detected stall, as a text."""
        does = "had a link, but no answer came" if self._newest.is_unanswered else "answered, but nothing else came"
        return f"{does} of it for {self.lasted_s:.1f} s"


class Supervisor:
    """Supervise `session`, whose links have a `lease` (s); `has_pairs` as in `HalfSessions`.

    `watched` is what must arrive; `checks` are further functions, called with the time (monotonic ns) at each check.
    """

    def __init__(self, session: Supervised, lease: float, has_pairs: bool = False) -> None:
        self._session, self._lease = session, lease
        self._unread, self._halves = UnreadLinks(lease), HalfSessions(lease, has_pairs)
        self._links_ns = 0  # when the links were checked; monotonic
        self.watched: list[Watched] = []
        self.checks: list[Callable[[int], None]] = []

    def watch(
        self, name: str, arrivals: Callable[[], Received], report: Callable[[str], None], may_run: Callable[[], bool]
    ) -> Callable[[], None]:
        """Open the session again if messages of `name` stop; return a function that ends this.

        `report` gets a line when that was done, or when links were closed. `may_run` returns whether the sender may
        still run; if it has ended, the session is not at fault.
        """
        watched = Watched(name, self._lease, arrivals, report, may_run)
        self.watched.append(watched)
        return lambda: self.watched.remove(watched)

    def watch_presence(self, is_any_present: Callable[[], bool]) -> None:
        """Open the session again while it has links and no vehicle is present."""
        seen, times = 0, count(1)

        def arrivals() -> Received:
            nonlocal seen
            is_unanswered = not is_any_present() and self.is_linked()
            seen = seen if is_unanswered else next(times)
            return Received(0, seen, is_unanswered)

        self.watched.append(Watched("any vehicle", self._lease, arrivals))

    def is_linked(self) -> bool:
        """Return whether there is a link to each peer that the session connects to."""
        return len({peer for peer, *_ in self._session.links()}) >= max(1, self._session.peer_count)

    def check(self) -> None:
        """Check links and arrivals now; takes long if the session has to be opened and its router is missing."""
        session = self._session
        if session.is_lost:
            session.reopen()
            return
        for check in self.checks:
            check(now_ns())
        if self.close_faulty_links():
            for watched in tuple(self.watched):
                watched.report(f"a link of {session.name} was open and not read, or lost; connecting again")
        stalled = [watched for watched in tuple(self.watched) if watched.is_stalled(now_ns())]
        for watched in stalled:
            if watched.may_run() and session.reopen():
                watched.report(f"{watched.name} at {session.name} {watched.stall}; the session was opened again")
                for other in self.watched:
                    if other not in stalled:
                        other.restart()
                return

    def close_faulty_links(self) -> bool:
        """Close the links to each peer with an unread or missing link; return whether there was one.

        The peer then connects again, or we do.
        """
        now = now_ns()
        if now - self._links_ns < LINKS_NS:
            return False
        passed_ns, self._links_ns = min(now - self._links_ns, LONGEST_LINKS_NS), now
        connections = self._session.links()
        links = [(peer, pair_of(ours, theirs)) for peer, ours, theirs in connections]
        unread = self._unread.find(passed_ns, read_progress({pair for _, pair in links}))
        peers = self._halves.find(passed_ns, [peer for peer, _, theirs in connections if IS_HALF in theirs])
        peers |= {peer for peer, pair in links if pair in unread}
        cut({pair for peer, pair in links if peer in peers})
        return bool(peers)

"""Maintain the links of a router: reconnect slaves that stayed unknown, and limit send buffers.

To zenoh a slave is a router too. zenoh 1.10.2 drops the declarations of another router that arrive before its
announcement, which happens on a busy machine with many vehicles: of 40 slaves one or two had a link and stayed unknown.
Over a new link they declare everything again.

A new slave is sent all declarations at once, and everybody waits while its send buffer is full: 20 slaves that started
together on a busy machine blocked a router for good. So a new link has a large send buffer. Later it is made small,
because commands wait behind what it holds.
"""

from collections.abc import Callable

from hil.common.clock import NS_PER_S
from hil.network.session import Session
from hil.network.sockets import cut, limit_send_buffers
from hil.network.tokens import router_key
from hil.network.unread_links import Pair, port_of

SETTLED_NS = 3 * NS_PER_S  # after this time a slave is known and has received all declarations
ATTEMPTS = 5  # each after twice the time; a router of other software never becomes known
MAX_PEERS = 1024  # whose attempts are counted; the oldest is removed, as it may never connect again


class RouterLinks:
    """The links of a router's `session`; `report` gets a line for each link that is closed."""

    def __init__(self, session: Session, report: Callable[[str], None]) -> None:
        self._session, self._report = session, report
        self._since: dict[Pair, int] = {}  # link -> when (monotonic ns) it was first seen
        self._settled: set[Pair] = set()
        self._known: set[Pair] = set()
        self._attempts: dict[str, int] = {}  # unknown peer -> number of its links that were closed

    def check(self, now: int) -> None:
        """Check the links at `now` (monotonic ns); to be called a few times a second."""
        links = {(port_of(ours), port_of(theirs)): peer for peer, ours, theirs in self._session.links()}
        self._since = {pair: self._since.get(pair, now) for pair in links}
        settled = {pair for pair, since in self._since.items() if now - since >= SETTLED_NS}
        limit_send_buffers(settled - self._settled)
        self._settled, self._known = settled, self._known & links.keys()
        routers = self._session.routers()
        for pair in settled - self._known:
            peer, patience_ns = links[pair], SETTLED_NS << self._attempts.get(links[pair], 0)
            if peer not in routers or self._session.tokens(router_key(peer)):
                self._known.add(pair)
                self._attempts.pop(peer, None)
            elif now - self._since[pair] >= patience_ns and self._attempts.get(peer, 0) < ATTEMPTS:
                self._attempts[peer] = self._attempts.get(peer, 0) + 1
                while len(self._attempts) > MAX_PEERS:
                    del self._attempts[next(iter(self._attempts))]
                self._report(
                    f"nothing is known of the peer at port {pair[1]}; cutting the link, so that it connects again"
                )
                cut({pair})

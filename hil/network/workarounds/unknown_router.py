"""Symptom: a slave has a link to a router and stays unknown to everybody behind it.

To the library a slave is a router too. It drops the declarations of another router that arrive before its announcement,
which happens on a busy machine with many vehicles: of 40 slaves one or two had a link and stayed unknown. Over a new
link they declare everything again.

Not reported: no script shows it at will. Remove when 40 slaves at a router are known without it
(docs/explanation/scale.md).
"""

from collections.abc import Callable

from hil.common.clock import NS_PER_S
from hil.network.session import Session
from hil.network.sockets import Pair, cut, pair_of
from hil.network.tokens import router_key

SETTLED_NS = 3 * NS_PER_S  # after this time a slave is known
ATTEMPTS = 5  # each after twice the time; a router of other software never becomes known
MAX_PEERS = 1024  # whose attempts are counted; the oldest is removed, as it may never connect again


class UnknownRouters:
    """Cut links to slaves that stayed unknown; `report` gets a line for each."""

    def __init__(self, session: Session, report: Callable[[str], None]) -> None:
        self._session, self._report = session, report
        self._since: dict[Pair, int] = {}  # link -> when (monotonic ns) it was first seen
        self._known: set[Pair] = set()
        self._attempts: dict[str, int] = {}  # unknown peer -> number of its links that were closed

    def check(self, now: int) -> None:
        """Check the links at `now` (monotonic ns); to be called a few times a second."""
        links = {pair_of(ours, theirs): peer for peer, ours, theirs in self._session.links()}
        self._since = {pair: self._since.get(pair, now) for pair in links}
        self._known &= links.keys()
        routers = self._session.routers()
        for pair in links.keys() - self._known:
            peer, waited_ns = links[pair], now - self._since[pair]
            if waited_ns < SETTLED_NS:
                continue
            if peer not in routers or self._session.tokens(router_key(peer)):
                self._known.add(pair)
                self._attempts.pop(peer, None)
            elif waited_ns >= SETTLED_NS << self._attempts.get(peer, 0) and self._attempts.get(peer, 0) < ATTEMPTS:
                self._attempts[peer] = self._attempts.get(peer, 0) + 1
                while len(self._attempts) > MAX_PEERS:
                    del self._attempts[next(iter(self._attempts))]
                self._report(
                    f"nothing is known of the peer at port {pair[1]}; cutting the link, so that it connects again"
                )
                cut({pair})

"""Symptom: many slaves that start together block a router for good.

A new slave is sent all declarations at once, and in the library everybody waits while its send buffer is full: 20
slaves that started together on a busy machine. So a new link of a router has a large send buffer
(`hil.network.settings.NEW_SEND_BUFFER`). Later it is made small, because commands wait behind what it holds.

Not reported: no script shows it at will. Remove when 40 slaves at a router are known without it
(docs/explanation/scale.md).
"""

from collections.abc import Callable
from socket import SO_SNDBUF, SOL_SOCKET

from hil.common.clock import NS_PER_S
from hil.network.settings import SEND_BUFFER
from hil.network.sockets import Pair, network_sockets, pair_of

SETTLED_NS = 3 * NS_PER_S  # after this time a slave has received all declarations


class NewLinks:
    """The links of a session, as `links` returns them, which get the usual send buffer when they are settled."""

    def __init__(self, links: Callable[[], list[tuple[str, str, str]]]) -> None:
        self._links = links
        self._since: dict[Pair, int] = {}  # link -> when (monotonic ns) it was first seen
        self._settled: set[Pair] = set()

    def check(self, now: int) -> None:
        """Check the links at `now` (monotonic ns); to be called a few times a second."""
        pairs = {pair_of(ours, theirs) for _, ours, theirs in self._links()}
        self._since = {pair: self._since.get(pair, now) for pair in pairs}
        settled = {pair for pair, since in self._since.items() if now - since >= SETTLED_NS}
        if new := settled - self._settled:
            for pair, end in network_sockets():
                if pair in new:
                    end.setsockopt(SOL_SOCKET, SO_SNDBUF, SEND_BUFFER)
        self._settled = settled

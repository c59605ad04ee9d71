"""Find links that zenoh keeps open without reading them, and sessions that lost one of their two links.

zenoh 1.10.2 opens a link in three steps: it starts the writing task, notifies its listeners, and starts the reading
task. If its timeout for opening a link ends in between, as can happen after a process was paused, the third step never
comes. Keep-alives still go out, so the other end keeps the link, but nothing is ever read. A link that works gets
keep-alives several times a lease, or the library closes it. The kernel knows how many bytes were received and how many
still wait to be read. Also, of two links to a peer the library reopens a lost one only when both are lost.
"""

import sys
from collections import Counter
from collections.abc import Collection, Mapping
from contextlib import suppress
from struct import unpack_from
from typing import Protocol

from hil.common.clock import NS_PER_S, now_ns
from hil.network.sockets import cut, network_sockets

LEASES = 2
_IS_HALF = "?prio="  # in the address of a link for some priorities; a second link serves the rest
CHECK_NS = NS_PER_S // 2
LONGEST_CHECK_NS = NS_PER_S  # limit of the time counted between two checks; in the rest this process was held up
LONGEST_PATIENCE_NS = 60 * NS_PER_S  # time limit for a peer with one link of two
_TCP, _TCP_INFO, _TCP_INFO_SIZE, _BYTES_RECEIVED = 6, 11, 136, 128  # linux/tcp.h

Pair = tuple[int, int]  # the ports of a link, ours and theirs


class HasLinks(Protocol):
    """A session, of the library or ours."""

    def links(self) -> list[tuple[str, str, str]]:
        """Return for each link the peer's zenoh id, our address and the peer's address."""


class UnreadLinks:
    """Detect links that are not read; `lease` in s.

    A busy machine must not lose working links. So only time in which this process ran counts, and only links with
    waiting bytes are checked. `has_pairs`: each peer must have two links, as a slave that a master connects to; without
    it, only a peer that once had two. The time limit for a single link doubles with each such link that is closed: the
    second port may be unreachable for good, or links may open slowly.
    """

    def __init__(self, lease: float, has_pairs: bool = False) -> None:
        self._has_pairs = has_pairs
        self._patience_ns = round(LEASES * lease * NS_PER_S)
        self._checked_ns = 0  # monotonic
        self._unread: dict[Pair, tuple[int, int]] = {}  # link -> bytes read so far, ns since that number changed
        self._pairs: set[str] = set()  # peers that had two links
        self._halves: dict[str, int] = {}  # those of them with one link -> ns in this state
        self._cuts = 0  # times that such links were closed, since a peer last had two

    def close_faulty(self, session: HasLinks) -> bool:
        """Close the links to each peer with an unread or missing link; return whether there was one."""
        now = now_ns()
        if now - self._checked_ns < CHECK_NS:
            return False
        passed_ns, self._checked_ns = min(now - self._checked_ns, LONGEST_CHECK_NS), now
        connections = session.links()
        links = [(peer, (port_of(ours), port_of(theirs))) for peer, ours, theirs in connections]
        stuck = self.find_unread(passed_ns, read_progress({pair for _, pair in links}))
        peers = self.find_halves(passed_ns, [peer for peer, _, theirs in connections if _IS_HALF in theirs])
        peers |= {peer for peer, pair in links if pair in stuck}
        cut({pair for peer, pair in links if peer in peers})
        return bool(peers)

    def find_unread(self, passed_ns: int, progress: Mapping[Pair, int]) -> set[Pair]:
        """Return the links from which nothing was read for two leases, although bytes wait.

        `passed_ns`: time since the last check. `progress`: bytes read so far, of each link with waiting bytes.
        """
        known, self._unread = self._unread, {}
        for pair, read in progress.items():
            before, lasted_ns = known.get(pair, (-1, 0))
            self._unread[pair] = read, (lasted_ns + passed_ns if read == before else 0)
        return {pair for pair, (_, lasted_ns) in self._unread.items() if lasted_ns >= self._patience_ns}

    def find_halves(self, passed_ns: int, peers: Collection[str]) -> set[str]:
        """Return the peers that had two links and have had one for two leases; `peers` has one entry for each link.

        Only links for a part of the priorities count. A peer that only subscribes has one link from the beginning.
        """
        counts = Counter(peers)
        if any(count > 1 for count in counts.values()):
            self._cuts = 0
        self._pairs = {peer for peer in counts if counts[peer] > 1 or peer in self._pairs or self._has_pairs}
        halves = [peer for peer in self._pairs if counts[peer] == 1]
        self._halves = {peer: self._halves[peer] + passed_ns if peer in self._halves else 0 for peer in halves}
        patience_ns = min(self._patience_ns << min(self._cuts, 10), max(self._patience_ns, LONGEST_PATIENCE_NS))
        overdue = {peer for peer, lasted_ns in self._halves.items() if lasted_ns >= patience_ns}
        self._cuts += bool(overdue)
        self._halves |= dict.fromkeys(overdue, 0)  # they get the same time again to open both
        return overdue


def read_progress(pairs: Collection[Pair]) -> dict[Pair, int]:
    """Return the bytes read so far on each of this process's connections with waiting bytes.

    Works on Linux only; elsewhere the result is empty.
    """
    if sys.platform != "linux":
        return {}
    from fcntl import ioctl
    from termios import FIONREAD

    progress = {}
    for pair, end in network_sockets():
        if pair not in pairs:
            continue
        with suppress(OSError):  # it has just been closed
            info = end.getsockopt(_TCP, _TCP_INFO, _TCP_INFO_SIZE)
            waiting = int.from_bytes(ioctl(end.fileno(), FIONREAD, bytes(4)), "little")
            if waiting and len(info) == _TCP_INFO_SIZE:  # smaller before Linux 4.1
                progress[pair] = unpack_from("<Q", info, _BYTES_RECEIVED)[0] - waiting
    return progress


def port_of(locator: str) -> int:
    """Return the port of "tcp/HOST:PORT?..."; 0 if it has none."""
    port = locator.partition("?")[0].partition("#")[0].rpartition(":")[2]
    return int(port) if port.isdecimal() else 0

"""Symptom: of two links to a peer one is lost, and the library opens it again only when both are lost.

Then commands arrive and samples do not, or the other way round. Not reported yet. Remove when
`test_the_library_does_not_reopen_one_of_two_links` fails.
"""

from collections import Counter
from collections.abc import Collection

from hil.common.clock import NS_PER_S

LEASES = 2
LONGEST_PATIENCE_NS = 60 * NS_PER_S
IS_HALF = "?prio="  # in the address of a link for some priorities; a second link serves the rest


class HalfSessions:
    """Detect peers that should have two links and have had one for two leases (of `lease` s).

    `has_pairs`: each peer must have two links, as a slave that a master connects to; without it, only a peer that once
    had two: one that only subscribes has one link from the beginning. The time limit doubles with each detection: the
    second port may be unreachable for good, or links may open slowly.
    """

    def __init__(self, lease: float, has_pairs: bool = False) -> None:
        self._has_pairs = has_pairs
        self._patience_ns = round(LEASES * lease * NS_PER_S)
        self._pairs: set[str] = set()  # peers that had two links
        self._halves: dict[str, int] = {}  # those of them with one link -> ns in this state
        self._cuts = 0  # detections since a peer last had two

    def find(self, passed_ns: int, peers: Collection[str]) -> set[str]:
        """Return these peers. `passed_ns`: time since the last call. `peers`: one entry for each link with IS_HALF."""
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

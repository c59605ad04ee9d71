"""A small allocator of DroneCAN node numbers, for controllers that request one.

Source: the rules and times in the definition of uavcan.protocol.dynamic_node_id.Allocation (github.com/dronecan/DSDL),
and the specification, 6. Application level functions. A request carries only 6 bytes of the
node's 16-byte unique id, so three are needed; the allocator answers each with the bytes received so far.
"""

from hil.common.clock import NEVER_NS
from hil.links.dronecan.transfer import MAX_NODE_ID
from hil.links.dronecan.types import UNIQUE_ID_SIZE, Allocation

FOLLOWUP_TIMEOUT_NS = 500_000_000
MAX_PART = 6  # bytes of unique id in a request
MAX_DYNAMIC_ID = MAX_NODE_ID - 2  # the last two numbers are reserved for tools


class Allocator:
    """Allocate node numbers. A unique id gets the same number as long as the allocator runs.

    A number that was seen on the bus is not allocated. The allocator does not ask other nodes for their unique ids, so
    it is for a bus without other dynamic numbers; the specification requires more of a bus-wide allocator.
    """

    def __init__(self) -> None:
        self.due_ns = NEVER_NS  # time at which `expire` has to be called
        self._known = b""  # part of the requesting node's unique id that was received so far
        self._fresh = False  # a part was received since the last call of `expire`
        self._given: dict[bytes, int] = {}
        self._taken: set[int] = set()

    def see(self, node_id: int) -> None:
        """Record that a node with this number is on the bus."""
        self._taken.add(node_id)

    def answer(self, request: Allocation) -> Allocation | None:
        """Return the answer to an anonymous request; None if there is none."""
        if request.first_part:
            self._known = b""
        elif not self._known:
            return None
        if len(request.unique_id) != min(MAX_PART, UNIQUE_ID_SIZE - len(self._known)):
            return None
        self._known += request.unique_id
        self._fresh, self.due_ns = True, 0
        if len(self._known) < UNIQUE_ID_SIZE:
            return Allocation(0, False, self._known)
        unique_id, self._known = self._known, b""
        node_id = self._node_id(unique_id, request.node_id)
        return Allocation(node_id, False, unique_id) if node_id else None

    def expire(self, now_ns: int) -> None:
        """Discard an incomplete exchange after its timeout."""
        if self._fresh:
            self._fresh = False
            self.due_ns = now_ns + FOLLOWUP_TIMEOUT_NS
        elif now_ns >= self.due_ns:
            self._known = b""
            self.due_ns = NEVER_NS

    def _node_id(self, unique_id: bytes, preferred: int) -> int:
        """Return the number of a unique id: its previous one, or the first free one in specified order; 0 if none."""
        if unique_id not in self._given:
            start = preferred if 0 < preferred <= MAX_DYNAMIC_ID else MAX_DYNAMIC_ID
            order = (*range(start, MAX_DYNAMIC_ID + 1), *range(start - 1, 0, -1))
            free = next((number for number in order if number not in self._taken), 0)
            if not free:
                return 0
            self._taken.add(free)
            self._given[unique_id] = free
        return self._given[unique_id]

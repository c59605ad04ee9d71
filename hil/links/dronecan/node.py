"""Functions of every DroneCAN node: status messages, node information, periodic messages, and message handlers.

Source: dronecan.github.io, Specification, 5. Application level conventions and 6. Application level functions.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from hil.common.clock import NS_PER_S
from hil.links.contract import Counters, Message, Protocol
from hil.links.dronecan import types
from hil.links.dronecan.transfer import (
    TRANSFER_ID,
    DataType,
    Receiver,
    Transfer,
    frame_id,
    message_key,
    pack_transfer,
    service_key,
)
from hil.links.wires.can_frame import RECORD_SIZE, unpack_frames

STATUS_PERIOD_NS = NS_PER_S
# Names as in libcanard; on the bus the lower value has priority.
PRIORITY_HIGH, PRIORITY_MEDIUM, PRIORITY_LOW = 8, 16, 24

Decode = Callable[[bytes], Any]  # from a payload; None for one that is not of its type
Handle = Callable[[Transfer, Any], Message | None]


class Periodic(NamedTuple):
    """A message that a node sends periodically."""

    period_ns: int
    encode: Callable[[], bytes]


class DroneCanNode(Protocol):
    """A node with the number `node_id`.

    Its clock is that of `tick`, which has to be called at `deadline_ns`; this limits the resolution of timeouts of
    incomplete transfers.
    """

    def __init__(self, node_id: int, info: types.NodeInfo) -> None:
        self.counters = Counters()
        self.deadline_ns = 0
        self.info = info
        self.node_id = node_id
        self.health = types.HEALTH_OK
        self.vendor_code = 0
        self._now_ns = 0
        self._started_ns = -1
        self._receiver = Receiver(self.counters)
        self._readers: dict[int, tuple[Decode, Handle]] = {}
        self._transfer_ids: dict[int, int] = {}
        self._replies: list[bytes] = []
        self._periodic: dict[str, Periodic] = {}
        self._due_ns: dict[str, int] = {}
        self._serve(service_key(types.GET_NODE_INFO, node_id, request=True), types.GET_NODE_INFO, bytes, self._answer)
        self._repeat("status", STATUS_PERIOD_NS, self._status)

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages completed by whole records of CAN frames. Never raises."""
        frames = unpack_frames(data)
        self.counters.dropped_bytes += len(data) - len(frames) * RECORD_SIZE
        messages = []
        for frame in frames:
            transfer = self._receiver.feed_frame(frame, self._now_ns) if frame.extended else None
            if transfer is None:
                continue
            decode, handle = self._readers[transfer.key]
            decoded = decode(transfer.payload)
            if decoded is None:
                self.counters.malformed += 1
            elif (message := handle(transfer, decoded)) is not None:
                messages.append(message)
        return messages

    def replies(self) -> bytes:
        """Return the answers to requests since the last call."""
        output = b"".join(self._replies)
        self._replies.clear()
        return output

    def tick(self, now_ns: int) -> bytes:
        """Return everything that is due at `now_ns` (monotonic)."""
        self._now_ns = now_ns
        if self._started_ns < 0:
            self._started_ns = now_ns
        output = []
        for name, periodic in self._periodic.items():
            if now_ns >= self._due_ns[name]:
                self._due_ns[name] = now_ns + periodic.period_ns
                output.append(periodic.encode())
        self.deadline_ns = min(self._due_ns.values())
        return b"".join(output)

    def _repeat(self, name: str, period_ns: int, encode: Callable[[], bytes]) -> None:
        self._periodic[name] = Periodic(period_ns, encode)
        self._due_ns[name] = 0

    def _listen(self, kind: DataType, decode: Decode, handler: Handle) -> None:
        """Call `handler` with the decoded messages of that kind; those that cannot be decoded are counted."""
        self._serve(message_key(kind), kind, decode, handler)

    def _serve(self, key: int, kind: DataType, decode: Decode, handler: Handle) -> None:
        self._receiver.kinds[key] = kind
        self._readers[key] = decode, handler

    def _broadcast(self, kind: DataType, priority: int, payload: bytes) -> bytes:
        """Return the frames of a message."""
        can_id = frame_id(message_key(kind), priority, self.node_id)
        number = self._transfer_ids.get(kind.id, 0)
        self._transfer_ids[kind.id] = number + 1 & TRANSFER_ID
        return pack_transfer(can_id, payload, number, kind.seed)

    def _node_status(self) -> types.NodeStatus:
        uptime_s = max(self._now_ns - self._started_ns, 0) // NS_PER_S
        return types.NodeStatus(uptime_s, self.health, types.MODE_OPERATIONAL, self.vendor_code)

    def _status(self) -> bytes:
        return self._broadcast(types.NODE_STATUS, PRIORITY_LOW, types.pack_node_status(self._node_status()))

    def _answer(self, request: Transfer, _: bytes) -> None:
        """Answer a request to GetNodeInfo."""
        kind = types.GET_NODE_INFO
        can_id = frame_id(service_key(kind, request.source, request=False), request.priority, self.node_id)
        payload = types.pack_node_info(self._node_status(), self.info)
        self._replies.append(pack_transfer(can_id, payload, request.transfer_id, kind.seed))

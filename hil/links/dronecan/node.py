"""Functions of every DroneCAN node: status messages, node information, parameters, restart, and message handlers.

Source: dronecan.github.io, Specification, 5. Application level conventions and 6. Application level functions.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from hil.common.clock import NS_PER_S
from hil.links.contract import Counters, Message, Protocol
from hil.links.dronecan import services, types
from hil.links.dronecan.parameters import ParameterStore
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
    """A node with the number `node_id`; with 0 it has none yet and only receives.

    Its clock is that of `tick`, which has to be called at `deadline_ns`; this limits the resolution of timeouts of
    incomplete transfers.
    """

    def __init__(self, node_id: int, info: types.NodeInfo) -> None:
        self.counters = Counters()
        self.deadline_ns = 0
        self.info = info
        self.node_id = 0
        self.health = types.HEALTH_OK
        self.vendor_code = 0
        self.parameters = ParameterStore()
        self._now_ns = 0
        self._started_ns = -1
        self._receiver = Receiver(self.counters)
        self._readers: dict[int, tuple[Decode, Handle]] = {}
        self._transfer_ids: dict[int, int] = {}
        self._replies: list[bytes] = []
        self._transfers = [0, 0]  # sent, received
        self._frames = [0, 0]
        self._periodic: dict[str, Periodic] = {}
        self._due_ns: dict[str, int] = {}
        self._services: dict[DataType, tuple[Decode, Handle]] = {
            types.GET_NODE_INFO: (bytes, self._answer_info_request),
            services.GET_TRANSPORT_STATS: (bytes, self._answer_stats_request),
            services.GET_SET: (services.unpack_get_set, self._answer_get_set),
            services.EXECUTE_OPCODE: (services.unpack_opcode, self._answer_opcode),
            services.RESTART_NODE: (services.is_restart, self._answer_restart),
        }
        self._repeat("status", STATUS_PERIOD_NS, self._status)
        if node_id:
            self._enter(node_id)

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages completed by whole records of CAN frames. Never raises."""
        frames = unpack_frames(data)
        self.counters.dropped_bytes += len(data) - len(frames) * RECORD_SIZE
        messages = []
        self._frames[1] += len(frames)
        for frame in frames:
            transfer = self._receiver.feed_frame(frame, self._now_ns) if frame.extended else None
            if transfer is None:
                continue
            self._transfers[1] += 1
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

    def _enter(self, node_id: int) -> None:
        """Use the node number `node_id` from now on (0: none), and send the status at once."""
        for kind, answer in self._services.items():
            key = service_key(kind, self.node_id, request=True)
            if self._readers.pop(key, None):
                del self._receiver.kinds[key]
            if node_id:
                self._serve(service_key(kind, node_id, request=True), kind, answer)
        self.node_id = node_id
        self._due_ns["status"] = self.deadline_ns = 0

    def _repeat(self, name: str, period_ns: int, encode: Callable[[], bytes]) -> None:
        self._periodic[name] = Periodic(period_ns, encode)
        self._due_ns[name] = 0

    def _listen(self, kind: DataType, decode: Decode, handler: Handle) -> None:
        """Call `handler` with the decoded messages of that kind; those that cannot be decoded are counted."""
        self._serve(message_key(kind), kind, (decode, handler))

    def _serve(self, key: int, kind: DataType, reader: tuple[Decode, Handle]) -> None:
        self._receiver.kinds[key] = kind
        self._readers[key] = reader

    def _broadcast(self, kind: DataType, priority: int, payload: bytes) -> bytes:
        """Return the frames of a message; b"" if the node has no number."""
        if not self.node_id:
            return b""
        can_id = frame_id(message_key(kind), priority, self.node_id)
        return self._counted(pack_transfer(can_id, payload, self._next_transfer_id(kind), kind.seed))

    def _respond(self, kind: DataType, request: Transfer, payload: bytes) -> None:
        """Answer a request to a service."""
        can_id = frame_id(service_key(kind, request.source, request=False), request.priority, self.node_id)
        self._replies.append(self._counted(pack_transfer(can_id, payload, request.transfer_id, kind.seed)))

    def _counted(self, records: bytes) -> bytes:
        self._transfers[0] += 1
        self._frames[0] += len(records) // RECORD_SIZE
        return records

    def _next_transfer_id(self, kind: DataType) -> int:
        number = self._transfer_ids.get(kind.id, 0)
        self._transfer_ids[kind.id] = number + 1 & TRANSFER_ID
        return number

    def _node_status(self) -> types.NodeStatus:
        uptime_s = max(self._now_ns - self._started_ns, 0) // NS_PER_S
        return types.NodeStatus(uptime_s, self.health, types.MODE_OPERATIONAL, self.vendor_code)

    def _status(self) -> bytes:
        return self._broadcast(types.NODE_STATUS, PRIORITY_LOW, types.pack_node_status(self._node_status()))

    def _answer_info_request(self, request: Transfer, _: bytes) -> None:
        self._respond(types.GET_NODE_INFO, request, types.pack_node_info(self._node_status(), self.info))

    def _answer_stats_request(self, request: Transfer, _: bytes) -> None:
        errors = self.counters.malformed + self.counters.checksum_errors
        stats = services.TransportStats(
            self._transfers[0], self._transfers[1], errors, self._frames[0], self._frames[1], 0
        )
        self._respond(services.GET_TRANSPORT_STATS, request, services.pack_transport_stats(stats))

    def _answer_get_set(self, request: Transfer, requested: services.GetSet) -> None:
        answer = self.parameters.answer(requested)
        if requested.value is not None:
            self._on_parameters()
        self._respond(services.GET_SET, request, services.pack_description(answer))

    def _answer_opcode(self, request: Transfer, opcode: int) -> None:
        done = self.parameters.execute(opcode)
        self._on_parameters()
        self._respond(services.EXECUTE_OPCODE, request, services.pack_opcode_result(done))

    def _answer_restart(self, request: Transfer, is_right: bool) -> Message | None:
        message = self._restart() if is_right else None
        self._respond(services.RESTART_NODE, request, services.pack_done(message is not None))
        return message

    def _on_parameters(self) -> None:
        """Apply parameters that may have changed."""

    def _restart(self) -> Message | None:
        """Restart at the next tick; return the command that stops the thrusters, None if this node cannot restart."""
        return None

"""DroneCAN transport on CAN 2.0B: split transfers into frames, and reassemble them.

Source: dronecan.github.io, Specification, 4.1 CAN bus transport layer. The last byte of each frame, the tail, has flags
for the start and end of a transfer, a bit that alternates (toggle), and the transfer's number modulo 32. A transfer of
more than 7 bytes takes several frames and begins with a CRC, whose seed is the data type's signature. The 29-bit
identifier of a frame is

    message    priority 5 | data type 16                    | 0 | source node 7
    anonymous  priority 5 | discriminator 14 | data type 2   | 0 | 0
    service    priority 5 | data type 8 | request 1 | destination 7 | 1 | source node 7

Not modelled: redundant buses; CAN FD.
"""

from binascii import crc_hqx  # CRC-16/CCITT-FALSE if started with 0xFFFF
from typing import NamedTuple

from hil.links.contract import Counters
from hil.links.wires.can_frame import MAX_DATA, CanFrame, pack_frame

MAX_NODE_ID = 127
START, END, TOGGLE, TRANSFER_ID = 0x80, 0x40, 0x20, 0x1F  # in the tail
CHUNK = MAX_DATA - 1
CRC_SIZE = 2
CRC_START = 0xFFFF
REQUEST = 0x8000
WITHOUT_PRIORITY = 0x00FF_FFFF
TRANSFER_TIMEOUT_NS = 2_000_000_000


class DataType(NamedTuple):
    """A message or service: its number, the CRC of its signature, and its maximum payload in bytes."""

    id: int
    seed: int
    max_size: int


class Transfer(NamedTuple):
    """A complete received transfer; `source` 0 means an anonymous node."""

    key: int
    source: int
    transfer_id: int
    priority: int
    payload: bytes


def data_type(number: int, signature: int, max_size: int) -> DataType:
    """Return a data type from its 64-bit signature."""
    return DataType(number, crc_hqx(signature.to_bytes(8, "little"), CRC_START), max_size)


def message_key(kind: DataType) -> int:
    """Return the part of the identifier that all frames of a message type have in common."""
    return kind.id << 1


def service_key(kind: DataType, destination: int, request: bool) -> int:
    """Return the part of the identifier that all frames of a service to or from a node have in common."""
    return kind.id << 9 | request << 8 | destination << 1 | 1


def frame_id(key: int, priority: int, source: int) -> int:
    """Return the identifier of a frame from a node."""
    return priority << 24 | key << 7 | source


def pack_transfer(can_id: int, payload: bytes, transfer_id: int, seed: int) -> bytes:
    """Return the frames of a transfer, one record after another."""
    if len(payload) <= CHUNK:
        return pack_frame(CanFrame(can_id, payload + bytes((START | END | transfer_id,))))
    data = crc_hqx(payload, seed).to_bytes(CRC_SIZE, "little") + payload
    records = []
    tail = START | transfer_id
    for first in range(0, len(data), CHUNK):
        if first + CHUNK >= len(data):
            tail |= END
        records.append(pack_frame(CanFrame(can_id, data[first : first + CHUNK] + bytes((tail,)))))
        tail = tail & ~START ^ TOGGLE
    return b"".join(records)


class _Session:
    """Reassembly state of the transfers of one type from one node."""

    __slots__ = ("begun_ns", "payload", "toggle", "transfer_id")

    def __init__(self, transfer_id: int) -> None:
        self.begun_ns = 0
        self.reset(transfer_id)

    def reset(self, transfer_id: int) -> None:
        self.transfer_id = transfer_id  # of the present transfer, or of the next one
        self.toggle = 0
        self.payload: bytes | None = None  # received so far; None before the first frame


class Receiver:
    """Reassemble transfers from frames of the registered `kinds`; ignore all others.

    `counters.malformed` counts frames of a registered kind that do not fit: no start, a wrong toggle or number, a
    missing end, too many bytes for the type. `checksum_errors` counts wrong CRCs. There is one session for each kind
    and node, with at most the kind's maximum payload.
    """

    def __init__(self, counters: Counters) -> None:
        self.kinds: dict[int, DataType] = {}  # by key
        self._counters = counters
        self._sessions: dict[int, _Session] = {}

    def feed_frame(self, frame: CanFrame, now_ns: int) -> Transfer | None:
        """Return the transfer that a frame completes, else None. `now_ns` is for the timeout of incomplete ones."""
        source = frame.id & MAX_NODE_ID
        key = frame.id >> 7 & 0x1FFFF if source else (frame.id >> 8 & 3) << 1 | (frame.id >> 7 & 1)
        kind = self.kinds.get(key)
        if kind is None:
            return None
        if not frame.data:
            self._counters.malformed += 1
            return None
        payload = self._add_frame(frame, kind, now_ns) if source else self._decode_anonymous(frame.data)
        if payload is None:
            return None
        return Transfer(key, source, frame.data[-1] & TRANSFER_ID, frame.id >> 24, payload)

    def _decode_anonymous(self, data: bytes) -> bytes | None:
        if data[-1] & (START | END | TOGGLE) != START | END:
            self._counters.malformed += 1
            return None
        return data[:-1]

    def _add_frame(self, frame: CanFrame, kind: DataType, now_ns: int) -> bytes | None:
        tail = frame.data[-1]
        session = self._session(frame.id & WITHOUT_PRIORITY, tail, now_ns)
        if not self._continues(session, frame.data, kind):
            self._counters.malformed += 1
            return None
        if tail & START:
            session.begun_ns = now_ns
        payload = (session.payload or b"") + frame.data[:-1]
        if not tail & END:
            session.payload = payload
            session.toggle ^= TOGGLE
            return None
        session.reset(session.transfer_id + 1 & TRANSFER_ID)
        return payload if tail & START else self._checked(payload, kind.seed)

    def _session(self, descriptor: int, tail: int, now_ns: int) -> _Session:
        """Return the session of a frame, reset if the specification requires it."""
        session = self._sessions.get(descriptor)
        if session is None:
            session = self._sessions[descriptor] = _Session(tail & TRANSFER_ID)
            return session
        # Neither the expected transfer nor the one before it.
        is_new = tail & START and session.transfer_id - tail & TRANSFER_ID > 1
        if is_new or now_ns - session.begun_ns > TRANSFER_TIMEOUT_NS:
            self._counters.malformed += session.payload is not None  # its end was never received
            session.reset(tail & TRANSFER_ID)
        return session

    @staticmethod
    def _continues(session: _Session, data: bytes, kind: DataType) -> bool:
        tail = data[-1]
        begun = session.payload
        if (begun is None) != bool(tail & START) or tail & TOGGLE != session.toggle:
            return False
        if tail & TRANSFER_ID != session.transfer_id or (not tail & END and len(data) < MAX_DATA):
            return False
        return begun is None or len(begun) + len(data) - 1 <= kind.max_size + CRC_SIZE

    def _checked(self, data: bytes, seed: int) -> bytes | None:
        payload = data[CRC_SIZE:]
        if crc_hqx(payload, seed) != int.from_bytes(data[:CRC_SIZE], "little"):
            self._counters.checksum_errors += 1
            return None
        return payload

"""Mission protocol (MISSION_*): upload, download, clear, current item. Fences and rally points are always empty."""

from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_MS
from hil.gateways.mavlink.flight.mission_items import Item, encode_item, read_item, validate_item
from hil.gateways.mavlink.snapshot import Origin

MAX_ITEMS = 500
RETRY_NS = 400 * NS_PER_MS  # until an item that was not sent is requested again
RETRIES = 8
MISSION = dialect.MAV_MISSION_TYPE_MISSION
EMPTY_TYPES = (dialect.MAV_MISSION_TYPE_FENCE, dialect.MAV_MISSION_TYPE_RALLY)

Partner = tuple[int, int, int]  # peer, system, component


class _Upload:
    """An upload under way: from whom, what has come, and when the next item is requested again."""

    def __init__(self, partner: Partner, count: int, now: int) -> None:
        self.partner, self.count = partner, count
        self.items: list[Item] = []
        self.tries = 0
        self.asks_as_int = True  # scripts that know the old form alone leave MISSION_REQUEST_INT unanswered
        self.due_ns = now + RETRY_NS


class MissionProtocol:
    """The mission, and its exchange with ground stations, one upload at a time.

    `on_new` is called with the new items, `origin` returns the origin of local coordinates. With `home`, which returns
    the home position as an item, item 0 is always that, as in ArduPilot.
    Each method returns the messages to send to the partner.
    """

    def __init__(
        self,
        on_new: Callable[[Sequence[Item]], None],
        origin: Callable[[], Origin | None],
        home: Callable[[], Item] | None,
    ) -> None:
        self._on_new, self._origin, self._home = on_new, origin, home
        self._items: list[Item] = []
        self._upload: _Upload | None = None

    @property
    def items(self) -> list[Item]:
        """The items as they are numbered on the wire."""
        return [self._home(), *self._items[1:]] if self._home else self._items

    def request_list(self, packet: Any, partner: Partner) -> list[Any]:
        """Answer MISSION_REQUEST_LIST."""
        if packet.mission_type == MISSION:
            return [_count(len(self.items), MISSION, partner)]
        if packet.mission_type in EMPTY_TYPES:
            return [_count(0, packet.mission_type, partner)]
        return [_ack(dialect.MAV_MISSION_UNSUPPORTED, packet.mission_type, partner)]

    def request_item(self, packet: Any, partner: Partner, current: int) -> list[Any]:
        """Answer MISSION_REQUEST_INT and MISSION_REQUEST; an unknown item is answered with an error."""
        items = self.items
        if packet.mission_type != MISSION or not 0 <= packet.seq < len(items):
            return [_ack(dialect.MAV_MISSION_INVALID_SEQUENCE, packet.mission_type, partner)]
        as_int = packet.get_msgId() == dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        _, system, component = partner
        return [encode_item(items[packet.seq], packet.seq, packet.seq == current, system, component, as_int)]

    def begin_upload(self, packet: Any, partner: Partner, now: int) -> list[Any]:
        """Answer MISSION_COUNT."""
        kind, count = packet.mission_type, packet.count
        if kind != MISSION:
            is_fine = kind in EMPTY_TYPES and count == 0
            result = dialect.MAV_MISSION_ACCEPTED if is_fine else dialect.MAV_MISSION_UNSUPPORTED
            return [_ack(result, kind, partner)]
        if self._upload and self._upload.partner != partner:
            return [_ack(dialect.MAV_MISSION_DENIED, kind, partner)]
        if count > MAX_ITEMS:
            return [_ack(dialect.MAV_MISSION_NO_SPACE, kind, partner)]
        if count == 0:
            self._upload = None
            return self._replace([], partner)
        self._upload = _Upload(partner, count, now)
        return [self._request()]

    def receive_item(self, packet: Any, partner: Partner, now: int) -> list[Any]:
        """Store the item of MISSION_ITEM_INT or MISSION_ITEM, and request the next one."""
        upload = self._upload
        if upload is None and packet.mission_type == MISSION and self._is_last(packet):  # our answer was lost
            return [_ack(dialect.MAV_MISSION_ACCEPTED, MISSION, partner)]
        if upload is None or partner != upload.partner or packet.mission_type != MISSION:
            return [_ack(dialect.MAV_MISSION_INVALID_SEQUENCE, packet.mission_type, partner)]
        if packet.seq != len(upload.items):  # sent twice, or late: what is missing is requested again in time
            return []
        item = read_item(packet)
        is_home = self._home is not None and packet.seq == 0
        problem = None if item is None or is_home else validate_item(item, self._origin())
        if item is None or problem is not None:
            self._upload = None
            return [_ack(problem or dialect.MAV_MISSION_INVALID, MISSION, partner)]
        upload.items.append(item)
        upload.tries, upload.due_ns = 0, now + RETRY_NS
        if len(upload.items) < upload.count:
            return [self._request()]
        self._upload = None
        return self._replace(upload.items, partner)

    def clear(self, packet: Any, partner: Partner) -> list[Any]:
        """Answer MISSION_CLEAR_ALL."""
        if packet.mission_type in (MISSION, dialect.MAV_MISSION_TYPE_ALL):
            self._upload = None
            replies = self._replace([], partner)
            return replies if packet.mission_type == MISSION else [_ack(0, packet.mission_type, partner)]
        result = dialect.MAV_MISSION_ACCEPTED if packet.mission_type in EMPTY_TYPES else dialect.MAV_MISSION_UNSUPPORTED
        return [_ack(result, packet.mission_type, partner)]

    def refuse(self, packet: Any, partner: Partner) -> list[Any]:
        """Answer a change by a partner that may not command."""
        return [_ack(dialect.MAV_MISSION_DENIED, packet.mission_type, partner)]

    def tick(self, now: int) -> tuple[Partner, list[Any]] | None:
        """Return the request for an item that has not come, and to whom; after RETRIES the upload is cancelled."""
        upload = self._upload
        if upload is None or now < upload.due_ns:
            return None
        upload.tries += 1
        upload.due_ns = now + RETRY_NS
        if upload.tries > RETRIES:
            self._upload = None
            return upload.partner, [_ack(dialect.MAV_MISSION_OPERATION_CANCELLED, MISSION, upload.partner)]
        upload.asks_as_int = not upload.asks_as_int
        return upload.partner, [self._request()]

    def _is_last(self, packet: Any) -> bool:
        return bool(self._items) and packet.seq == len(self._items) - 1 and read_item(packet) == self._items[-1]

    def _request(self) -> Any:
        assert self._upload
        _, system, component = self._upload.partner
        as_int = self._upload.asks_as_int
        kind = dialect.MAVLink_mission_request_int_message if as_int else dialect.MAVLink_mission_request_message
        return kind(system, component, len(self._upload.items), MISSION)

    def _replace(self, items: list[Item], partner: Partner) -> list[Any]:
        self._items = items
        self._on_new(items)
        return [_ack(dialect.MAV_MISSION_ACCEPTED, MISSION, partner)]


def _count(count: int, kind: int, partner: Partner) -> Any:
    return dialect.MAVLink_mission_count_message(partner[1], partner[2], count, kind)


def _ack(result: int, kind: int, partner: Partner) -> Any:
    return dialect.MAVLink_mission_ack_message(partner[1], partner[2], result, kind)

"""BlueOS' zenoh keys: raw packets on mavlink_raw/in and /out, messages as JSON on mavlink/in and /out and by message.

`mavlink/SYSTEM/COMPONENT/MESSAGE` has the newest of each message, and below it each field. Source:
bluerobotics/mavlink-server, src/lib/drivers/zenoh. The JSON: see json_messages.py.
"""

import json
from collections import deque
from typing import Any

from hil.common.stop import Wakeup
from hil.gateways.mavlink.endpoints.json_messages import decode_message, encode_message, plain_fields
from hil.links.endpoints.sockets import Link, Received
from hil.network.opening import open_session
from hil.network.session import Session
from hil.network.settings import Network, settings

RAW, TEXT = "mavlink_raw", "mavlink"
WAITING = 200
ADDRESS = "zenoh"


class ZenohLink(Link):
    """One router or slave at `endpoint`, over a session of its own. Raises NetworkError when nobody is there."""

    def __init__(self, endpoint: str, session: Session | None = None) -> None:
        self.name = f"zenoh:{endpoint}"
        self._event = Wakeup()
        self._received: deque[bytes] = deque(maxlen=WAITING)
        text = settings("client", (), (endpoint,), Network(mode="routed", router=endpoint), None)
        self._session = session or open_session("connect to", endpoint, text)
        self._senders: dict[str, Any] = {}
        self._session.receive(f"{RAW}/in", self._on_packet, WAITING)
        self._session.receive(f"{TEXT}/in", self._on_text, WAITING)

    def descriptors(self) -> list[int]:
        """Return what is readable while packets wait."""
        return [self._event.fileno()]

    def receive(self, now: int) -> Received:
        """Return the packets that have come."""
        self._event.clear()  # before the queue is read: a later packet sets it again
        return [(ADDRESS, self._received.popleft()) for _ in range(len(self._received))]

    def send(self, address: Any, data: bytes, message: Any = None) -> None:
        """Publish a packet, and its message as JSON."""
        self._put(f"{RAW}/out", data)
        fields = plain_fields(message)
        system, component = message.get_srcSystem(), message.get_srcComponent()
        text = encode_message((system, component, message.get_seq()), fields, message)
        self._put(f"{TEXT}/out", text)
        key = f"{TEXT}/{system}/{component}/{message.get_type()}"
        self._put(key, text)
        for name, value in fields.items():
            self._put(f"{key}/{name}", json.dumps(value).encode())

    def partners(self) -> list[Any]:
        """Return the only peer: all that read the keys."""
        return [ADDRESS]

    def is_local(self, address: Any) -> bool:
        """Return false: anyone who reaches the router may be behind it."""
        return False

    def close(self) -> None:
        """Close the session."""
        self._session.close()
        self._event.close()

    def _put(self, key: str, payload: bytes) -> None:
        send = self._senders.get(key)
        if send is None:
            send = self._senders[key] = self._session.sender(key)
        send(payload)

    def _on_text(self, payload: bytes) -> None:
        packet = decode_message(payload)
        if packet is not None:
            self._on_packet(packet)

    def _on_packet(self, payload: bytes) -> None:
        self._received.append(payload)
        self._event.set()

"""BlueOS' zenoh keys: raw packets on mavlink_raw/in and /out, messages as JSON on mavlink/out and by message.

`mavlink/SYSTEM/COMPONENT/MESSAGE` has the newest of each message, and below it each field. The JSON is that of
mavlink2rest and BlueOS' mavlink-server (src/lib/drivers/zenoh): a header, and a message with its type.
"""

import json
import math
from collections import deque
from typing import Any

from hil.common.stop import Wakeup
from hil.gateways.mavlink.endpoints.links import Link, Received
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
        self._session = session or open_session("dial", endpoint, text)
        self._senders: dict[str, Any] = {}
        self._session.receive(f"{RAW}/in", self._on_packet, WAITING)

    def descriptors(self) -> list[int]:
        """Return what is readable while packets wait."""
        return [self._event.fileno()]

    def receive(self, now: int) -> Received:
        """Return the packets that have come."""
        self._event.clear()  # before the look: what comes later sets it again
        return [(ADDRESS, self._received.popleft()) for _ in range(len(self._received))]

    def send(self, address: Any, data: bytes, message: Any) -> None:
        """Publish a packet, and its message as JSON."""
        self._put(f"{RAW}/out", data)
        fields = plain_fields(message)
        header = {"system_id": data[5], "component_id": data[6], "sequence": data[4]}
        text = json.dumps({"header": header, "message": {"type": message.get_type(), **fields}}).encode()
        self._put(f"{TEXT}/out", text)
        key = f"{TEXT}/{data[5]}/{data[6]}/{message.get_type()}"
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

    def _on_packet(self, payload: bytes) -> None:
        self._received.append(payload)
        self._event.set()


def plain_fields(message: Any) -> dict[str, Any]:
    """Return the fields of a message as JSON has them: no NaN, texts without their padding.

    A field called "type" is "mavtype", as in mavlink2rest: "type" is that of the message.
    """
    names = [name for name in message.get_fieldnames() if hasattr(message, name)]
    return {"mavtype" if name == "type" else name: _plain(getattr(message, name)) for name in names}


def _plain(value: Any) -> Any:
    if isinstance(value, (bytes, bytearray)):
        return bytes(value).rstrip(b"\0").decode("utf-8", "replace")
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

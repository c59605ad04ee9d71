"""A topic that the gateway publishes to subscribers of ROS 1, each over a connection of its own."""

import asyncio
from collections import deque
from collections.abc import Callable

from hil.common.web.server_thread import first_done
from hil.gateways.ros1.messages import Kind, UnreadableError, to_ros1
from hil.gateways.ros1.tcpros import Connection, encode_header, frame, require_type
from hil.recording.mcap_file import Message

MAX_WAITING, MAX_BYTES = 100, 8 << 20  # messages and bytes that wait for a subscriber; then the oldest are dropped


class Subscriber:
    """One connection to a subscriber. One that does not read loses the oldest messages and holds up nobody."""

    def __init__(self, caller: str) -> None:
        self.caller = caller
        self.dropped = 0
        self._waiting: deque[bytes] = deque()
        self._bytes = 0
        self._wake = asyncio.Event()

    def put(self, data: bytes) -> None:
        """Queue a message to be sent, with its length before it."""
        self._waiting.append(data)
        self._bytes += len(data)
        while len(self._waiting) > 1 and (len(self._waiting) > MAX_WAITING or self._bytes > MAX_BYTES):
            self._bytes -= len(self._waiting.popleft())
            self.dropped += 1
        self._wake.set()

    async def send(self, writer: asyncio.StreamWriter) -> None:
        """Send what comes until the connection breaks."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._waiting:
                data = self._waiting.popleft()
                self._bytes -= len(data)
                writer.write(data)
                await writer.drain()


class Publication:
    """One topic. A new subscriber gets the last `latched` different messages (0: none)."""

    def __init__(self, topic: str, kind: Kind, latched: int, on_subscriber: Callable[[str], None]) -> None:
        self.topic = topic
        self.kind = kind
        self.subscribers: set[Subscriber] = set()
        self._on_subscriber = on_subscriber
        self._last: deque[Message] = deque(maxlen=latched)
        self._sequence = 0

    def publish(self, message: Message) -> None:
        """Send a message of ROS 2 to all subscribers; one that does not fit its type is dropped."""
        if self._last.maxlen and message.data not in [each.data for each in self._last]:
            self._last.append(message)
        if self.subscribers:
            data = self._encode(message)
            for subscriber in self.subscribers if data else ():
                subscriber.put(data)

    async def serve(self, node: str, connection: Connection) -> None:
        """Serve a connection whose header named this topic, until it ends. Raises PeerError."""
        header, reader, writer = connection
        require_type(header, self.topic, self.kind.name, self.kind.md5sum)
        reply = {
            "callerid": node,
            "latching": str(int(bool(self._last.maxlen))),
            "md5sum": self.kind.md5sum,
            "message_definition": self.kind.definition,
            "topic": self.topic,
            "type": self.kind.name,
        }
        writer.write(encode_header(reply))
        subscriber = Subscriber(header.get("callerid", "?")[:256])
        for message in self._last:
            if data := self._encode(message):
                subscriber.put(data)
        self.subscribers.add(subscriber)
        self._on_subscriber(self.topic)
        try:
            await first_done(subscriber.send(writer), _until_closed(reader))
        finally:
            self.subscribers.discard(subscriber)

    def _encode(self, message: Message) -> bytes:
        """Return a message with its length before it; empty if it is invalid."""
        self._sequence += 1
        try:
            return frame(to_ros1(self.kind.type, message.data, self._sequence))
        except UnreadableError:
            return b""


async def _until_closed(reader: asyncio.StreamReader) -> None:
    """Wait until a peer closes the connection; what it sends is not part of TCPROS."""
    while await reader.read(4096):
        pass

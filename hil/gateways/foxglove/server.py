"""The websocket server for Foxglove: channels out, and what clients with the token publish, call and set, in.

Its own code and not Foxglove's SDK, because the SDK can refuse neither pages of other origins nor clients without a
token: everyone who reaches its port could command a vehicle.
"""

import asyncio
import threading
from collections.abc import Iterable

from aiohttp import web

from hil.common.errors import NetworkError
from hil.common.stop import cancel_tasks
from hil.gateways.access import Access
from hil.gateways.foxglove.client import Client
from hil.gateways.foxglove.commanding import Commanding
from hil.gateways.foxglove.protocol import SUBPROTOCOLS, Channel
from hil.recording.mcap_file import Message, schema_of
from hil.ros.topics import TOPICS

MOST_CLIENTS = 32
LARGEST = 1 << 20  # bytes of a message of a client
HEARTBEAT_S = 5.0  # after which a client that does not answer is gone


class FoxgloveServer:
    """Serves at `host`:`port` (0: any free one; see `port`) in a thread of its own. Use as a context.

    `access` holds the token: programs may look without it, web pages may not, and who commands through `commanding`
    needs it. Raises NetworkError when the port is taken.
    """

    def __init__(self, host: str, port: int, commanding: Commanding | None = None) -> None:
        self._commanding = commanding
        self._channels: list[Channel] = []
        self._numbers: dict[str, int] = {}
        self._latched: dict[int, tuple[int, bytes]] = {}  # by channel the last message, for those who come later
        self._clients: set[Client] = set()
        self._loop = asyncio.new_event_loop()
        self._runner: web.AppRunner | None = None
        try:
            self.port: int = self._loop.run_until_complete(self._start(host, port))
        except OSError as error:
            self._loop.run_until_complete(self._stop())
            raise NetworkError(
                f"cannot serve at {host}:{port}: {error.strerror}; choose another with --listen"
            ) from None
        self.access = Access(self.port)
        self._thread = threading.Thread(target=self._loop.run_forever, name="foxglove", daemon=True)
        self._thread.start()

    def __enter__(self) -> "FoxgloveServer":
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(self._stop(), self._loop).result(10.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self.access.close()

    def show(self, messages: Iterable[Message]) -> None:
        """Pass messages of ROS 2 on, byte for byte, with the times when they were sent."""
        batch = list(messages)
        if batch:
            self._loop.call_soon_threadsafe(self._show, batch)

    def publish(self, channel: Channel, time_ns: int, data: bytes, latched: bool = False) -> None:
        """Publish a message of the gateway itself on a channel."""
        self._loop.call_soon_threadsafe(self._publish, channel, time_ns, data, latched)

    def is_watched(self, topic: str) -> bool:
        """Return True if a client has subscribed to the topic."""
        number = self._numbers.get(topic)
        return any(client.has_subscribed(number) for client in tuple(self._clients))

    def offer(self, channel: Channel) -> None:
        """Advertise a channel before there is a message."""
        self._loop.call_soon_threadsafe(self._number_of, channel)

    def _show(self, messages: list[Message]) -> None:
        for message in messages:
            number = self._numbers.get(message.topic)
            if number is None:
                encoding, text = schema_of(message.type)
                channel = Channel(message.topic, message.type, schema=text.decode(), schema_encoding=encoding)
                number = self._number_of(channel)
            row = TOPICS.get(message.topic) or TOPICS.get(message.topic.rpartition("/")[2])
            self._send(number, message.published_ns, message.data, bool(row and row.qos.latched))

    def _publish(self, channel: Channel, time_ns: int, data: bytes, latched: bool) -> None:
        self._send(self._number_of(channel), time_ns, data, latched)

    def _send(self, number: int, time_ns: int, data: bytes, latched: bool) -> None:
        if latched:
            self._latched[number] = time_ns, data
        for client in self._clients:
            client.send_message(number, time_ns, data)

    def _number_of(self, channel: Channel) -> int:
        number = self._numbers.get(channel.topic)
        if number is None:
            number = self._numbers[channel.topic] = len(self._channels)
            self._channels.append(channel)
            for client in self._clients:
                client.advertise({number: channel})
        return number

    async def _start(self, host: str, port: int) -> int:
        app = web.Application()
        app.router.add_get("/", self._serve)
        self._runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await self._runner.setup()
        await web.TCPSite(self._runner, host, port).start()
        return int(self._runner.addresses[0][1])

    async def _stop(self) -> None:
        if self._runner:
            await self._runner.cleanup()
        await cancel_tasks()

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        """Serve one client until it goes."""
        may_command = self.access.admits(request.query.get("token"))
        if request.headers.get("Origin") and not may_command:
            raise web.HTTPForbidden(text="a page needs the token: open the address that `uuv-hil foxglove` printed\n")
        socket = web.WebSocketResponse(
            protocols=SUBPROTOCOLS, max_msg_size=LARGEST, heartbeat=HEARTBEAT_S, compress=False
        )
        if not socket.can_prepare(request):
            raise web.HTTPBadRequest(text="this is a websocket for Foxglove\n")
        await socket.prepare(request)
        if len(self._clients) >= MOST_CLIENTS:
            await socket.close(message=f"{MOST_CLIENTS} clients are here already".encode())
            return socket
        client = Client(socket, self._commanding if may_command else None, self._latched.get)
        self._clients.add(client)
        try:
            client.advertise(dict(enumerate(self._channels)))
            await client.serve()
        finally:
            self._clients.discard(client)
        return socket

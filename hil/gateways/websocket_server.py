"""The websocket server of gateways: who may connect, and who may command.

Programs may observe without the token, web pages may not; commands need the token.
"""

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, Generic, TypeVar

from aiohttp import web

from hil.common.web.access import WebAccess
from hil.common.web.http_server import HttpServer
from hil.common.web.server_thread import STALLED_S, ServerThread, cut_when_stalled
from hil.gateways.access import Access
from hil.gateways.websocket_client import SocketClient
from hil.recording.mcap_file import Message

MAX_CLIENTS = 32
LARGEST = 1 << 20  # bytes of a message of a client
# Between two pings of a client. It is disconnected if it has not answered after half of that. The time is long because
# a planner that computes for seconds reads nothing meanwhile.
HEARTBEAT_S = 2.0 * STALLED_S


T = TypeVar("T", bound=SocketClient)


class WebSocketServer(ServerThread, Generic[T]):
    """Serves at `host`:`port` (0: any free one; see `port`) in a thread of its own. Use as a context.

    `access` holds the token; `name` is that of the command and of what is served, `protocols` are the subprotocols.
    Raises NetworkError when the port is taken.
    """

    def __init__(self, host: str, port: int, name: str, protocols: Sequence[str] = ()) -> None:
        self._name = name
        self._protocols = tuple(protocols)
        self._clients: set[T] = set()
        self._server: HttpServer | None = None
        super().__init__(name, host, port)

    def __enter__(self) -> "Any":
        return self

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self.access.close()

    def show(self, messages: Iterable[Message]) -> None:
        """Pass messages of ROS 2 on to the clients that want them."""
        batch = list(messages)
        if batch:
            self._loop.call_soon_threadsafe(self._show, batch)

    @abstractmethod
    def _show(self, messages: list[Message]) -> None:
        """Pass messages on, in the server's thread."""

    @abstractmethod
    def _make_client(self, socket: web.WebSocketResponse, may_command: bool) -> T:
        """Return the client of a socket that was opened."""

    async def _start(self, host: str, port: int) -> int:
        app = web.Application()
        app.router.add_get("/", self._serve)
        self._server = HttpServer(app, WebAccess(host), self._may_command)
        listening = await self._server.start(host, port)
        self.access = Access(listening)
        return listening

    async def _stop(self) -> None:
        if self._server:
            await self._server.stop()

    def _may_command(self, request: web.Request) -> bool:
        return self.access.admits(request.query.get("token"))

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        """Serve one client until its connection closes."""
        socket = web.WebSocketResponse(
            protocols=self._protocols, max_msg_size=LARGEST, heartbeat=HEARTBEAT_S, autoping=False, compress=False
        )
        if not socket.can_prepare(request):
            raise web.HTTPBadRequest(text=f"this is a websocket for {self._name.capitalize()}\n")
        await socket.prepare(request)
        if len(self._clients) >= MAX_CLIENTS:
            await socket.close(message=f"{MAX_CLIENTS} clients are here already".encode())
            return socket
        transport = request.transport
        if transport is None:  # the client has disconnected meanwhile
            return socket
        client = self._make_client(socket, self._may_command(request))
        self._clients.add(client)
        try:
            with cut_when_stalled(socket, transport):
                await client.serve()
        finally:
            self._clients.discard(client)
        return socket

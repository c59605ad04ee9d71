"""The websocket server of gateways: who may connect, and who may command.

Programs may observe without the token, web pages may not; commands need the token.
"""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

from aiohttp import web

from hil.common.server_thread import STALLED_S, ServerThread, cut_when_stalled, http_log
from hil.gateways.access import Access
from hil.gateways.websocket_client import SocketClient

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
        self._runner: web.AppRunner | None = None
        super().__init__(name, host, port)

    def __enter__(self) -> "Any":
        return self

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self.access.close()

    @abstractmethod
    def _make_client(self, socket: web.WebSocketResponse, may_command: bool) -> T:
        """Return the client of a socket that was opened."""

    async def _start(self, host: str, port: int) -> int:
        app = web.Application()
        app.router.add_get("/", self._serve)
        self._runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0, logger=http_log())
        await self._runner.setup()
        await web.TCPSite(self._runner, host, port).start()
        listening = int(self._runner.addresses[0][1])
        self.access = Access(listening)
        return listening

    async def _stop(self) -> None:
        if self._runner:
            await self._runner.cleanup()

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        """Serve one client until its connection closes."""
        may_command = self.access.admits(request.query.get("token"))
        if request.headers.get("Origin") and not may_command:
            raise web.HTTPForbidden(
                text=f"a page needs the token: open the address that `uuv-hil {self._name}` printed\n"
            )
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
        client = self._make_client(socket, may_command)
        self._clients.add(client)
        try:
            with cut_when_stalled(socket, transport):
                await client.serve()
        finally:
            self._clients.discard(client)
        return socket

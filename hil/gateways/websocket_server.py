"""The websocket server of gateways: who may connect, who may command, and what waits for a client.

Programs may look without the token, web pages may not, and who commands needs it.
"""

import asyncio
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import Any, Generic, Protocol, TypeVar

from aiohttp import web

from hil.common.errors import NetworkError
from hil.gateways.access import Access

MOST_CLIENTS = 32
LARGEST = 1 << 20  # bytes of a message of a client
HEARTBEAT_S = 5.0  # after which a client that does not answer is gone
MOST_BYTES = 32 << 20  # that wait for a client; beyond it the oldest messages are dropped


class Served(Protocol):
    """One client of a server."""

    async def serve(self) -> None:
        """Send and receive until the client goes."""


T = TypeVar("T", bound=Served)


class WebSocketServer(ABC, Generic[T]):
    """Serves at `host`:`port` (0: any free one; see `port`) in a thread of its own. Use as a context.

    `access` holds the token; `name` is that of the command and of what is served, `protocols` are the subprotocols.
    Raises NetworkError when the port is taken.
    """

    def __init__(self, host: str, port: int, name: str, protocols: Sequence[str] = ()) -> None:
        self._name = name
        self._protocols = tuple(protocols)
        self._clients: set[T] = set()
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
        self._thread = threading.Thread(target=self._loop.run_forever, name=name, daemon=True)
        self._thread.start()

    def __enter__(self) -> "Any":
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(self._stop(), self._loop).result(10.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self.access.close()

    @abstractmethod
    def _make_client(self, socket: web.WebSocketResponse, may_command: bool) -> T:
        """Return the client of a socket that was opened."""

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
        rest = asyncio.all_tasks() - {asyncio.current_task()}  # of clients that were still there
        for task in rest:
            task.cancel()
        await asyncio.gather(*rest, return_exceptions=True)

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        """Serve one client until it goes."""
        may_command = self.access.admits(request.query.get("token"))
        if request.headers.get("Origin") and not may_command:
            raise web.HTTPForbidden(
                text=f"a page needs the token: open the address that `uuv-hil {self._name}` printed\n"
            )
        socket = web.WebSocketResponse(
            protocols=self._protocols, max_msg_size=LARGEST, heartbeat=HEARTBEAT_S, compress=False
        )
        if not socket.can_prepare(request):
            raise web.HTTPBadRequest(text=f"this is a websocket for {self._name.capitalize()}\n")
        await socket.prepare(request)
        if len(self._clients) >= MOST_CLIENTS:
            await socket.close(message=f"{MOST_CLIENTS} clients are here already".encode())
            return socket
        client = self._make_client(socket, may_command)
        self._clients.add(client)
        try:
            await client.serve()
        finally:
            self._clients.discard(client)
        return socket


class SendQueue:
    """Messages that wait to be sent to one client. Of what may be dropped the oldest goes when it is too much.

    `dropped` counts what was.
    """

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self._socket = socket
        self._waiting: deque[tuple[str | bytes, bool]] = deque()
        self._bytes = 0
        self._wake = asyncio.Event()
        self.dropped = 0

    def put(self, message: str | bytes, keep: bool) -> None:
        """Let a message be sent; without `keep` it may be dropped."""
        self._waiting.append((message, keep))
        self._bytes += len(message)
        while self._bytes > MOST_BYTES and not self._waiting[0][1] and len(self._waiting) > 1:
            self._bytes -= len(self._waiting.popleft()[0])
            self.dropped += 1
        self._wake.set()

    async def send_waiting(self) -> None:
        """Wait for something, and send all there is; a client that does not read holds up nobody but itself."""
        await self._wake.wait()
        self._wake.clear()
        while self._waiting:
            message = self._waiting.popleft()[0]
            self._bytes -= len(message)
            if isinstance(message, str):
                await self._socket.send_str(message)
            else:
                await self._socket.send_bytes(message)

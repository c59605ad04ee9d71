"""An aiohttp application at a port: who may use it, how many connections, and for how long they may send nothing."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from ssl import SSLContext

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from hil.common.web.access import LONGEST_PATH, MAX_CONNECTIONS, REQUEST_S, WebAccess
from hil.common.web.late_address import late_socket

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class HttpServer:
    """Serve `app` in the running event loop by the rule `access`; `has_token` tells whether a request has the token.

    More than `MAX_CONNECTIONS` connections are refused. A connection that has sent no admitted request within
    `REQUEST_S` is closed.
    """

    def __init__(
        self, app: web.Application, access: WebAccess, has_token: Callable[[web.Request], bool] = lambda _: False
    ) -> None:
        self._access = access
        self._has_token = has_token
        self._admitted: set[asyncio.Protocol] = set()  # open connections with an admitted request
        self._listener: asyncio.Server | None = None
        app.middlewares.insert(0, self._admit)
        self._runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0, logger=_http_log())

    async def start(self, host: str, port: int, tls: SSLContext | None = None) -> int:
        """Listen at `host`:`port` (0: any free one); return the port. Raises OSError."""
        await self._runner.setup()
        loop, late = asyncio.get_running_loop(), late_socket(host, port)
        if late:
            self._listener = await loop.create_server(self._accept, sock=late, ssl=tls)
        else:
            self._listener = await loop.create_server(self._accept, host, port, ssl=tls)
        return int(self._listener.sockets[0].getsockname()[1])

    async def stop(self) -> None:
        """Close all connections, also after `start` failed."""
        if self._listener:
            self._listener.close()
        await self._runner.cleanup()

    def _accept(self) -> asyncio.BaseProtocol:
        """Return the protocol for a new connection: aiohttp's, or one that closes it if too many are open."""
        server = self._runner.server
        assert server
        opened = {connection for connection in server.connections if connection.transport}
        self._admitted &= opened
        if len(opened) >= MAX_CONNECTIONS:
            return _Refusal()
        connection = server()
        asyncio.get_running_loop().call_later(REQUEST_S, self._close_unless_admitted, connection)
        return connection

    def _close_unless_admitted(self, connection: web.RequestHandler) -> None:
        if connection not in self._admitted:
            connection.force_close()

    @web.middleware
    async def _admit(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if len(request.raw_path) > LONGEST_PATH:
            raise web.HTTPRequestURITooLong(text=f"at most {LONGEST_PATH} characters of a path are read\n")
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin", "")
        refusal = self._access.refusal(host, origin, self._has_token(request))
        if refusal:
            raise web.HTTPForbidden(text=f"{refusal}\n")
        self._admitted.add(request.protocol)  # before the handler, as that of a websocket ends with the connection
        try:
            return await handler(request)
        except web.HTTPForbidden:
            self._admitted.discard(request.protocol)
            raise


class _Refusal(asyncio.Protocol):
    """Closes a connection at once."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()


def _http_log() -> logging.Logger:
    """Return a logger for aiohttp that logs our own errors only, not a traceback for bytes that are not HTTP."""
    logger = logging.getLogger(__name__)
    logger.addFilter(_is_ours)
    return logger


def _is_ours(record: logging.LogRecord) -> bool:
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))

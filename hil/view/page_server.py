"""Web server of the live view: its page, a proxy to the scene's server, and the websocket of the stick.

viser serves the scene and has no authentication. It listens on this machine only, on a separate port, and accepts only
this server as a client, which sends it a secret. This server requires a token and refuses pages of other origins.
"""

import asyncio
import json
import secrets
from collections.abc import Callable, Mapping
from importlib.resources import files
from ssl import SSLContext
from typing import Any

from aiohttp import ClientSession, WSMsgType, web

from hil.common.web.access import WebAccess
from hil.common.web.http_server import Handler, HttpServer
from hil.common.web.server_thread import STALLED_S, ServerThread, cut_when_stalled, first_done

COOKIE = "uuv_hil_view"
SECRET_HEADER = "X-Uuv-Hil-Secret"
MAX_STICK_BYTES = 4096  # in one message of the stick
MAX_CLIENTS = 32
HEARTBEAT_S = 10.0  # period of websocket pings; a connection without a pong is closed after half of it
LARGEST_MESSAGE = 256 << 20  # bytes from the scene to the browser

StickMessage = Mapping[str, Any]
# Called with a client's number and its stick message, or None when the client has closed; returns what it then shows.
OnStick = Callable[[int, StickMessage | None], Mapping[str, Any]]


class PageServer(ServerThread):
    """Serves at `host`:`port` (0: any free one) in a separate thread. Use as a context.

    viser listens on `scene_port` and requires `secret`; a browser must send `token`. Raises NetworkError if the port is
    in use.
    """

    def __init__(
        self,
        host: str,
        port: int,
        scene_port: int,
        secret: str,
        token: str,
        on_stick: OnStick,
        tls: SSLContext | None = None,
    ) -> None:
        self._scene = f"http://127.0.0.1:{scene_port}"
        self._secret, self._token, self._on_stick = secret, token, on_stick
        self._clients = 0
        self._server: HttpServer | None = None
        self._tls = tls
        super().__init__("view page", host, port)

    def __enter__(self) -> "PageServer":
        return self

    async def _start(self, host: str, port: int) -> int:
        app = web.Application(middlewares=[self._admit])
        app.router.add_get("/", self._page)
        app.router.add_get("/stick", self._stick)
        app.router.add_get("/scene{path:(/.*)?}", self._pass_on)
        self._server = HttpServer(app, WebAccess(host, "own"), self._has_token)
        return await self._server.start(host, port, self._tls)

    async def _stop(self) -> None:
        if self._server:
            await self._server.stop()

    @web.middleware
    async def _admit(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse requests without the token; keep a token of the address in a cookie."""
        if not self._has_token(request):
            raise web.HTTPForbidden(text="open the address that `uuv-hil view` printed, with its token\n")
        token = request.query.get("token", "")
        if self._is_token(token):
            response: web.StreamResponse = web.Response(status=302, headers={"Location": "/"})
            if request.path != "/":
                response = await handler(request)
            if not response.prepared:
                response.set_cookie(self._cookie, token, httponly=True, samesite="Strict", secure=request.secure)
            return response
        response = await handler(request)
        if not response.prepared:
            response.headers["Content-Security-Policy"] = "frame-ancestors 'self'"
        return response

    @property
    def _cookie(self) -> str:
        return f"{COOKIE}_{self.port}"  # browsers do not distinguish the ports of a host

    def _has_token(self, request: web.Request) -> bool:
        return self._is_token(request.query.get("token", "")) or self._is_token(request.cookies.get(self._cookie, ""))

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(errors="surrogatepass"), self._token.encode())

    async def _page(self, _: web.Request) -> web.Response:
        text = files("hil.view").joinpath("page.html").read_text(encoding="utf-8")
        return web.Response(text=text, content_type="text/html", headers={"Cache-Control": "no-store"})

    async def _stick(self, request: web.Request) -> web.WebSocketResponse:
        """Exchange messages with the page: receive stick and buttons, send the allowed actions and the shown values."""
        socket = web.WebSocketResponse(max_msg_size=MAX_STICK_BYTES, heartbeat=HEARTBEAT_S)
        await socket.prepare(request)
        if self._clients >= MAX_CLIENTS:
            await socket.close(message=f"{MAX_CLIENTS} browsers are connected already".encode())
            return socket
        if request.transport is None:  # the client has disconnected meanwhile
            return socket
        self._clients += 1
        number = id(socket)
        try:
            with cut_when_stalled(socket, request.transport):
                async for message in socket:
                    if message.type is not WSMsgType.TEXT:
                        continue
                    values = _parse(message.data)
                    if values is not None:
                        answer = await asyncio.to_thread(self._on_stick, number, values)
                        await asyncio.wait_for(socket.send_str(json.dumps(answer)), STALLED_S)
        finally:
            self._clients -= 1
            await asyncio.to_thread(self._on_stick, number, None)
        return socket

    async def _pass_on(self, request: web.Request) -> web.StreamResponse:
        """Forward a request or a websocket to viser."""
        url = self._scene + (request.match_info["path"] or "/")
        headers = {SECRET_HEADER: self._secret}
        async with ClientSession(headers=headers) as client:
            if request.headers.get("Upgrade", "").lower() == "websocket":
                return await self._pass_socket(request, client, url)
            async with client.get(url) as answer:
                forwarded = {name: answer.headers[name] for name in ("Content-Type",) if name in answer.headers}
                return web.Response(status=answer.status, body=await answer.read(), headers=forwarded)

    async def _pass_socket(self, request: web.Request, client: ClientSession, url: str) -> web.WebSocketResponse:
        protocols = [word.strip() for word in request.headers.get("Sec-WebSocket-Protocol", "").split(",") if word]
        outside = web.WebSocketResponse(protocols=protocols, max_msg_size=1 << 20, heartbeat=HEARTBEAT_S)
        await outside.prepare(request)
        if request.transport is None:  # the client has disconnected meanwhile
            return outside
        async with client.ws_connect(url, protocols=protocols, max_msg_size=LARGEST_MESSAGE) as inside:
            with cut_when_stalled(outside, request.transport):
                await first_done(_pump(outside, inside), _pump(inside, outside))
                await outside.close()
        return outside


async def _pump(source: Any, sink: Any) -> None:
    async for message in source:
        if message.type is WSMsgType.BINARY:
            await asyncio.wait_for(sink.send_bytes(message.data), STALLED_S)
        elif message.type is WSMsgType.TEXT:
            await asyncio.wait_for(sink.send_str(message.data), STALLED_S)


def _parse(text: str) -> StickMessage | None:
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return values if isinstance(values, dict) else None

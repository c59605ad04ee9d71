"""Web server of the live view: its page, the content of the scene, the websockets of samples and of the stick.

It requires a token and refuses pages of other origins. The page loads nothing from elsewhere.
"""

import asyncio
import json
import secrets
from collections.abc import Callable, Mapping
from importlib.resources import files
from ssl import SSLContext
from typing import Any

from aiohttp import WSMsgType, web

from hil.common.web.access import WebAccess
from hil.common.web.http_server import Handler, HttpServer
from hil.common.web.server_thread import STALLED_S, ServerThread, cut_when_stalled, first_done
from hil.view.feed import Feed, pack

COOKIE = "uuv_hil_view"
MAX_MESSAGE_BYTES = 8192  # in one message of the page
MAX_CLIENTS = 32
HEARTBEAT_S = 10.0  # period of websocket pings; a connection without a pong is closed after half of it
UNANSWERED = 3  # messages of samples on their way to one browser: on a slow network it gets fewer, not older ones
KINDS = {"html": "text/html", "js": "text/javascript", "css": "text/css"}
RULES = (
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; frame-ancestors 'self'; "
    "base-uri 'none'; form-action 'none'"
)

Message = Mapping[str, Any]
# Called with a client's number and its stick message, or None when the client has closed; returns what it then shows.
OnStick = Callable[[int, Message | None], Mapping[str, Any]]


class Viewer:
    """One browser: what it has got, what it wants, and how many messages it has not answered."""

    def __init__(self) -> None:
        self.version = 0
        self.unanswered = 0
        self.vehicle = ""
        self.pictures: list[str] = []  # keys in the feed
        self.wakeup = asyncio.Event()

    def answer(self, values: Message) -> None:
        """Handle an answer of the page: its vehicle, and the sensors whose pictures it shows."""
        self.unanswered = max(0, self.unanswered - 1)
        self.vehicle = str(values.get("vehicle") or "")
        wanted = values.get("pictures")
        self.pictures = [f"{self.vehicle}/{sensor}" for sensor in wanted[:16]] if isinstance(wanted, list) else []
        self.wakeup.set()


class PageServer(ServerThread):
    """Serves at `host`:`port` (0: any free one) in a separate thread. Use as a context.

    A browser must send `token`. It gets `content` (gzipped) once, and what changes in `feed` when `wake` is called.
    Raises NetworkError if the port is in use.
    """

    def __init__(
        self,
        host: str,
        port: int,
        token: str,
        content: bytes,
        feed: Feed,
        on_stick: OnStick,
        tls: SSLContext | None = None,
    ) -> None:
        self._token, self._content, self._feed, self._on_stick = token, content, feed, on_stick
        self._clients = 0
        self._viewers: list[Viewer] = []
        self._server: HttpServer | None = None
        self._tls = tls
        super().__init__("view page", host, port)

    def __enter__(self) -> "PageServer":
        return self

    @property
    def viewers(self) -> list[Viewer]:
        """The connected browsers."""
        return list(self._viewers)

    def wake(self) -> None:
        """Send what is new to all browsers."""
        if self._viewers:
            self._loop.call_soon_threadsafe(self._wake_all)

    def _wake_all(self) -> None:
        for viewer in self._viewers:
            viewer.wakeup.set()

    async def _start(self, host: str, port: int) -> int:
        app = web.Application(middlewares=[self._admit])
        app.router.add_get("/", self._page)
        app.router.add_get(r"/{name:[a-z_]+\.(js|css)}", self._page)
        app.router.add_get("/content", self._scene)
        app.router.add_get("/live", self._live)
        app.router.add_get("/stick", self._stick)
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
            response.headers["Content-Security-Policy"] = RULES
        return response

    @property
    def _cookie(self) -> str:
        return f"{COOKIE}_{self.port}"  # browsers do not distinguish the ports of a host

    def _has_token(self, request: web.Request) -> bool:
        return self._is_token(request.query.get("token", "")) or self._is_token(request.cookies.get(self._cookie, ""))

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(errors="surrogatepass"), self._token.encode())

    async def _page(self, request: web.Request) -> web.Response:
        name = request.match_info.get("name", "index.html")
        file = files("hil.view").joinpath("page").joinpath(name)
        if not file.is_file():
            raise web.HTTPNotFound
        kind = KINDS[name.rpartition(".")[2]]
        text = file.read_text(encoding="utf-8")
        return web.Response(text=text, content_type=kind, headers={"Cache-Control": "no-store"})

    async def _scene(self, _: web.Request) -> web.Response:
        headers = {"Content-Encoding": "gzip", "Cache-Control": "no-store"}
        return web.Response(body=self._content, content_type="application/octet-stream", headers=headers)

    async def _accept(self, request: web.Request, count: int) -> web.WebSocketResponse | None:
        """Return an open websocket; None if too many are open already or the client has disconnected."""
        socket = web.WebSocketResponse(max_msg_size=MAX_MESSAGE_BYTES, heartbeat=HEARTBEAT_S)
        await socket.prepare(request)
        if count >= MAX_CLIENTS:
            await socket.close(message=f"{MAX_CLIENTS} browsers are connected already".encode())
            return None
        return socket if request.transport else None

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Send what is new to the page, which answers each message with what it shows."""
        socket = await self._accept(request, len(self._viewers))
        if socket is None or request.transport is None:
            return web.Response(status=503)
        viewer = Viewer()
        self._viewers.append(viewer)
        try:
            with cut_when_stalled(socket, request.transport):
                await first_done(self._send_news(socket, viewer), _receive_answers(socket, viewer))
        finally:
            self._viewers.remove(viewer)
        return socket

    async def _send_news(self, socket: web.WebSocketResponse, viewer: Viewer) -> None:
        viewer.wakeup.set()
        while True:
            await viewer.wakeup.wait()
            viewer.wakeup.clear()
            if viewer.unanswered >= UNANSWERED:
                continue
            since = viewer.version
            viewer.version, text = self._feed.changes(since)
            if viewer.version == since:
                continue
            viewer.unanswered += 1
            await asyncio.wait_for(socket.send_str(text), STALLED_S)
            for picture in self._feed.pictures(viewer.pictures, since):
                await asyncio.wait_for(socket.send_bytes(pack(picture.header, picture.data)), STALLED_S)

    async def _stick(self, request: web.Request) -> web.StreamResponse:
        """Exchange messages with the page: receive stick and buttons, send the allowed actions and the shown values."""
        socket = await self._accept(request, self._clients)
        if socket is None or request.transport is None:
            return web.Response(status=503)
        self._clients += 1
        number = id(socket)
        try:
            with cut_when_stalled(socket, request.transport):
                async for message in socket:
                    values = _parse(message)
                    if values is not None:
                        answer = await asyncio.to_thread(self._on_stick, number, values)
                        await asyncio.wait_for(socket.send_str(json.dumps(answer)), STALLED_S)
        finally:
            self._clients -= 1
            await asyncio.to_thread(self._on_stick, number, None)
        return socket


async def _receive_answers(socket: web.WebSocketResponse, viewer: Viewer) -> None:
    async for message in socket:
        if (values := _parse(message)) is not None:
            viewer.answer(values)


def _parse(message: Any) -> Message | None:
    """Return the JSON object in a text message; None for anything else."""
    if message.type is not WSMsgType.TEXT:
        return None
    try:
        values = json.loads(message.data)
    except (ValueError, RecursionError):
        return None
    return values if isinstance(values, dict) else None

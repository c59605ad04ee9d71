"""The viser server, which draws the scene in the browser. Only the live view's own web server may connect to it."""

import secrets
import threading
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

from hil.common.errors import MissingExtraError
from hil.common.ports import free_ports
from hil.view.page_server import SECRET_HEADER
from hil.view.scene.wakeup import ThreadSafeEvent


class SceneServer:
    """A viser server on a free port of this machine. Use as a context; `server` is the viser.ViserServer.

    A client that does not send `secret` in the header of its websocket request is disconnected before any of its
    messages is read. Raises MissingExtraError.
    """

    def __init__(self) -> None:
        try:
            import viser
            from viser import _messages
        except ImportError:
            raise MissingExtraError("the live view needs viser: pip install 'uuv-hil[view]'") from None
        self.secret = secrets.token_urlsafe(24)
        self.port = free_ports(1)[0]
        self._viewers: set[int] = set()
        self._lock = threading.Lock()
        with redirect_stdout(StringIO()):  # viser prints its address, which nobody can use
            self.server = viser.ViserServer("127.0.0.1", self.port, label="uuv-hil view", verbose=False)
        self.port = self.server.get_port()
        # viser has no public interface to read the headers of a request; its websocket server has the connections.
        websockets: Any = self.server._websock_server

        async def check(client: Any) -> None:
            connection = websockets._live_connections[client.client_id]
            given = connection.request.headers.get(SECRET_HEADER, "")
            if not secrets.compare_digest(given.encode(), self.secret.encode()):
                await connection.close(1008, "only by way of the live view's page")
                return
            _make_thread_safe(websockets._client_state_from_id[client.client_id].message_buffer)
            with self._lock:
                self._viewers.add(client.client_id)

        def leave(client: Any) -> None:
            with self._lock:
                self._viewers.discard(client.client_id)

        _make_thread_safe(websockets._broadcast_buffer)
        websockets.unregister_handler(_messages.ShareUrlRequest)  # it would open a tunnel to a foreign server
        websockets.on_client_connect(check)
        websockets.on_client_disconnect(leave)

    def __enter__(self) -> "SceneServer":
        return self

    def __exit__(self, *_: object) -> None:
        with redirect_stdout(StringIO()):
            self.server.stop()

    @property
    def viewers(self) -> int:
        """Number of connected browsers."""
        with self._lock:
            return len(self._viewers)


def _make_thread_safe(buffer: Any) -> None:
    """Let other threads add messages to a buffer of viser. Call it before anything waits for the buffer."""
    buffer.message_event = ThreadSafeEvent(buffer.event_loop)

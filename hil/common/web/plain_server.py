"""The standard library's HTTP server with the rules of our other web servers: access, connections, time of a request.

For processes that serve one thing in GET and would pay for the import of aiohttp.
"""

import socket
import threading
import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from hil.common.web.access import MAX_CONNECTIONS, REQUEST_S, WebAccess
from hil.common.web.late_address import late_socket

NO_DESCRIPTOR_S = 0.2  # pause after a connection that could not be accepted


class PlainHttpServer(ThreadingHTTPServer):
    """Serve at `where` in a thread called `name`, a thread a connection, by handlers of the class `handler`.

    `start` begins, `stop` ends. Raises OSError if the port is in use.
    """

    daemon_threads = True
    request_queue_size = 128  # connections that wait to be accepted; with 5, others than the first wait for seconds

    def __init__(self, name: str, where: tuple[str, int], handler: type["PlainHandler"]) -> None:
        self.address_family = socket.AF_INET6 if ":" in where[0] else socket.AF_INET
        self.access = WebAccess(where[0])
        self._waiting: dict[Any, float] = {}  # connections without an admitted request -> until when they may stay
        self._open = 0
        self._lock = threading.Lock()
        late = late_socket(*where)
        super().__init__(where, handler, bind_and_activate=not late)
        if late:
            self.socket.close()
            self.socket, self.server_address = late, where
            self.server_name, self.server_port = where
        self._thread = threading.Thread(target=self.serve_forever, name=name, daemon=True)

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    @property
    def is_serving(self) -> bool:
        """Whether it has begun and was not stopped; connections that are kept open may outlive it."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Close the port."""
        self.shutdown()
        self.server_close()
        self._thread.join(2.0)

    def admit(self, connection: Any) -> None:
        """Let a connection stay: it has sent a request that is admitted."""
        with self._lock:
            self._waiting.pop(connection, None)

    def get_request(self) -> tuple[Any, Any]:
        """Accept a connection. Raises OSError; without descriptors the next attempt waits."""
        try:
            return super().get_request()
        except OSError:
            time.sleep(NO_DESCRIPTOR_S)
            raise

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own, or close it if too many are open."""
        with self._lock:
            is_full = self._open >= MAX_CONNECTIONS
            self._open += 1
            self._waiting[request] = time.monotonic() + REQUEST_S
        if is_full:
            self.shutdown_request(request)
        else:
            super().process_request(request, client_address)

    def service_actions(self) -> None:
        """Close connections that have sent no admitted request in time."""
        now = time.monotonic()
        with self._lock:
            for connection in [each for each, until in self._waiting.items() if until < now]:
                with suppress(OSError):  # it has closed
                    connection.shutdown(socket.SHUT_RDWR)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection."""
        with self._lock:
            self._open -= 1
            self._waiting.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a connection that failed: it has closed."""


class PlainHandler(BaseHTTPRequestHandler):
    """Answer one GET, which is admitted. Subclasses define `do_GET`."""

    server: PlainHttpServer
    timeout = REQUEST_S  # for a part of a request, and for a peer that does not read

    def parse_request(self) -> bool:
        """Return whether the request is well-formed and admitted; if not, it has been answered."""
        if not super().parse_request():
            return False
        refusal = self.server.access.refusal(self.headers.get("Host", ""), self.headers.get("Origin", ""))
        if refusal:
            self.send_error(403, refusal)
            return False
        self.server.admit(self.connection)
        return True

    def log_message(self, *_: Any) -> None:
        """Log nothing."""

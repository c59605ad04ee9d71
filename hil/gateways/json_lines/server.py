"""Listen for connections of the JSON gateway, up to a limit."""

import socket
import threading

from hil.client.fleet import Fleet
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.common.web.access import REQUEST_S
from hil.common.web.late_address import late_socket
from hil.gateways.access import Access
from hil.gateways.json_lines.connection import Connection
from hil.gateways.json_lines.requests import encode

MAX_CONNECTIONS = 32
ACCEPT_S = 0.2  # between two checks for the end


class JsonGateway:
    """Serves a fleet at `host`:`port` (0: any free one; see `port`). Use as a context. Raises NetworkError.

    `access` holds the token without which nobody commands. More than 32 connections at a time are refused, unless one
    of them has sent no line within `REQUEST_S`: then the oldest of these is closed.
    """

    def __init__(self, fleet: Fleet, host: str, port: int) -> None:
        self._fleet = fleet
        self._ending = threading.Event()
        self._connections: list[Connection] = []
        try:
            self._socket = late_socket(host, port) or socket.create_server((host, port))
        except OSError as error:
            raise NetworkError(f"cannot listen on {host}:{port}: {error.strerror}; choose another place") from None
        self._socket.settimeout(ACCEPT_S)
        self.port: int = self._socket.getsockname()[1]
        self.access = Access(self.port)
        self._thread = threading.Thread(target=self._accept, name="gateway", daemon=True)
        self._thread.start()

    def __enter__(self) -> "JsonGateway":
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._socket.close()
        for connection in self._connections:
            connection.close()
        self.access.close()

    def _accept(self) -> None:
        while not self._ending.is_set():
            try:
                opened, _ = self._socket.accept()
            except TimeoutError:
                continue
            except OSError:  # the client has closed already, or this process has no descriptor left for it
                self._ending.wait(ACCEPT_S)
                continue
            if self._has_room():
                connection = Connection(self._fleet, self.access, opened)
                self._connections.append(connection)
                connection.start()
            else:
                _refuse(opened)

    def _has_room(self) -> bool:
        self._connections = [connection for connection in self._connections if connection.is_alive]
        if len(self._connections) < MAX_CONNECTIONS:
            return True
        overdue_ns = now_ns() - round(REQUEST_S * NS_PER_S)
        silent = next((each for each in self._connections if each.silent_since(overdue_ns)), None)
        if silent:
            silent.close()
            self._connections.remove(silent)
        return silent is not None


def _refuse(opened: socket.socket) -> None:
    problem = f"{MAX_CONNECTIONS} connections are open already; close one of them"
    with opened:
        opened.settimeout(0)
        try:
            opened.sendall(encode({"id": None, "ok": False, "error": problem}))
        except OSError:  # it has closed already
            return

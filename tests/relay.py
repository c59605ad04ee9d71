"""A slow network between two programs of this machine."""

import socket
import threading
import time
from contextlib import suppress

PIECE = 4096  # bytes


class Relay:
    """A network in between: all to `port` at once, what comes from there at `rate` bytes a second, if any is given."""

    def __init__(self, here: int, port: int, rate: float) -> None:
        self._port, self._rate = port, rate
        self._ends: list[socket.socket] = []
        self._listener = self._small(socket.create_server(("127.0.0.1", here)))
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        for end in (self._listener, *self._ends):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                master = self._listener.accept()[0]
                slave = self._small(socket.socket())
                slave.connect(("127.0.0.1", self._port))
                self._ends += [master, slave]
                for ends in ((master, slave, 0.0), (slave, master, self._rate)):
                    threading.Thread(target=self._pass_on, args=ends, daemon=True).start()

    def _pass_on(self, source: socket.socket, target: socket.socket, rate: float) -> None:
        target.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with suppress(OSError):
            while piece := source.recv(PIECE):
                target.sendall(piece)
                time.sleep(len(piece) / rate if rate else 0.0)

    def _small(self, end: socket.socket) -> socket.socket:
        """Holds back little, as a bottleneck that is near."""
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2 * PIECE)
        return end

"""What no command can undercut: bare datagrams and bare TCP between the same machines, at the same pace.

One way is half a round trip: which of the two ways took longer cannot be told without a common clock.
"""

import select
import socket
from typing import Any, Self

from hil.clock import NS_PER_S, now_ns
from hil.errors import NetworkError

MOST = 1 << 16  # bytes at once
PIECE = 1 << 14
ANSWER_S = 1.0


def serve(address: str, stop_fd: int) -> None:
    """Send everything back that comes by UDP or TCP, until `stop_fd` becomes readable; prints address and ports.

    Raises NetworkError.
    """
    with socket.socket(type=socket.SOCK_DGRAM) as datagrams:
        try:
            datagrams.bind((address, 0))
            server = socket.create_server((address, 0))
        except OSError as error:
            raise NetworkError(f"cannot listen on {address}: {error.strerror}; it has to be this machine's") from None
        print(f"{address}:{datagrams.getsockname()[1]}:{server.getsockname()[1]}", flush=True)
        streams: list[socket.socket] = []
        while True:
            waiting: list[Any] = [stop_fd, datagrams, server, *streams]
            for ready in select.select(waiting, (), ())[0]:
                if ready == stop_fd:
                    for stream in (server, *streams):
                        stream.close()
                    return
                if ready is datagrams:
                    datagrams.sendto(*datagrams.recvfrom(MOST))
                elif ready is server:
                    streams.append(_prompt(server.accept()[0]))
                elif not _echo(ready):
                    streams.remove(ready)


def _prompt(stream: socket.socket) -> socket.socket:
    stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return stream


def _echo(stream: socket.socket) -> bool:
    data = stream.recv(MOST)
    if data:
        stream.sendall(data)
    else:
        stream.close()
    return bool(data)


class Floor:
    """The asking end. Use as a context. `udp_ns` and `tcp_ns` are the one-way times found, `lost` those without answer.

    Raises NetworkError when there is nobody.
    """

    def __init__(self, host: str, udp: int, tcp: int, size: int) -> None:
        self._size = size
        self.udp_ns: list[int] = []
        self.tcp_ns: list[int] = []
        self.lost = 0
        self._turn = False
        self._datagrams = socket.socket(type=socket.SOCK_DGRAM)
        self._datagrams.connect((host, udp))
        self._datagrams.settimeout(ANSWER_S)
        try:
            self._stream = _prompt(socket.create_connection((host, tcp), ANSWER_S))
        except OSError as error:
            self._datagrams.close()
            raise NetworkError(f"no echo at {host}:{tcp}: {error}; start `uuv-hil bench echo` there") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._datagrams.close()
        self._stream.close()

    def measure(self) -> None:
        """One round trip, by UDP and by TCP in turn: each begins on a machine as idle as a command finds it."""
        self._turn = not self._turn
        began = now_ns()
        if self._turn:
            self.load(self._size)
            self.tcp_ns.append((now_ns() - began) // 2)
            return
        try:
            self._datagrams.send(bytes(self._size))
            self._datagrams.recv(MOST)
            self.udp_ns.append((now_ns() - began) // 2)
        except OSError:
            self.lost += 1

    def load(self, size: int) -> None:
        """Send so many bytes there and back, in pieces that no buffer on the way holds up."""
        try:
            while size > 0:
                piece = min(size, PIECE)
                self._stream.sendall(bytes(piece))
                size -= piece
                while piece > 0:
                    piece -= len(self._stream.recv(MOST)) or piece
        except OSError:
            self.lost += 1


def wait_ns(deadline: int) -> None:
    """Sleep until an instant of the monotonic clock (ns)."""
    select.select((), (), (), max(deadline - now_ns(), 0) / NS_PER_S)

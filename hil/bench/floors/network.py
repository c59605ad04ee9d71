"""Measure bare UDP and TCP round trips between the machines of a benchmark, at the commands' rate.

The one-way time is half a round trip, because the two directions cannot be told apart without a common clock.
"""

import select
import socket
from contextlib import suppress
from typing import Any

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError

MAX = 1 << 16  # bytes at once
PATIENCE_S = 1.0  # for a connection, and for a client that sends and does not read
MIN_S = 0.001  # time for an answer, even if it was requested late
GIVE_UP = 3  # requests without an answer after which no more are sent


def serve(address: str, stop_fd: int) -> None:
    """Echo all data received by UDP or TCP, until `stop_fd` becomes readable; prints address and ports.

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
                    with suppress(OSError):  # the client counts it as lost
                        datagrams.sendto(*datagrams.recvfrom(MAX))
                elif ready is server:
                    with suppress(OSError):  # disconnected already
                        streams.append(_prompt(server.accept()[0]))
                elif not _echo(ready):
                    streams.remove(ready)


def _prompt(stream: socket.socket) -> socket.socket:
    stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    stream.settimeout(PATIENCE_S)
    return stream


def _echo(stream: socket.socket) -> bool:
    """Echo the received bytes; return whether there may be more."""
    with suppress(OSError):  # reset, or the client does not read
        data = stream.recv(MAX)
        if data:
            stream.sendall(data)
            return True
    stream.close()
    return False


def _connect(host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    opened = socket.socket(socket.AF_INET, kind)
    try:
        opened.settimeout(PATIENCE_S)
        opened.connect((host, port))
        return opened if kind == socket.SOCK_DGRAM else _prompt(opened)
    except (OSError, OverflowError, UnicodeError) as error:  # an impossible port or name
        opened.close()
        raise NetworkError(f"no echo at {host}:{port}: {error}; start `uuv-hil bench echo` there") from None


class RoundTrips:
    """Round trips of `size` bytes by one socket; half of each is in `taken_ns`; `lost` counts the unanswered."""

    def __init__(self, opened: socket.socket, size: int) -> None:
        self._socket = opened
        self._size = size
        self._count = 0
        self._received = b""
        self.taken_ns: list[int] = []
        self.lost = 0

    @property
    def is_silent(self) -> bool:
        """True if the peer has never answered, after GIVE_UP requests."""
        return not self.taken_ns and self.lost >= GIVE_UP

    def measure_once(self, until_ns: int) -> None:
        """Measure one round trip, given up at `until_ns` (monotonic)."""
        self._count += 1
        message = self._count.to_bytes(8, "big").ljust(self._size, b"\0")  # tells this answer from late ones
        began = now_ns()
        try:
            self._socket.send(message)
            while self._receive(until_ns) != message:
                pass
            self.taken_ns.append((now_ns() - began) // 2)
        except OSError:
            self.lost += 1

    def _receive(self, until_ns: int) -> bytes:
        while len(self._received) < self._size:
            self._socket.settimeout(max((until_ns - now_ns()) / NS_PER_S, MIN_S))
            data = self._socket.recv(MAX)
            if not data:
                raise ConnectionResetError
            self._received += data
        message, self._received = self._received[: self._size], self._received[self._size :]
        return message

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class Floor:
    """The measuring end, by `udp` and `tcp`, with messages of `size` bytes (at least 8). Use as a context.

    Raises NetworkError when there is no echo.
    """

    def __init__(self, host: str, udp: int, tcp: int, size: int) -> None:
        self.tcp = RoundTrips(_connect(host, tcp, socket.SOCK_STREAM), size)
        try:
            self.udp = RoundTrips(_connect(host, udp, socket.SOCK_DGRAM), size)
        except NetworkError:
            self.tcp.close()
            raise
        self._use_udp = False

    def __enter__(self) -> "Floor":
        return self

    def __exit__(self, *_: object) -> None:
        self.udp.close()
        self.tcp.close()

    def measure(self, until_ns: int) -> None:
        """Measure one round trip, by UDP and TCP alternately: each begins on a machine as idle as before a command.

        An answer that has not arrived by `until_ns` (monotonic) counts as lost, so that the caller need not wait.
        """
        self._use_udp = not self._use_udp
        round_trip = self.udp if self._use_udp else self.tcp
        if not round_trip.is_silent:
            round_trip.measure_once(until_ns)


def wait_ns(deadline: int) -> None:
    """Sleep until an instant of the monotonic clock (ns)."""
    select.select((), (), (), max(deadline - now_ns(), 0) / NS_PER_S)

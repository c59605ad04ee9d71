"""Wires of the network: the STM32's end listens, the host's end connects.

    TcpWire, TcpHostWire    a stream of bytes; each end notices within `SILENCE_S` that the other is gone
    UdpWire, UdpHostWire    datagrams, one a write; what is lost is lost, and nobody notices who goes

None blocks after it is open. Little is kept for a reader who does not read (`BUFFER`), so that he never
acts on old commands. There is no password: whoever reaches an open port commands the thrusters, which
is why `host` is this machine alone unless it is told otherwise.
"""

import contextlib
import errno
import os
import select
import socket
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

from hil.clock import NS_PER_S, now_ns
from hil.errors import DeviceError
from hil.links.contract import Wire
from hil.links.wires.terminal import READ_SIZE, DescriptorWire

HERE = "127.0.0.1"
CONNECT_S = 2.0
SILENCE_S = 2.0  # of a peer that acknowledges nothing, as when its cable is out
BUFFER = 16_384  # bytes; the kernel doubles it
MAX_DATAGRAM = 65_536


class _SocketWire(DescriptorWire):
    """A wire on one socket, which it owns."""

    def __init__(self, opened: socket.socket, name: str) -> None:
        opened.setblocking(False)
        for size in (socket.SO_SNDBUF, socket.SO_RCVBUF):
            opened.setsockopt(socket.SOL_SOCKET, size, BUFFER)
        super().__init__(opened.fileno(), name)
        self._socket = opened

    def close(self) -> None:
        """Give the socket back. Closing twice is harmless."""
        self._fd = -1
        self._socket.close()


class _TcpStream(_SocketWire):
    """A connection that somebody has made."""

    def __init__(self, opened: socket.socket, name: str) -> None:
        super().__init__(opened, name)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(SILENCE_S * 1000))

    def _gone(self, reason: str | None) -> DeviceError:
        if self._fd >= 0:
            with contextlib.suppress(OSError):  # it may be so broken already
                self._socket.shutdown(socket.SHUT_RDWR)  # else the first write after a hang-up would succeed
        return super()._gone(reason)


class TcpHostWire(_TcpStream):
    """The host's end: connects to `host` and `port`. Raises DeviceError if nobody listens there."""

    def __init__(self, host: str, port: int) -> None:
        name = f"tcp://{host}:{port}"
        try:
            opened = socket.create_connection((host, port), CONNECT_S)
        except OSError as error:
            raise DeviceError(f"{name}: {error.strerror or error}; start the end that listens first") from None
        super().__init__(opened, name)


class TcpWire(Wire):
    """The STM32's end: listens on `host` and `port` (0: any that is free), one peer at a time.

    A second caller is turned away while the first is there. When a peer goes the wire is as one that
    nobody reads, until the next one calls. Raises DeviceError if the port is taken.
    """

    def __init__(self, host: str = HERE, port: int = 0) -> None:
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            self._listener = socket.create_server((host, port), family=family, backlog=1)
        except OSError as error:
            raise _cannot_listen("tcp", host, port, error) from None
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self.name = f"tcp://{host}:{self.port}"
        self._peer: _TcpStream | None = None
        self._epoll = select.epoll()  # one descriptor that wakes for a caller and for bytes
        self._epoll.register(self._listener, select.EPOLLIN)

    def fileno(self) -> int:
        """The descriptor to wait on for incoming bytes; -1 once closed."""
        return -1 if self._epoll.closed else self._epoll.fileno()

    def read(self) -> bytes:
        """The bytes that have come in (4096 at most), or b"". Raises DeviceError only if closed here."""
        return self._from_peer() or (self._from_peer() if self._welcome() else b"")

    def write(self, data: bytes) -> int:
        """Send `data`; the number of bytes taken: none if there is no peer. Raises DeviceError only if closed here."""
        self._check_open()
        if self._peer is None:
            return 0
        try:
            return self._peer.write(data)
        except DeviceError:
            self._part()
            return 0

    def close(self) -> None:
        """Hang up and give the port back. Closing twice is harmless."""
        self._part()
        self._listener.close()
        self._epoll.close()

    def _from_peer(self) -> bytes:
        self._check_open()
        try:
            return self._peer.read() if self._peer else b""
        except DeviceError:
            self._part()
            return b""

    def _welcome(self) -> bool:
        """Take up who calls, or turn him away if there is a peer already; whether there is a new peer."""
        try:
            caller, _ = self._listener.accept()
        except OSError:  # nobody calls, or he has hung up meanwhile
            return False
        if self._peer:
            caller.close()
            return False
        self._peer = _TcpStream(caller, self.name)
        self._epoll.register(self._peer, select.EPOLLIN)
        return True

    def _part(self) -> None:
        if self._peer:
            self._peer.close()  # which also takes it off the epoll
            self._peer = None

    def _check_open(self) -> None:
        if self._epoll.closed:
            raise DeviceError(f"{self.name}: is closed; open it again")


class _UdpWire(_SocketWire):
    """What both ends have in common: reading all datagrams that are there."""

    def read(self) -> bytes:
        """The bytes of the datagrams that have come in, or b"". Raises DeviceError when the network is gone."""
        datagrams: list[bytes] = []
        size = 0
        while size < READ_SIZE:
            try:
                datagram, sender = self._socket.recvfrom(MAX_DATAGRAM)
            except (BlockingIOError, ConnectionRefusedError):  # refused: our last one found nobody
                break
            except OSError as error:
                raise self._gone(error.strerror) from None
            if self._is_peer(sender):
                datagrams.append(datagram)
                size += len(datagram)
        return b"".join(datagrams)

    @abstractmethod
    def _is_peer(self, sender: tuple[str, int]) -> bool:
        """Whether what `sender` says is for this wire."""

    def _refused(self, error: OSError) -> int:
        """0 bytes taken, if that is what `error` means: no room, nobody there, or too long for a datagram."""
        if error.errno in (errno.EAGAIN, errno.ENOBUFS, errno.ECONNREFUSED, errno.EMSGSIZE):
            return 0
        raise self._gone(error.strerror) from None


class UdpHostWire(_UdpWire):
    """The host's end: sends to `host` and `port`, hears only them.

    It begins with an empty datagram, from which the other end learns where to send. Raises DeviceError
    if there is no such host.
    """

    def __init__(self, host: str, port: int) -> None:
        name = f"udp://{host}:{port}"
        try:
            opened = _datagrams(host, port, socket.socket.connect)
        except OSError as error:
            raise DeviceError(f"{name}: {error.strerror or error}; correct the address") from None
        super().__init__(opened, name)
        self.write(b"")

    def write(self, data: bytes) -> int:
        """Send `data` as one datagram; its size, or 0 if refused. Raises DeviceError when the network is gone."""
        try:
            return os.write(self._fd, data)
        except OSError as error:
            return self._refused(error)

    def _is_peer(self, sender: tuple[str, int]) -> bool:
        return True  # the kernel has looked


class UdpWire(_UdpWire):
    """The STM32's end: hears on `host` and `port` (0: any that is free) and sends to whoever spoke first.

    Others are not heard until that one has been silent for `SILENCE_S`. Raises DeviceError if the port
    is taken.
    """

    def __init__(self, host: str = HERE, port: int = 0) -> None:
        try:
            opened = _datagrams(host, port, socket.socket.bind)
        except OSError as error:
            raise _cannot_listen("udp", host, port, error) from None
        self.port: int = opened.getsockname()[1]
        super().__init__(opened, f"udp://{host}:{self.port}")
        self._peer: tuple[str, int] | None = None
        self._heard_ns = 0

    def write(self, data: bytes) -> int:
        """Send `data` as one datagram; its size, or 0 if it was refused or nobody has spoken yet.

        Raises DeviceError when the network is gone.
        """
        if self._fd >= 0 and self._peer is None:
            return 0
        try:
            return self._socket.sendto(data, self._peer or ("", 0))
        except OSError as error:
            return self._refused(error)

    def _is_peer(self, sender: tuple[str, int]) -> bool:
        now = now_ns()
        if sender != self._peer and self._peer and now - self._heard_ns < SILENCE_S * NS_PER_S:
            return False
        self._peer, self._heard_ns = sender, now
        return True


def _datagrams(host: str, port: int, use: Callable[[socket.socket, Any], None]) -> socket.socket:
    """A datagram socket of the family of `host`, bound or connected there."""
    family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    opened = socket.socket(family, kind)
    try:
        use(opened, address)
    except OSError:
        opened.close()
        raise
    return opened


def _cannot_listen(scheme: str, host: str, port: int, error: OSError) -> DeviceError:
    return DeviceError(f"{scheme}://{host}:{port}: cannot listen: {error.strerror or error}; choose another address")

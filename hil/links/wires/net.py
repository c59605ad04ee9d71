"""TCP and UDP wires: the STM32's end listens, the host's end connects.

    TcpWire, TcpHostWire    a stream of bytes; each end detects within `PEER_TIMEOUT_S` that the other is lost
    UdpWire, UdpHostWire    datagrams, one a write; lost datagrams and lost peers are not detected

None blocks after it is open. Buffers are small (`BUFFER`), so that a slow reader never acts on old commands. There is
no password: anyone who can connect to an open port can command the thrusters, so the default `host` is this machine.
"""

import contextlib
import errno
import os
import select
import socket
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import DeviceError
from hil.links.contract import Wire
from hil.links.wires.terminal import READ_SIZE, DescriptorWire, queued_bytes

HERE = "127.0.0.1"
CONNECT_S = 2.0
PEER_TIMEOUT_S = 2.0  # for a peer that acknowledges nothing, for example with an unplugged cable
BUFFER = 16_384  # bytes; the kernel doubles it
SIOCOUTQ, SIOCOUTQNSD = 0x5411, 0x894B  # linux/sockios.h: numbers of unacknowledged and of unsent bytes
UNACKNOWLEDGED_NS = NS_PER_S // 10  # without progress; further data would arrive late and all at once
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
        """Close the socket. May be called twice."""
        self._fd = -1
        self._socket.close()


class _TcpStream(_SocketWire):
    """An established connection."""

    def __init__(self, opened: socket.socket, name: str) -> None:
        super().__init__(opened, name)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(PEER_TIMEOUT_S * 1000))
        self._written = self._acknowledged = 0  # bytes
        self._progress_ns = now_ns()

    def write(self, data: bytes) -> int:
        """Send `data`; return the number of bytes accepted. Raises DeviceError if the peer is lost."""
        taken = super().write(data)
        self._written += taken
        return taken

    def unsent(self) -> int:
        """Return the bytes that wait here, plus those in transit if the peer has acknowledged nothing for 0.1 s."""
        in_flight = queued_bytes(self._fd, SIOCOUTQ)
        acknowledged, now = self._written - in_flight, now_ns()
        if not in_flight or acknowledged != self._acknowledged:
            self._acknowledged, self._progress_ns = acknowledged, now
        return in_flight if now - self._progress_ns > UNACKNOWLEDGED_NS else queued_bytes(self._fd, SIOCOUTQNSD)

    def _lost_error(self, reason: str | None) -> DeviceError:
        if self._fd >= 0:
            with contextlib.suppress(OSError):  # the connection may be closed already
                self._socket.shutdown(socket.SHUT_RDWR)  # otherwise the first write after a hang-up would succeed
        return super()._lost_error(reason)


class TcpHostWire(_TcpStream):
    """Host end: connects to `host` and `port`. Raises DeviceError if no process listens there."""

    def __init__(self, host: str, port: int) -> None:
        name = f"tcp://{host}:{port}"
        try:
            opened = socket.create_connection((host, port), CONNECT_S)
        except OSError as error:
            raise DeviceError(f"{name}: {error.strerror or error}; start the end that listens first") from None
        super().__init__(opened, name)


class TcpWire(Wire):
    """Device end (STM32): listens on `host` and `port` (0: any free port) for one peer at a time.

    A second peer is rejected while the first is connected. Without a peer, written data are discarded. Raises
    DeviceError if the port is in use.
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
        self._epoll = select.epoll()  # one descriptor for new connections and for bytes
        self._epoll.register(self._listener, select.EPOLLIN)

    @property
    def connected(self) -> bool:
        """True if a peer is connected."""
        return self._peer is not None

    def fileno(self) -> int:
        """Return the descriptor to wait on for incoming bytes; -1 once closed."""
        return -1 if self._epoll.closed else self._epoll.fileno()

    def read(self) -> bytes:
        """Return the received bytes (4096 at most), or b"". Raises DeviceError only if this wire is closed."""
        return self._from_peer() or (self._from_peer() if self._accept() else b"")

    def write(self, data: bytes) -> int:
        """Send `data`; return the bytes accepted, 0 without a peer. Raises DeviceError only if this wire is closed."""
        self._check_open()
        if self._peer is None:
            return 0
        try:
            return self._peer.write(data)
        except DeviceError:
            self._disconnect()
            return 0

    def close(self) -> None:
        """Close the connection and the port. May be called twice."""
        self._disconnect()
        self._listener.close()
        self._epoll.close()

    def _from_peer(self) -> bytes:
        self._check_open()
        try:
            return self._peer.read() if self._peer else b""
        except DeviceError:
            self._disconnect()
            return b""

    def _accept(self) -> bool:
        """Accept a new connection, or reject it if there is a peer already; return whether there is a new peer."""
        try:
            caller, _ = self._listener.accept()
        except OSError:  # no connection is waiting, or it was closed meanwhile
            return False
        if self._peer:
            caller.close()
            return False
        self._peer = _TcpStream(caller, self.name)
        self._epoll.register(self._peer, select.EPOLLIN)
        return True

    def _disconnect(self) -> None:
        if self._peer:
            self._peer.close()  # also removes it from the epoll
            self._peer = None

    def _check_open(self) -> None:
        if self._epoll.closed:
            raise DeviceError(f"{self.name}: is closed; open it again")


class _UdpWire(_SocketWire):
    """Common part of both ends: reads all waiting datagrams."""

    def read(self) -> bytes:
        """Return the bytes of the received datagrams, or b"". Raises DeviceError when the network is lost."""
        datagrams: list[bytes] = []
        size = 0
        while size < READ_SIZE:
            try:
                datagram, sender = self._socket.recvfrom(MAX_DATAGRAM)
            except (BlockingIOError, ConnectionRefusedError):  # refused: nothing listened for our last datagram
                break
            except OSError as error:
                raise self._lost_error(error.strerror) from None
            if self._is_peer(sender):
                datagrams.append(datagram)
                size += len(datagram)
        return b"".join(datagrams)

    @abstractmethod
    def _is_peer(self, sender: tuple[str, int]) -> bool:
        """Return whether datagrams from `sender` are for this wire."""

    def _refused(self, error: OSError) -> int:
        """Return 0 (bytes accepted) if `error` means no room, no listener, or a too long datagram; else raise."""
        if error.errno in (errno.EAGAIN, errno.ENOBUFS, errno.ECONNREFUSED, errno.EMSGSIZE):
            return 0
        raise self._lost_error(error.strerror) from None


class UdpHostWire(_UdpWire):
    """Host end: sends to `host` and `port`, and receives only from there.

    It first sends an empty datagram, from which the other end learns its address. Raises DeviceError if the host does
    not exist.
    """

    def __init__(self, host: str, port: int) -> None:
        name = f"udp://{host}:{port}"
        try:
            opened = _datagrams(host, port, socket.socket.connect)
        except OSError as error:
            raise DeviceError(f"{name}: {error.strerror or error}; correct the address") from None
        super().__init__(opened, name)
        self.write(b"")

    def unsent(self) -> int:
        """Return the memory that the socket's queue takes, in bytes; 0 unless the network's own queue is full."""
        return queued_bytes(self._fd, SIOCOUTQ)

    def write(self, data: bytes) -> int:
        """Send `data` as one datagram; return its size, 0 if refused. Raises DeviceError without a network."""
        try:
            return os.write(self._fd, data)
        except OSError as error:
            return self._refused(error)

    def _is_peer(self, sender: tuple[str, int]) -> bool:
        return True  # the kernel has checked


class UdpWire(_UdpWire):
    """Device end (STM32): receives on `host` and `port` (0: any free port) and sends to the first peer.

    Datagrams of others are ignored until the peer has sent nothing for `PEER_TIMEOUT_S`. Raises DeviceError if the port
    is in use.
    """

    def __init__(self, host: str = HERE, port: int = 0) -> None:
        try:
            opened = _datagrams(host, port, socket.socket.bind)
        except OSError as error:
            raise _cannot_listen("udp", host, port, error) from None
        self.port: int = opened.getsockname()[1]
        super().__init__(opened, f"udp://{host}:{self.port}")
        self._peer: tuple[str, int] | None = None
        self._received_ns = 0

    def write(self, data: bytes) -> int:
        """Send `data` as one datagram; return its size, or 0 if it was refused or there is no peer yet.

        Raises DeviceError if the network is lost.
        """
        if self._fd >= 0 and self._peer is None:
            return 0
        try:
            return self._socket.sendto(data, self._peer or ("", 0))
        except OSError as error:
            return self._refused(error)

    def _is_peer(self, sender: tuple[str, int]) -> bool:
        now = now_ns()
        if sender != self._peer and self._peer and now - self._received_ns < PEER_TIMEOUT_S * NS_PER_S:
            return False
        self._peer, self._received_ns = sender, now
        return True


def _datagrams(host: str, port: int, use: Callable[[socket.socket, Any], None]) -> socket.socket:
    """Return a datagram socket for the address family of `host`, bound or connected to that address by `use`."""
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

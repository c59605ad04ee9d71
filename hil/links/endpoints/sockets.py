"""Endpoints on sockets, each with one or more partners.

None of them waits: what a partner does not take is dropped, as on a radio.
"""

import contextlib
import errno
import socket
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from ipaddress import ip_address
from typing import Any, cast

from hil.common.clock import NS_PER_S

READ_SIZE = 65_536
MAX_DATAGRAMS = 200  # of one turn
MAX_PARTNERS = 16
CONNECT_S = 5.0
HEARTBEATS_NS = 3 * NS_PER_S  # a partner silent for longer gives way to a new one
SILENT_NS = 30 * NS_PER_S  # after which a partner that only sent datagrams is forgotten
RETRY_NS = NS_PER_S

Address = Hashable
Received = list[tuple[Address, bytes]]


class Link(ABC):
    """One endpoint. `burst`: bytes of lists that it takes a turn (1/50 s); `refused`: who came beyond MAX_PARTNERS.

    The classes that wait for partners take `first`, the bytes that a partner's first data may begin with: one that
    begins otherwise, such as a web page, is refused.
    """

    name: str
    burst = 4_000  # of parameters a hundred packets: the socket of a ground station holds some 270
    refused = 0
    is_lost = False  # True: it has to be opened again

    @abstractmethod
    def descriptors(self) -> list[int]:
        """Return what to wait on."""

    @abstractmethod
    def receive(self, now: int) -> Received:
        """Return the bytes received, with the address of each sender."""

    @abstractmethod
    def send(self, address: Address, data: bytes) -> None:
        """Send a packet to a partner; `message` is what it contains, for endpoints that send that otherwise."""

    @abstractmethod
    def partners(self) -> list[Address]:
        """Return the present partners, also those that have sent nothing yet."""

    def is_local(self, address: Address) -> bool:
        """Return whether a partner is on this machine, or on a wire of it."""
        return isinstance(address, tuple) and _is_loopback(str(address[0]))

    def tick(self, now: int) -> None:  # noqa: B027  # most have nothing to do
        """Do what is due by time."""

    def set_baud(self, baud: int) -> None:  # noqa: B027  # only lines have a speed
        """Change the speed (bit/s) of a line once all that was sent has gone out."""

    @abstractmethod
    def close(self) -> None:
        """Close it."""


class _DatagramLink(Link):
    """An endpoint on a socket of its own, which `use` connects or binds to the address."""

    def __init__(self, host: str, port: int, use: Callable[[socket.socket, Any], None]) -> None:
        self._address: tuple[Any, ...]
        family, kind, _, _, self._address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        try:
            use(self._socket, self._address)
        except OSError:
            self._socket.close()
            raise

    def descriptors(self) -> list[int]:
        """Return the socket's."""
        return [self._socket.fileno()]

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class UdpOut(_DatagramLink):
    """Sends to one address, also of a broadcast, and receives only from there. Raises OSError.

    It is lost when this machine's own address has changed, and when a silent host given by name has another address.
    """

    def __init__(self, host: str, port: int) -> None:
        self.name = f"udpout:{host}:{port}"
        super().__init__(host, port, socket.socket.connect)
        self._named = (host, port) if self._address[0] != host else None
        self._received_ns = 0

    def receive(self, now: int) -> Received:
        """Return the datagrams that have come."""
        received: Received = []
        for _ in range(MAX_DATAGRAMS):
            try:
                received.append((self._address[:2], self._socket.recv(READ_SIZE)))
            except OSError:  # nothing more, or nobody was there for our last one
                break
        self._received_ns = now if received else self._received_ns or now
        return received

    def send(self, address: Address, data: bytes) -> None:
        """Send a datagram."""
        try:
            self._socket.send(data)
        except OSError as error:
            self.is_lost |= error.errno not in (errno.EAGAIN, errno.ENOBUFS, errno.ECONNREFUSED)

    def partners(self) -> list[Address]:
        """Return the address."""
        return [self._address[:2]]

    def tick(self, now: int) -> None:
        """Look up a silent host again, in a thread: the name server may not answer."""
        if self._named and now - (self._received_ns or now) > SILENT_NS:
            self._received_ns = now
            threading.Thread(target=self._look_up, daemon=True).start()

    def _look_up(self) -> None:
        assert self._named
        with contextlib.suppress(OSError):
            found = socket.getaddrinfo(*self._named, type=socket.SOCK_DGRAM)
            self.is_lost |= self._address not in [each[4] for each in found]


class UdpIn(_DatagramLink):
    """Receive from all senders, and send to each until it is silent for `silent_ns`. Raises OSError."""

    def __init__(self, host: str, port: int, first: bytes = b"", silent_ns: int = SILENT_NS) -> None:
        self.name, self._first, self._silent_ns = f"udpin:{host}:{port}", first, silent_ns
        super().__init__(host, port, socket.socket.bind)
        if self._socket.family == socket.AF_INET:  # datagrams to a group leave where those to us come in
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self._address[0]))
        self.port: int = self._socket.getsockname()[1]
        self._received_ns: dict[tuple[Any, ...], int] = {}

    def receive(self, now: int) -> Received:
        """Return the datagrams that have come."""
        received: Received = []
        for _ in range(MAX_DATAGRAMS):
            try:
                data, sender = self._socket.recvfrom(READ_SIZE)
            except OSError:
                break
            if sender not in self._received_ns:
                if not _may_begin(data, self._first):
                    continue
                if len(self._received_ns) >= MAX_PARTNERS and not self._remove_silent(now):
                    self.refused += 1
                    continue
            self._received_ns[sender] = now
            received.append((sender, data))
        return received

    def send(self, address: Address, data: bytes) -> None:
        """Send a datagram."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, cast(tuple[str, int], address))

    def partners(self) -> list[Address]:
        """Return the senders that are not silent."""
        return list(self._received_ns)

    def _remove_silent(self, now: int) -> bool:
        """Remove the partner that is silent for longest; False if all send heartbeats."""
        silent = min(self._received_ns, key=self._received_ns.__getitem__)
        if now - self._received_ns[silent] < HEARTBEATS_NS:
            return False
        del self._received_ns[silent]
        return True

    def tick(self, now: int) -> None:
        """Forget those that are silent."""
        for address, received_ns in list(self._received_ns.items()):
            if now - received_ns > self._silent_ns:
                del self._received_ns[address]


def _may_begin(data: bytes, first: bytes) -> bool:
    return not first or (bool(data) and data[0] in first)


class _Stream:
    """One TCP connection: what it does not take at once waits, up to a limit; beyond it is closed."""

    MAX_UNSENT = 1 << 18  # bytes

    def __init__(self, opened: socket.socket, now: int = 0, first: bytes = b"") -> None:
        opened.setblocking(False)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket = opened
        self.unsent = b""
        self.first = first  # until something has come
        self.is_open = True
        self.received_ns = now

    def receive(self, now: int) -> bytes:
        """Return the bytes that have come. A connection whose first byte begins no message is closed."""
        try:
            data = self.socket.recv(READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data or not _may_begin(data, self.first):
            self.close()
            return b""
        self.first, self.received_ns = b"", now
        return data

    def send(self, data: bytes) -> None:
        """Send bytes, and those that waited."""
        self.unsent += data
        try:
            self.unsent = self.unsent[self.socket.send(self.unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self.close()
        if len(self.unsent) > self.MAX_UNSENT:
            self.close()

    def close(self) -> None:
        """Close the connection."""
        self.is_open = False
        self.socket.close()


class TcpIn(Link):
    """Listens for several; one that has sent nothing for 30 s makes room. Raises OSError."""

    def __init__(self, host: str, port: int, first: bytes = b"") -> None:
        self.name, self._first = f"tcpin:{host}:{port}", first
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=family)
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._streams: dict[Address, _Stream] = {}

    def descriptors(self) -> list[int]:
        """Return the listener's and the connections'."""
        return [self._listener.fileno(), *[one.socket.fileno() for one in self._open().values()]]

    def receive(self, now: int) -> Received:
        """Return the bytes received, and accept new connections."""
        while True:
            try:
                opened, caller = self._listener.accept()
            except OSError:
                break
            if self._has_room(now):
                self._streams[caller] = _Stream(opened, now, self._first)
            else:
                self.refused += 1
                opened.close()
        received = [(address, stream.receive(now)) for address, stream in self._open().items()]
        return [(address, data) for address, data in received if data]

    def send(self, address: Address, data: bytes) -> None:
        """Send a packet over one connection."""
        stream = self._streams.get(address)
        if stream and stream.is_open:
            stream.send(data)

    def tick(self, now: int) -> None:
        """Send what connections did not take before."""
        for stream in self._open().values():
            if stream.unsent:
                stream.send(b"")

    def partners(self) -> list[Address]:
        """Return the connections."""
        return list(self._open())

    def close(self) -> None:
        """Close all."""
        for stream in self._streams.values():
            stream.close()
        self._listener.close()

    def _has_room(self, now: int) -> bool:
        """Return whether one more is served; of those that are silent for long, the longest silent one is closed."""
        if len(self._open()) < MAX_PARTNERS:
            return True
        longest = min(self._streams.values(), key=lambda stream: stream.received_ns)
        if now - longest.received_ns <= SILENT_NS:
            return False
        longest.close()
        return True

    def _open(self) -> dict[Address, _Stream]:
        if not all(stream.is_open for stream in self._streams.values()):
            self._streams = {address: stream for address, stream in self._streams.items() if stream.is_open}
        return self._streams


class TcpOut(Link):
    """A connection to one address. Raises OSError if nobody listens there; may wait for name server and host."""

    def __init__(self, host: str, port: int) -> None:
        self.name = f"tcpout:{host}:{port}"
        self._stream = _Stream(socket.create_connection((host, port), CONNECT_S))
        self._to: Address = self._stream.socket.getpeername()[:2]

    def descriptors(self) -> list[int]:
        """Return the connection's."""
        return [self._stream.socket.fileno()] if self._stream.is_open else []

    def receive(self, now: int) -> Received:
        """Return what has come."""
        data = self._stream.receive(now) if self._stream.is_open else b""
        self.is_lost = not self._stream.is_open
        return [(self._to, data)] if data else []

    def send(self, address: Address, data: bytes) -> None:
        """Send a packet."""
        if self._stream.is_open:
            self._stream.send(data)

    def partners(self) -> list[Address]:
        """Return the address while it is connected."""
        return [self._to] if self._stream.is_open else []

    def close(self) -> None:
        """Close the connection."""
        self._stream.close()


def _is_loopback(host: str) -> bool:
    with contextlib.suppress(ValueError):
        address = ip_address(host.partition("%")[0])
        mapped = getattr(address, "ipv4_mapped", None)
        return (mapped or address).is_loopback
    return False

"""A driver's end of one wire: it asks as a driver does, and keeps what comes with the time of its arrival."""

import socket
import struct
import time
import urllib.error
import urllib.request
from contextlib import suppress
from ipaddress import ip_address
from typing import NamedTuple

from hil.common.clock import NEVER_NS, NS_PER_S, now_ns
from hil.common.errors import DeviceError, NetworkError
from hil.scenario.instrument_records import WireAddress

READ_SIZE = 65_536
PATIENCE_S = 10.0
HERE = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}


def ping_request(number: int, payload: bytes = b"") -> bytes:
    """Return a message of the ping protocol."""
    data = b"BR" + struct.pack("<HHBB", len(payload), number, 0, 0) + payload
    return data + struct.pack("<H", sum(data) & 0xFFFF)


class Ask(NamedTuple):
    """What a driver sends every `period_s`, or the path that it reads, so that the instrument answers.

    `group`: the multicast address at which it gets datagrams, once `body` was posted to the path `post`.
    """

    data: bytes = b""
    period_s: float = 1.0
    path: str = "/"
    group: tuple[str, int] = ("", 0)
    post: str = ""
    body: bytes = b""


_ECHO_SOUNDER = Ask(ping_request(1400, struct.pack("<H", 1300)))  # profiles, one after another
# mode, gain, angle, pulse 32 us, sample period 80 ticks, 740 kHz, 600 samples, transmit
_MULTICAST = b'{"mode":"multicast","unicast_destination_ip":"","unicast_destination_port":0}'
_SCAN = ping_request(2601, struct.pack("<BBHHHHHBB", 1, 0, 200, 32, 80, 740, 600, 1, 0))
# start, length and gain of its choice, 100 ms, its choice of the pulse, profiles
_PARAMETERS = struct.pack("<IIhhHHHBB", 0, 0, -1, 100, 0, 1308, 0, 0, 0)
ASKS = {
    "cerulean_s500": Ask(ping_request(1015, _PARAMETERS)),
    "keller_33x": Ask(bytes((250, 3, 0, 2, 0, 2, 0x70, 0x40)), 0.2),  # MODBUS: the pressure
    "paroscientific_digiquartz": Ask(b"*0100P3\r\n", 0.2),
    "ping1d": _ECHO_SOUNDER,
    "ping2": _ECHO_SOUNDER,
    "ping360": Ask(_SCAN, 0.25),
    "teledyne_pathfinder": Ask(b"CS\r", 1.0),
    "waterlinked_sonar_3d": Ask(
        path="/api/v1/integration/about", group=("224.0.0.96", 4747), post="/api/v1/integration/udp", body=_MULTICAST
    ),
    "waterlinked_ugps": Ask(path="/api/v1/position/acoustic/filtered"),
}


class Reader:
    """The other end of the wire at `address`. `total` bytes have come; `arrivals` are (monotonic ns, total by then).

    Raises NetworkError, DeviceError.
    """

    def __init__(self, address: WireAddress, ask: Ask) -> None:
        self._ask, self.address = ask, address
        self.data = bytearray()
        self.arrivals: list[tuple[int, int]] = []
        self._due_ns = now_ns()
        self._wire, self._socket = None, None
        host = HERE.get(address.target, address.target)
        if address.kind == "pty":
            from hil.links.wires.terminal import PtyHostWire

            self._wire = PtyHostWire(address.target)
        elif ask.group[0] and address.kind == "udp":
            self._socket = _listening(*ask.group, host)
        elif address.kind in ("tcp", "udp"):
            kind = socket.SOCK_STREAM if address.kind == "tcp" else socket.SOCK_DGRAM
            self._socket = _connected(host, address.port, kind)
        else:
            self._socket = _listening(host, address.port)

    def fileno(self) -> int:
        """Return what to wait on."""
        return self._wire.fileno() if self._wire else self._socket.fileno() if self._socket else -1

    def ask(self, now: int) -> int:
        """Send what is due; return when (ns) the next is."""
        if self.address.kind == "udpout" or self._ask.group[0]:
            return NEVER_NS
        if now < self._due_ns:
            return self._due_ns
        is_partner = bool(self.arrivals) or self.address.kind != "udp"
        data = self._ask.data or (b"" if is_partner else b"\n")
        self.send(data)
        self._due_ns = now + round(self._ask.period_s * NS_PER_S) if data else NEVER_NS
        return self._due_ns

    def send(self, data: bytes) -> None:
        """Send bytes, as far as the wire takes them."""
        if self._wire and data:
            self._wire.write(data)
        elif self._socket and data:
            with suppress(OSError):
                self._socket.send(data)

    def read(self) -> None:
        """Take what has come. Raises NetworkError when the instrument closes the connection."""
        try:
            data = self._wire.read() if self._wire else self._socket.recv(READ_SIZE) if self._socket else b""
        except (BlockingIOError, ConnectionRefusedError):
            return
        if not data and not self._wire:
            raise NetworkError(f"{self.address.kind}:{self.address.target}: the instrument closed the connection")
        self.data += data
        self.arrivals.append((now_ns(), len(self.data)))

    def close(self) -> None:
        """Close it."""
        for end in (self._wire, self._socket):
            if end:
                end.close()


def fetch(address: WireAddress, path: str, posted: bytes | None = None) -> tuple[float, int, bytes]:
    """Return the time (s) of a request of HTTP, which posts a body if that is given, its status and its body.

    Raises NetworkError.
    """
    host = HERE.get(address.target, address.target)
    began = time.monotonic()
    try:
        with urllib.request.urlopen(f"http://{host}:{address.port}{path}", posted, PATIENCE_S) as answer:
            return time.monotonic() - began, answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return time.monotonic() - began, error.code, error.read()
    except OSError as error:
        raise NetworkError(f"http:{address.target}:{address.port}: {error}; does it run?") from None


def reader_of(address: WireAddress, ask: Ask) -> Reader:
    """Return the reader of an instrument's wire as soon as there is one. Raises NetworkError, DeviceError."""
    deadline = now_ns() + round(PATIENCE_S * NS_PER_S)
    while True:
        try:
            return Reader(address, ask)
        except (OSError, DeviceError) as error:
            if now_ns() > deadline:
                raise NetworkError(f"{address.kind}:{address.target}: {error}; does it run?") from None
            time.sleep(0.05)


def _connected(host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    opened = socket.socket(family, kind)
    try:
        opened.connect((host, port))
    except OSError:
        opened.close()
        raise
    opened.setblocking(False)
    return opened


def _listening(host: str, port: int, interface: str = "0.0.0.0") -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    is_group = ip_address(host).is_multicast
    opened.bind(("" if is_group else host, port))
    if is_group:
        members = socket.inet_aton(host) + socket.inet_aton(interface)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, members)
    opened.setblocking(False)
    return opened

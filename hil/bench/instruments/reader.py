"""A driver's end of one wire: it asks as a driver does, and keeps what comes with the time of its arrival."""

import struct
import time
import urllib.request
from collections.abc import Callable
from typing import NamedTuple, TypeVar, cast

from hil.common.clock import NEVER_NS, NS_PER_S, now_ns
from hil.common.errors import HilError, NetworkError
from hil.links.endpoints.lines import LineLink
from hil.links.endpoints.sockets import Link, TcpOut, UdpIn, UdpOut
from hil.links.frame.checksums import SUMS
from hil.scenario.instrument_records import WireAddress

PATIENCE_S = 10.0
HERE = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}
Result = TypeVar("Result")


def ping_request(number: int, layout: str, *values: int) -> bytes:
    """Return a message of the ping protocol."""
    payload = struct.pack(f"<{layout}", *values)
    data = b"BR" + struct.pack("<HHBB", len(payload), number, 0, 0) + payload
    return data + struct.pack("<H", SUMS["sum16"].of(data))


class Ask(NamedTuple):
    """What a driver sends every `period_s`, or the path that it reads by HTTP, so that the instrument answers.

    With a path `post` it gets datagrams, once it has posted there `body`, in which %d is the port where it listens.
    """

    data: bytes = b""
    period_s: float = 1.0
    path: str = "/"
    post: str = ""
    body: bytes = b""

    def only_listens(self, address: WireAddress) -> bool:
        """Return whether a driver sends nothing there, so that it has to be there before the first datagram."""
        return address.kind == "udpout" or (address.kind == "udp" and bool(self.post))


_ECHO_SOUNDER = Ask(ping_request(1400, "H", 1300))  # profiles, one after another
ASKS = {
    # start, length and gain of its choice, 100 ms, its choice of the pulse, profiles
    "cerulean_s500": Ask(ping_request(1015, "IIhhHHHBB", 0, 0, -1, 100, 0, 1308, 0, 0, 0)),
    "keller_33x": Ask(bytes((250, 3, 0, 2, 0, 2, 0x70, 0x40)), 0.2),  # MODBUS: the pressure
    "network_camera": Ask(path="/?action=snapshot", period_s=0.2),
    "paroscientific_digiquartz": Ask(b"*0100P3\r\n", 0.2),
    "ping1d": _ECHO_SOUNDER,
    "ping2": _ECHO_SOUNDER,
    # mode, gain, angle, pulse 32 us, sample period 80 ticks, 740 kHz, 600 samples, transmit
    "ping360": Ask(ping_request(2601, "BBHHHHHBB", 1, 0, 200, 32, 80, 740, 600, 1, 0), 0.25),
    "teledyne_pathfinder": Ask(b"CS\r", 1.0),
    "waterlinked_sonar_3d": Ask(
        path="/api/v1/integration/about", post="/api/v1/integration/udp",
        body=b'{"mode":"unicast","unicast_destination_ip":"127.0.0.1","unicast_destination_port":%d}',
    ),
    "waterlinked_ugps": Ask(path="/api/v1/position/acoustic/filtered", period_s=0.1),
}  # fmt: skip


class Reader:
    """The other end of the wire at `address`. `data` has come; `arrivals` are (monotonic ns, bytes by then).

    `asked` are the instants (monotonic ns) of what was sent. Raises OSError, DeviceError.
    """

    def __init__(self, address: WireAddress, ask: Ask) -> None:
        self._ask, self.address = ask, address
        self.data = bytearray()
        self.arrivals: list[tuple[int, int]] = []
        self.asked: list[int] = []
        self._due_ns = NEVER_NS if ask.only_listens(address) else now_ns()
        self._link = _link(address, ask)

    def fileno(self) -> int:
        """Return what to wait on. Raises NetworkError when the connection is closed."""
        if not self._link.descriptors():
            self.read()
        return self._link.descriptors()[0]

    def ask(self, now: int) -> int:
        """Send what is due; return when (ns) the next is."""
        if now >= self._due_ns:
            self.asked.append(now)
            is_unknown = self.address.kind == "udp" and not self.arrivals
            data = self._ask.data or (b"\n" if is_unknown else b"")
            if self.address.kind == "http":
                data = f"GET {self._ask.path} HTTP/1.1\r\nHost: {_host(self.address)}\r\n\r\n".encode()
            self.send(data)
            self._due_ns = now + round(self._ask.period_s * NS_PER_S) if data else NEVER_NS
        return self._due_ns

    def send(self, data: bytes) -> None:
        """Send bytes, as far as the wire takes them."""
        if data:
            self._link.send(None, data)

    @property
    def port(self) -> int:
        """The port where it listens."""
        return cast(UdpIn, self._link).port

    def read(self) -> None:
        """Take what has come. Raises NetworkError when the instrument closes the connection."""
        for _, data in self._link.receive(now_ns()):
            self.data += data
            self.arrivals.append((now_ns(), len(self.data)))
        if self._link.is_lost:
            raise NetworkError(f"{self.address.kind}:{self.address.target}: the instrument closed the connection")

    def close(self) -> None:
        """Close it."""
        self._link.close()


def _link(address: WireAddress, ask: Ask) -> Link:
    if address.kind == "pty":
        from hil.links.wires.terminal import PtyHostWire  # needs a system with terminals

        return LineLink(address.target, PtyHostWire(address.target), address.port)
    if ask.only_listens(address):
        return UdpIn(_host(address), 0 if ask.post else address.port)
    return UdpOut(_host(address), address.port) if address.kind == "udp" else TcpOut(_host(address), address.port)


def _host(address: WireAddress) -> str:
    return HERE.get(address.target, address.target)


def post(address: WireAddress, path: str, body: bytes) -> None:
    """Post a body by HTTP. Raises OSError."""
    urllib.request.urlopen(f"http://{_host(address)}:{address.port}{path}", body, PATIENCE_S).close()


def wait_for(address: WireAddress, use: Callable[[], Result]) -> Result:
    """Return what `use` returns as soon as the wire at the address is there. Raises NetworkError."""
    deadline_ns = now_ns() + round(PATIENCE_S * NS_PER_S)
    while True:
        try:
            return use()
        except (OSError, HilError) as error:
            if now_ns() > deadline_ns:
                raise NetworkError(f"{address.kind}:{address.target}: {error}; does it run?") from None
            time.sleep(0.05)

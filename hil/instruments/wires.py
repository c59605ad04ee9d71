"""The wires of one instrument: which clients are there, what they send, and bytes to them.

Each request of HTTP comes in a thread of its own.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import cast
from urllib.parse import parse_qsl, urlsplit

from hil.common.clock import NS_PER_S
from hil.common.errors import NetworkError
from hil.common.web.plain_server import PlainHandler, PlainHttpServer
from hil.instruments.contract import Client, Instrument, Response, WireKind
from hil.links.endpoints.patient import open_endpoint
from hil.links.endpoints.sockets import Link
from hil.scenario.instrument_records import WireAddress

ENDPOINTS = {"tcp": "tcpin", "udp": "udpin", "udpout": "udpout", "serial": "serial", "pty": "pty"}
LARGEST = 1 << 20  # bytes of a request
# method, path, query, body -> answer; None: the device is silent
Serve = Callable[[str, str, dict[str, str], bytes], Response | None]
SILENT_NS = 600 * NS_PER_S  # after which a partner by datagrams is forgotten: many only listen once they have begun


class Wires:
    """The wires at `addresses` for an instrument of the class `kind`. Raises NetworkError for a port in use.

    `report` gets a line about a wire that is waited for; `serve` answers requests of HTTP, in threads of their own.
    """

    def __init__(
        self, addresses: tuple[WireAddress, ...], kind: type[Instrument], report: Callable[[str], None], serve: Serve
    ) -> None:
        self._links: list[tuple[int, WireKind, Link]] = []
        self._clients: dict[Client, Link] = {}
        self.names = [f"{at}:{target}:{port}" for at, target, port in addresses]
        with ExitStack() as stack:
            for number, (at, target, port) in enumerate(addresses):
                if at == "http":
                    stack.callback(serve_web(target, port, serve).stop)
                else:
                    opened = open_endpoint(ENDPOINTS[at], target, port, report, kind.first, SILENT_NS, kind.automatic)
                    stack.callback(opened.close)
                    self._links.append((number, cast(WireKind, at), opened))
            self.close = stack.pop_all().close

    def descriptors(self) -> list[int]:
        """Return what to wait on."""
        return [fd for _, _, link in self._links for fd in link.descriptors()]

    def receive(self, now_ns: int) -> Iterator[tuple[Client, bytes | None]]:
        """Yield what has come, in its order: b"" of a client that is new, None of one that has gone."""
        present: set[Client] = set()
        for number, kind, link in self._links:
            link.tick(now_ns)
            received = link.receive(now_ns)
            partners = link.partners()
            present |= {Client(number, kind, address) for address in partners}
            for address, data in [*received, *[(address, b"") for address in partners]]:
                client = Client(number, kind, address)
                if client not in self._clients:
                    self._clients[client] = link
                    yield client, b""
                if data:
                    yield client, data
        for client in self._clients.keys() - present:
            del self._clients[client]
            yield client, None

    def clients(self) -> list[Client]:
        """Return who is there."""
        return list(self._clients)

    def set_baud(self, baud: int) -> None:
        """Change the speed of all lines."""
        for _, _, link in self._links:
            link.set_baud(baud)

    def send(self, client: Client, data: bytes) -> None:
        """Send bytes to a client that may have gone, or to one of `contract.datagrams_to`."""
        link = self._clients.get(client)
        if client.wire < 0:
            link = next((link for _, kind, link in self._links if kind == client.kind), None)
        if link:
            link.send(client.address, data)


def serve_web(host: str, port: int, serve: Serve) -> PlainHttpServer:
    """Serve HTTP, until that is stopped; `serve` gets each request. Raises NetworkError if the port is in use."""

    class Handler(PlainHandler):
        """Passes each request on."""

        protocol_version = "HTTP/1.1"  # as Go's server in the devices: clients send many requests over one connection
        wbufsize = 1 << 16  # head and body leave together; a body of its own would wait for the head's acknowledgement

        def do_any(self) -> None:
            """Answer a request as the instrument does; an instrument that is silent closes the connection."""
            if not self.server.is_serving:  # the power that this connection had is gone
                self.close_connection = True
                return
            length = self.headers.get("Content-Length", "0")
            if not length.isdecimal() or int(length) > LARGEST:
                self.send_error(413)
                return
            parts = urlsplit(self.path)
            body = self.rfile.read(int(length))
            response = serve(self.command, parts.path, dict(parse_qsl(parts.query)), body)
            if response is None:
                self.close_connection = True
                return
            self.send_response(response.status)
            self.send_header("Content-Type", response.content_type)
            if response.stream is None:
                self.send_header("Content-Length", str(len(response.body)))
                self.end_headers()
                self.wfile.write(response.body)
                return
            self.close_connection = True  # its end is that of the stream
            self.send_header("Connection", "close")
            self.end_headers()
            for piece in response.stream:
                self.wfile.write(piece)
                self.wfile.flush()

        do_GET = do_PUT = do_POST = do_DELETE = do_PATCH = do_any  # noqa: N815 - http.server's names

    try:
        server = PlainHttpServer("instrument", (host, port), Handler)
    except OSError as error:
        raise NetworkError(f"http:{host}:{port}: {error.strerror}; choose another address") from None
    server.start()
    return server

"""The wires of one instrument: which clients are there, what they send, and bytes to them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import NamedTuple, cast

from hil.common.clock import NS_PER_S
from hil.instruments.contract import Client, Instrument, WireKind
from hil.instruments.web import Serve, serve_web
from hil.links.endpoints.patient import open_endpoint
from hil.links.endpoints.sockets import Link
from hil.scenario.instrument_records import WireAddress

ENDPOINTS = {"tcp": "tcpin", "udp": "udpin", "udpout": "udpout", "serial": "serial", "pty": "pty"}
SILENT_NS = 600 * NS_PER_S  # after which a partner by datagrams is forgotten: many only listen once they have begun


class Received(NamedTuple):
    """What a client has done: b"" of one that is new, None of one that has gone."""

    client: Client
    data: bytes | None


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

    def receive(self, now_ns: int) -> Iterator[Received]:
        """Yield what has come, in its order, and who has come and gone."""
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
                    yield Received(client, b"")
                if data:
                    yield Received(client, data)
        for client in self._clients.keys() - present:
            del self._clients[client]
            yield Received(client, None)

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

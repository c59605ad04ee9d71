"""The wires of one instrument: which clients are there, what they send, and bytes to them."""

from collections.abc import Callable, Iterator
from typing import NamedTuple, cast

from hil.common.clock import NS_PER_S
from hil.instruments.contract import Client, Instrument, WireKind
from hil.instruments.web import Serve, WebWire
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
        self,
        addresses: tuple[WireAddress, ...],
        kind: type[Instrument],
        report: Callable[[str], None],
        serve: Serve,
    ) -> None:
        self._links: list[tuple[int, WireKind, Link]] = []
        self._web: list[WebWire] = []
        self._clients: dict[Client, Link] = {}
        self.names: list[str] = []
        try:
            for number, (at, target, port) in enumerate(addresses):
                if at == "http":
                    self._web.append(WebWire((target, port), serve))
                else:
                    opened = open_endpoint(ENDPOINTS[at], target, port, report, kind.first, SILENT_NS)
                    self._links.append((number, cast(WireKind, at), opened))
                self.names.append(f"{at}:{target}:{port}")
        except BaseException:
            self.close()
            raise

    def descriptors(self) -> list[int]:
        """Return what to wait on."""
        return [fd for _, _, link in self._links for fd in link.descriptors()]

    def receive(self, now_ns: int) -> Iterator[Received]:
        """Yield what has come, in its order, and who has come and gone."""
        present: dict[Client, Link] = {}
        for number, kind, link in self._links:
            link.tick(now_ns)
            for address, data in link.receive(now_ns):
                client = Client(number, kind, address)
                yield from self._greet(client, link)
                yield Received(client, data)
            present |= {Client(number, kind, address): link for address in link.partners()}
        for client, link in present.items():
            yield from self._greet(client, link)
        for client in [client for client in self._clients if client not in present]:
            del self._clients[client]
            yield Received(client, None)

    def discard(self, now_ns: int) -> None:
        """Lose what has come."""
        for _ in self.receive(now_ns):
            pass

    def clients(self, kind: str = "") -> list[Client]:
        """Return who is there, on wires of one kind if that is given."""
        return [client for client in self._clients if not kind or client.kind == kind]

    def send(self, client: Client, data: bytes) -> None:
        """Send bytes to a client that may have gone, or to one of `contract.datagrams_to`."""
        link = self._clients.get(client)
        if client.wire < 0:
            link = next((link for _, kind, link in self._links if kind == client.kind), None)
        if link:
            link.send(client.address, data)

    def close(self) -> None:
        """Close all wires."""
        for _, _, link in self._links:
            link.close()
        for web in self._web:
            web.close()

    def _greet(self, client: Client, link: Link) -> Iterator[Received]:
        if client not in self._clients:
            self._clients[client] = link
            yield Received(client, b"")

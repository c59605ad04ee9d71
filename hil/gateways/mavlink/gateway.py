"""The gateway's loop: endpoints in, the vehicle's commands and messages out."""

import select
from collections.abc import Callable, Hashable, Sequence
from contextlib import ExitStack

from hil.common.clock import NS_PER_S, now_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.gateways.mavlink.core import Core
from hil.gateways.mavlink.dispatch import Dispatcher
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.peer import Peer
from hil.gateways.mavlink.protocols.ftp import FtpServer
from hil.gateways.mavlink.protocols.signing import SigningKey
from hil.gateways.mavlink.snapshot import Origin
from hil.gateways.mavlink.vehicle_port import NetworkVehicle
from hil.links.endpoints.patient import open_endpoint
from hil.links.endpoints.sockets import MAX_PARTNERS, SILENT_NS, Link
from hil.scenario.mavlink_records import Mavlink, parse_endpoint

TICK_NS = NS_PER_S // 50
MARKERS = b"\xfd\xfe"  # that a MAVLink packet begins with
STALL_NS = NS_PER_S // 2  # after which sticks and targets that have come meanwhile are too old to be executed

Clock = Callable[[], int]


def open_link(text: str, report: Callable[[str], None]) -> Link:
    """Return an endpoint that opens, now or as soon as it can. Raises NetworkError if it cannot by waiting."""
    endpoint = parse_endpoint(text)
    try:
        return open_endpoint(endpoint.kind, endpoint.target, endpoint.port, report, MARKERS)
    except NetworkError as error:
        raise NetworkError(f"{error}: an ArduSub may listen there too") from None


class Gateway:
    """One MAVLink vehicle on its endpoints. `report` gets a line for each new peer. Closes port and links.

    `motors` are thruster and direction of each motor of the frame (`Core`).
    """

    def __init__(
        self,
        port: NetworkVehicle,
        settings: Mavlink,
        table: ParameterTable,
        links: Sequence[Link],
        origin: Origin | None = None,
        report: Callable[[str], None] = lambda _: None,
        signing: SigningKey | None = None,
        clock: Clock = now_ns,
        wall_clock: Clock = lambda: to_wall_ns(now_ns()),
        motors: Sequence[tuple[int, int]] = (),
    ) -> None:
        self._settings, self._links, self._report = settings, links, report
        self._clock, self._wall_clock = clock, wall_clock
        self.core = Core(port, settings, table, origin, clock(), motors)
        self.dispatcher = Dispatcher(self.core, FtpServer(settings.logs, table))
        self._signing = signing or SigningKey(given=settings.signing_key)
        self._peers: dict[tuple[int, Hashable], Peer] = {}
        self._numbers = self._complaint_ns = 0
        self._due_ns = self._polled_ns = clock()

    def run(self, stop_fd: int) -> None:
        """Serve until `stop_fd` becomes readable; the vehicle is then stopped if it was armed here."""
        with ExitStack() as stack:
            stack.callback(self.close)
            while True:
                wait = max(0.0, (self._due_ns - self._clock()) / NS_PER_S)
                descriptors = [stop_fd, *[fd for link in self._links for fd in link.descriptors()]]
                ready = select.select(descriptors, (), (), wait)[0]
                if stop_fd in ready:
                    return
                self.poll()

    def poll(self) -> None:
        """Read what has come, and do what is due."""
        now = self._clock()
        self.dispatcher.stale = now - self._polled_ns > STALL_NS
        self._polled_ns = now
        for number, link in enumerate(self._links):
            for address, data in link.receive(now):
                peer = self._peer(number, link, address)
                peer.received_ns = now
                for packet in peer.unpack(data):
                    self.dispatcher.handle(peer, packet, now)
        if now >= self._due_ns:
            self._due_ns = max(self._due_ns + TICK_NS, now)
            self._update_partners(now)
            self.core.tick(now)
            self.dispatcher.tick(now, self._wall_clock())

    def close(self) -> None:
        """Stop the vehicle if it was armed here, and close all endpoints."""
        if self.core.pilot.armed:
            self.core.disarm()
            self.core.tick(self._clock() + NS_PER_S)
        self._signing.stamps.close()
        for link in self._links:
            link.close()

    def _update_partners(self, now: int) -> None:
        """Add new partners, and remove those that have disconnected."""
        present = set()
        for number, link in enumerate(self._links):
            link.tick(now)
            if link.refused and now >= self._complaint_ns:
                self._report(
                    f"{link.name}: {MAX_PARTNERS} ground stations are served; {link.refused} packets and calls of "
                    f"others were refused; one that is silent for {SILENT_NS // NS_PER_S} s makes room"
                )
                link.refused, self._complaint_ns = 0, now + SILENT_NS
            for address in link.partners():
                present.add((number, address))
                self._peer(number, link, address)
        for key in [key for key in self._peers if key not in present]:
            peer = self._peers.pop(key)
            self.dispatcher.peers.pop(peer.number, None)
            self._report(f"disconnected: {peer.name}")

    def _peer(self, number: int, link: Link, address: Hashable) -> Peer:
        peer = self._peers.get((number, address))
        if peer is None:
            settings = self._settings
            self._numbers += 1
            is_local = link.is_local(address)
            may_command = settings.commands_from == "network" or is_local
            name = ":".join(map(str, address[:2])) if isinstance(address, tuple) else str(address)
            peer = self._peers[number, address] = Peer(
                self._numbers, name, settings.system, lambda data, _: link.send(address, data),
                may_command, link.burst, self._signing, self._wall_clock,
            )  # fmt: skip
            self.dispatcher.peers[peer.number] = peer
            self._report(f"{link.name}: sends to {name}{'' if may_command else ' (can only read)'}")
        return peer

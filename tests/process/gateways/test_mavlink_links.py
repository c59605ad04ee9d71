"""Endpoints of the MAVLink vehicle: UDP and TCP peers."""

import socket
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.gateways.mavlink.endpoints.opening import MARKERS, open_link
from hil.links.endpoints.patient import PatientLink
from hil.links.endpoints.sockets import HEARTBEATS_NS, MAX_PARTNERS, SILENT_NS, Link, TcpIn, UdpIn, UdpOut
from hil.links.wires.terminal import PtyWire
from hil.scenario.mavlink_records import MavlinkEndpoint
from tests.support.processes import PATIENCE_S, free_port, wait_for

BEAT = dialect.MAVLink_heartbeat_message(12, 3, 0, 19, 3, 3)
PACKET: bytes = BEAT.pack(dialect.MAVLink(None, 1, 1))


def test_udp_partners_are_served_until_they_time_out() -> None:
    link = UdpIn("127.0.0.1", 0, MARKERS)
    clients = [UdpOut("127.0.0.1", link.port) for _ in range(2)]
    try:
        for end in clients:
            end.send(end.partners()[0], PACKET)
        assert wait_for(lambda: (link.receive(NS_PER_S) and len(link.partners()) == 2) or None)
        assert all(link.is_local(partner) for partner in link.partners())
        assert not link.is_local(("192.0.2.1", 14550))
        link.send(link.partners()[0], PACKET)
        assert wait_for(lambda: clients[0].receive(0) or None) == [(clients[0].partners()[0], PACKET)]
        link.tick(100 * NS_PER_S)
        assert link.partners() == []
    finally:
        for one in (link, *clients):
            one.close()


def test_a_sender_of_noise_is_no_partner() -> None:
    link = UdpIn("127.0.0.1", 0, MARKERS)
    noise = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    noise.sendto(b"GET / HTTP/1.1", ("127.0.0.1", link.port))
    time.sleep(0.1)
    assert link.receive(0) == []
    assert link.partners() == []
    noise.close()
    link.close()


def test_partners_beyond_the_limit_are_refused_and_counted() -> None:
    """The connected peers stay connected."""
    datagrams, stream = UdpIn("127.0.0.1", 0), TcpIn("127.0.0.1", 0, MARKERS)
    clients = [UdpOut("127.0.0.1", datagrams.port) for _ in range(MAX_PARTNERS + 2)]
    links: list[socket.socket] = []
    try:
        for end in clients:
            end.send(end.partners()[0], PACKET)
            assert wait_for(lambda: datagrams.receive(0) or datagrams.refused or None)
        for _ in range(MAX_PARTNERS + 2):
            links.append(socket.create_connection(("127.0.0.1", stream.port), PATIENCE_S))
            assert wait_for(lambda: stream.receive(0) or len(stream.partners()) + stream.refused == len(links) or None)
        assert (len(datagrams.partners()), len(stream.partners())) == (MAX_PARTNERS, MAX_PARTNERS)
        assert wait_for(lambda: datagrams.receive(0) or (datagrams.refused, stream.refused) == (2, 2) or None)
        first, later = datagrams.partners()[0], HEARTBEATS_NS + 1
        for end in clients[1:MAX_PARTNERS]:
            end.send(end.partners()[0], PACKET)
            assert wait_for(lambda: datagrams.receive(later) or None)
        clients[-1].send(clients[-1].partners()[0], PACKET)
        assert wait_for(lambda: datagrams.receive(later) or first not in datagrams.partners() or None)
        assert len(datagrams.partners()) == MAX_PARTNERS, "the longest silent one has made room"
    finally:
        for end in clients:
            end.close()
        for call in links:
            call.close()
        datagrams.close()
        stream.close()


def test_a_silent_tcp_connection_makes_room_for_another() -> None:
    """One that sends stays, however long the others are there."""
    stream, now = TcpIn("127.0.0.1", 0), 0
    calls: list[socket.socket] = []
    try:
        calls += [socket.create_connection(("127.0.0.1", stream.port), PATIENCE_S) for _ in range(MAX_PARTNERS)]
        assert wait_for(lambda: stream.receive(now) or len(stream.partners()) == MAX_PARTNERS or None)
        now = SILENT_NS + 1
        calls[0].sendall(PACKET)
        assert wait_for(lambda: stream.receive(now) or None)
        calls.append(socket.create_connection(("127.0.0.1", stream.port), PATIENCE_S))
        assert wait_for(lambda: stream.receive(now) or calls[-1].getsockname() in stream.partners() or None)
        assert calls[0].getsockname() in stream.partners()
        assert (len(stream.partners()), stream.refused) == (MAX_PARTNERS, 0)
    finally:
        for call in calls:
            call.close()
        stream.close()


def test_a_lost_tcp_connection_is_made_again() -> None:
    port, lines = free_port(), list[str]()
    client = open_link(MavlinkEndpoint("tcpout", "127.0.0.1", port), lines.append)
    assert not client.partners()
    for _ in range(2):
        assert _exchange_packet(client, port), "a packet comes through"
        assert wait_for(lambda: client.receive(0) or not client.partners() or None), "and its end is seen"
    client.close()
    name = f"tcpout:127.0.0.1:{port}"
    assert lines[:2] == [f"{name}: waiting for it: Connection refused", f"{name}: is open"]


class _Network:
    """A resolver and addresses of this machine that a test changes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.answers: dict[str, str] = {}
        self.is_silent = False
        self._resolve = socket.getaddrinfo
        monkeypatch.setattr(socket, "getaddrinfo", self.look_up)

    def look_up(self, host: str, port: int, **options: Any) -> Any:
        while self.is_silent and host.endswith(".test"):
            time.sleep(0.01)
        if host.endswith(".test") and host not in self.answers:
            raise socket.gaierror(-2, "Name or service not known")
        return self._resolve(self.answers.get(host, host), port, **options)


def test_a_ground_station_is_found_when_its_name_and_our_network_come_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """A name server that does not answer delays no other endpoint; a station that moves is found again."""
    network, lines = _Network(monkeypatch), list[str]()
    stations = [UdpIn(host, 0) for host in ("127.0.0.1", "127.0.0.2")]
    network.is_silent = True
    began = time.monotonic()
    link = open_link(MavlinkEndpoint("udpout", "station.test", stations[0].port), lines.append)
    assert time.monotonic() - began < 5.0
    other = open_link(MavlinkEndpoint("udpout", "127.0.0.1", stations[0].port), lines.append)
    link.tick(now_ns())
    assert lines == [f"{link.name}: waiting for it: no answer yet"]
    assert other.partners()
    network.is_silent = False
    now = now_ns()

    def partners_later() -> list[Any]:
        nonlocal now
        now += NS_PER_S
        link.receive(now)
        return _ticked(link, now).partners()

    network.answers["station.test"] = "127.0.0.1"
    assert wait_for(lambda: partners_later() == [("127.0.0.1", stations[0].port)])
    assert lines[1:] == [f"{link.name}: is open"]
    network.answers["station.test"] = "127.0.0.2"
    assert wait_for(lambda: partners_later() == [("127.0.0.2", stations[0].port)])
    for each in (link, other, *stations):
        each.close()


def test_an_endpoint_is_opened_again_when_our_own_address_has_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    station, lines = UdpIn("127.0.0.1", 0), list[str]()
    link = open_link(MavlinkEndpoint("udpout", "127.0.0.1", station.port), lines.append)
    assert isinstance(link, PatientLink)
    inner: Any = link._link
    inner._socket.close()  # as the kernel refuses to send from an address that is gone
    link.send(link.partners()[0], PACKET)
    now = now_ns()
    assert wait_for(lambda: _ticked(link, now) and link._link not in (None, inner))
    link.send(link.partners()[0], PACKET)
    assert wait_for(lambda: station.receive(0) or None)
    link.close()
    station.close()


def test_a_device_that_is_not_there_yet_is_waited_for(tmp_path: Path) -> None:
    lines: list[str] = []
    device = tmp_path / "ttyUSB0"
    link = open_link(MavlinkEndpoint("serial", str(device), 57_600), lines.append)
    assert link.partners() == []
    assert "no such device" in lines[0]
    terminal = PtyWire()
    device.symlink_to(terminal.path)
    assert wait_for(lambda: _ticked(link, now_ns()).partners())
    link.send(link.partners()[0], PACKET)
    assert wait_for(lambda: terminal.read() or None) == PACKET
    terminal.close()
    assert wait_for(lambda: link.receive(0) or not _ticked(link, now_ns()).partners())
    link.close()


def _ticked(link: Link, now: int) -> Link:
    link.tick(now)
    return link


def _exchange_packet(client: Link, port: int) -> bool:
    """Return True if a packet reaches a peer, which then closes its connection."""
    server = TcpIn("127.0.0.1", port)

    def connect() -> Any:
        client.tick(now_ns())
        server.receive(0)
        return client.partners() and server.partners()

    assert wait_for(connect)
    client.send(client.partners()[0], PACKET)
    received = wait_for(lambda: server.receive(0) or None)
    server.close()
    return bool(received)


def test_a_port_in_use_is_named_in_the_error() -> None:
    link = TcpIn("127.0.0.1", 0, MARKERS)
    with pytest.raises(NetworkError, match=f"tcpin:127.0.0.1:{link.port}.*ArduSub"):
        open_link(MavlinkEndpoint("tcpin", "127.0.0.1", link.port), print)
    link.close()

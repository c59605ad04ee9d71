"""Endpoints of the MAVLink vehicle: UDP and TCP peers."""

import socket
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S, now_ns
from hil.gateways.mavlink.gateway import open_link
from hil.links.endpoints.patient import PatientLink
from hil.links.endpoints.sockets import Link, UdpIn
from hil.links.wires.terminal import PtyWire
from tests.support.processes import wait_for

BEAT = dialect.MAVLink_heartbeat_message(12, 3, 0, 19, 3, 3)
PACKET: bytes = BEAT.pack(dialect.MAVLink(None, 1, 1))


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
    link = open_link(f"udpout:station.test:{stations[0].port}", lines.append)
    assert time.monotonic() - began < 5.0
    other = open_link(f"udpout:127.0.0.1:{stations[0].port}", lines.append)
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
    link = open_link(f"udpout:127.0.0.1:{station.port}", lines.append)
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
    link = open_link(f"serial:{device}", lines.append)
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

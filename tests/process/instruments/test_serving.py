"""Instruments in their processes, as drivers see them: started by the slave, checked, without power and cable."""

import json
import os
import socket
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path

import pytest

from hil.common.ports import free_ports
from hil.instruments.contract import Response
from hil.instruments.wires import serve_web
from tests.support.processes import (
    PATIENCE_S,
    Program,
    children_of,
    command_line,
    is_running,
    run_here,
    running_slave,
    wait_for,
)


def lines_of(port: int) -> socket.SocketIO:
    """Return the lines that a DVL sends over TCP."""
    with socket.create_connection(("127.0.0.1", port)) as opened:
        return opened.makefile("rwb", buffering=0)


def test_a_slave_starts_its_instruments_and_ends_them_and_none_without(tmp_path: Path) -> None:
    port = free_ports(1)[0]
    keys = (
        f'[sensors.dvl]\nrate = 15\ninstrument = "waterlinked_a50"\nat = ["tcp:127.0.0.1:{port}", "pty:{tmp_path}/dvl"]'
    )
    with running_slave(tmp_path, keys) as (slave, _):
        slave.expect("dvl: waterlinked_a50 at")
        [instruments] = [pid for pid in children_of(slave.process.pid) if "instruments" in command_line(pid)]
        drivers = [lines_of(port), lines_of(port)]
        for driver in drivers:
            kinds = {json.loads(driver.readline())["type"] for _ in range(40)}
            assert kinds == {"velocity", "position_local"}
        drivers[0].write(b'{"command": "get_config"}\n')
        assert any(b'"response_to":"get_config"' in drivers[0].readline() for _ in range(40))
        assert os.readlink(tmp_path / "dvl").startswith("/dev/pts/")
        for driver in drivers:
            driver.close()
        assert slave.stop(15) == 0
        assert "Traceback" not in slave.output
    assert wait_for(lambda: not is_running(instruments))
    assert not (tmp_path / "dvl").is_symlink()
    with running_slave(tmp_path) as (slave, _):
        slave.expect("scheduling")
        assert not [pid for pid in children_of(slave.process.pid) if "instruments" in command_line(pid)]


def test_a_check_reads_every_wire_of_the_desk_and_of_two_3d_sonars(tmp_path: Path) -> None:
    """The wires of the preset, and of two instruments that send to where they are told, at ports that are free here."""
    at = {"dvl": ["tcp"], "echosounder": ["udp"], "scanning_sonar": ["udp"], "usbl": ["http"]}
    at |= {"sonar_1": ["http", "udp"], "sonar_2": ["http", "udp"]}
    ports = iter(free_ports(8))
    changes = [f"sensors.sonar_{n}={{sensor='laser',rate=2,instrument='waterlinked_sonar_3d'}}" for n in (1, 2)]
    for name, kinds in at.items():
        changes.append(f"sensors.{name}.at={[f'{kind}:127.0.0.1:{next(ports)}' for kind in kinds]}")
    words = [word for change in changes for word in ("--set", change)]
    with Program(tmp_path, "instruments", "check", "bluerov2_desk", "--seconds", "3", "--json", *words) as check:
        assert check.wait() == 0, check.output
        wires = json.loads(check.output)
    assert len(wires) == 8
    seen = {wire["sensor"]: wire for wire in wires}  # of the sonars the wire of UDP, which is their last
    assert {message["kind"] for message in seen["dvl"]["messages"]} == {"velocity", "position_local"}
    for name in ("dvl", "echosounder", "scanning_sonar", "sonar_1", "sonar_2"):
        assert seen[name]["messages"][0]["number"] > 1
        assert sum(message["bad"] for message in seen[name]["messages"]) == 0
    for name in ("dvl", "usbl"):
        assert 0.0 < seen[name]["delay_p50_ms"] <= seen[name]["delay_p99_ms"]
        assert seen[name]["measurements"] > 10
    assert seen["dvl"]["own_ms"] == 4.0


def test_a_connection_of_http_is_kept_open_until_the_power_is_off() -> None:
    [port] = free_ports(1)
    server = serve_web("127.0.0.1", port, lambda *_: Response(b"{}"))
    with closing(HTTPConnection("127.0.0.1", port, PATIENCE_S)) as client:
        for _ in range(2):
            client.request("GET", "/")
            assert client.getresponse().read() == b"{}"
        opened = client.sock
        server.stop()
        client.request("GET", "/")
        assert client.sock is opened
        with pytest.raises(ConnectionError):
            client.getresponse()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("sensors.dvl.instrument='waterlinked_a5'", "did you mean 'waterlinked_a50'"),
        ("sensors.imu.instrument='waterlinked_a50'", "is no imu: it is for dvl"),
        ("sensors.dvl.at='http:127.0.0.1:80'", "has no http: it has tcp, serial, pty"),
        ("sensors.dvl.at='tcp:127.0.0.1'", "is not a wire; there are tcp:HOST:PORT"),
        ("sensors.dvl.settings={range_mode='=9'}", "expected auto, =a, a<=b or wt"),
        ("sensors.dvl.settings={speed='3'}", "no key 'speed'"),
        ("sensors.dvl.faults={drop=2}", "drop: 2 is outside 0 to 1"),
        ("sensors.dvl.rate=0", "an instrument needs samples"),
        ("sensors.dvl.at=['pty:/tmp/a', 'pty:/tmp/a']", "listed twice"),
        ("sensors.dvl_2={sensor='dvl', instrument='waterlinked_a125'}", "dvl stands there too"),
    ],
)
def test_a_wrong_key_of_an_instrument_is_refused_with_a_remedy(change: str, message: str) -> None:
    words = ("--set", "sensors.dvl.instrument='waterlinked_a50'", "--set", change)
    code, output = run_here("scenario", "check", "paper_field", *words)
    assert (code, message in output) == (2, True), output


def test_a_scenario_without_an_instrument_is_refused_with_a_remedy() -> None:
    code, output = run_here("instruments", "paper_field")
    assert code == 2
    assert 'add instrument = "waterlinked_a50" to [sensors.dvl]' in output

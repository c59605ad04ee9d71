"""The JSON gateway: queries, commands and samples of a real vehicle, malformed lines, and the token."""

import json
import os
import signal
import socket
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from hil.client.fleet import Fleet
from hil.gateways.access import Access, token_path
from hil.gateways.json_lines.requests import COMMANDS, SERVICES
from hil.gateways.json_lines.server import JsonGateway
from tests.support.clients.json_client import Client, client, fleet, gateway, own_state
from tests.support.processes import ROOT, Program, free_port, wait_for

__all__ = ["client", "fleet", "gateway", "own_state"]  # the fixtures


def test_queries_and_commands_are_answered(client: Client, fleet: Fleet) -> None:
    assert client.call(id=7, do="vehicles") == {"id": 7, "ok": True, "vehicles": ["uuv1"]}
    state = client.call(id="a", vehicle="uuv1", do="get", sensor="state")
    assert state["id"] == "a"
    assert wait_for(lambda: 0 <= client.call(vehicle="uuv1", do="get", sensor="state")["age"] < 0.3)
    north, east, depth = state["sample"]["position"]
    assert depth == state["sample"]["depth"]
    assert client.call(do="drive", surge=0.3, depth=depth)["ok"]
    assert wait_for(lambda: fleet["uuv1"].state.velocity[0] > 0.15)
    assert client.call(do="go_to", north=north + 0.5, east=east, depth=depth)["ok"]
    assert wait_for(lambda: client.call(do="status")["done"])
    assert client.call(do="follow", path=[north, east, depth], speed=0.5, lookahead=0.8, tolerance=0.5)["ok"]
    assert client.call(do="status") == {"id": None, "ok": True, "done": False, "over": False, "error": ""}
    assert client.call(do="thrust", newtons=[-5, -5, -5, -5, 0, 0])["ok"]
    assert wait_for(lambda: fleet["uuv1"].state.velocity[0] < -0.05)
    client.socket.close()
    client._lines.close()
    assert wait_for(lambda: abs(fleet["uuv1"].state.velocity[0]) < 0.05), "it stops with the connection"


def test_subscribed_samples_are_sent_at_their_rate(client: Client) -> None:
    assert client.call(do="subscribe", sensor="imu", rate=20)["ok"]
    assert client.call(do="subscribe", sensor="state", rate=5)["ok"]
    times: dict[str, list[int]] = {"imu": [], "odom": []}
    while len(times["imu"]) < 20:
        message = client.read()
        assert message["vehicle"] == "uuv1"
        times[message["sensor"]].append(message["sample"]["time_ns"])
    assert (times["imu"][-1] - times["imu"][0]) / 19 > 0.85 * 50e6, "no faster than requested"
    assert 3 <= len(times["odom"]) <= 7
    client.call(do="unsubscribe", sensor="imu")
    client.samples.clear()
    for _ in range(3):
        client.samples.append(client.read())
    assert {message["sensor"] for message in client.samples[-2:]} == {"odom"}


WRONG_LINES: list[tuple[bytes, str]] = [
    (b"[1]", "an object"),
    (b"{}", "drive"),
    (b'{"do": "drvie"}', "did you mean 'drive'"),
    (b'{"do": "close"}', "none of"),
    (b'{"do": "__class__"}', "none of"),
    (b'{"do": "drive", "surge": "fast"}', "'fast' is not a number"),
    (b'{"do": "drive", "surge": NaN}', "surge: nan"),
    (b'{"do": "drive", "surge": true}', "not a number"),
    (b'{"do": "drive", "surge": 1' + b"0" * 400 + b"}", "surge: 1000"),
    (b'{"id": ' + b"[" * 600 + b"]" * 600 + b', "do": "vehicles"}', "id: expected a text or a number"),
    (b'{"do": "drive", "sruge": 1}', "did you mean 'surge'"),
    (b'{"do": "go_to", "north": 1}', "also needs east, depth"),
    (b'{"do": "follow"}', "array of points"),
    (b'{"do": "follow", "path": "/etc/passwd"}', "array of points"),
    (b'{"do": "follow", "path": [[1, 2]]}', "(north, east, depth)"),
    (b'{"do": "follow", "path": [[1, 2, 3]], "limits": 1}', "no 'limits'"),
    (b'{"do": "follow", "path": [[1e5, 2, 3]], "smooth": true}', "longer than 10000 m"),
    (b'{"do": "thrust", "newtons": [1, 2]}', "6 thrusters"),
    (b'{"do": "get", "sensor": "sonarr"}', "no topic"),
    (b'{"do": "get", "sensor": "camera/image_raw"}', "has sent no 'camera/image_raw'"),
    (b'{"do": "set_pose", "north": 1}', "also needs east, depth"),
    (b'{"do": "set_pose", "north": 1, "east": 1, "depth": "deep"}', "'deep' is not a number"),
    (b'{"do": "set_pose", "north": 4, "east": 4, "depth": 90}', "an obstacle or the seabed of pool is there"),
    (b'{"do": "arm", "on": 1}', "expected true or false"),
    (b'{"do": "fail", "thruster": 1}', "expected a text"),
    (b'{"do": "fail", "thruster": "front_rihgt"}', "did you mean 'failures.front_right'"),
    (b'{"do": "fail", "thruster": "front_right", "kind": "of"}', "did you mean 'off'"),
    (b'{"do": "fail", "thruster": "front_right", "value": 1}', "'off' has none"),
    (b'{"do": "fail", "thruster": "front_right", "kind": "efficiency", "value": 7}', "efficiency"),
    (b'{"do": "reset", "north": 1}', "no 'north'"),
    (b'{"do": "subscribe", "sensor": "imu", "rate": 0}', "rate"),
    (b'{"do": "subscribe", "sensor": "imu", "rate": 1e9}', "rate"),
    (b'{"do": "subscribe", "sensor": "imu", "rate": 1e-320}', "rate"),
]


def test_wrong_requests_get_an_error(client: Client) -> None:
    for line, message in WRONG_LINES:
        answer = client.send(line)
        assert not answer["ok"], line
        assert message in answer["error"], line
        assert client.call(do="vehicles")["ok"], "and the connection goes on"


POST = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99\r\n\r\n"


@pytest.mark.parametrize("line", [b"hello", b"", b"\xff\xfe", b"[" * 50_000, POST + b'{"do": "drive", "surge": 1}'])
def test_a_line_that_is_not_json_ends_the_connection(client: Client, fleet: Fleet, line: bytes) -> None:
    """Lines behind a header of HTTP are not executed, even after a login."""
    client.socket.sendall(line + b'\n{"do": "drive", "surge": 0.5}\n')
    answer = client.read()
    assert not answer["ok"]
    assert "not a line of JSON" in answer["error"]
    with suppress(ConnectionResetError):
        assert client._lines.readline() == b""
    assert fleet["uuv1"]._action is None or fleet["uuv1"].state.velocity[0] < 0.05


WRONG_TOKENS: tuple[Any, ...] = ("\ud800", "\xff", "", 7, None, ["a"], {})


@pytest.mark.parametrize("login", [{}, *[{"token": token} for token in WRONG_TOKENS]])
def test_commands_need_the_token(gateway: JsonGateway, login: dict[str, Any]) -> None:
    client = Client(gateway)
    with client:
        if login:
            assert "not the token" in client.call(do="login", **login)["error"]
        for what in (*COMMANDS, *SERVICES):
            reply = client.call(do=what)
            assert not reply["ok"]
            assert '"do": "login"' in reply["error"]
            assert gateway.access.path in reply["error"]
        assert client.call(do="get")["ok"], "everybody may look"
        assert client.call(do="login", token=gateway.access.token)["ok"]
        assert client.call(do="stop")["ok"]


def test_the_token_is_new_private_and_removed(tmp_path: Path) -> None:
    (tmp_path / "uuv-hil").mkdir()
    target = tmp_path / "somebody's"
    target.write_text("precious")
    os.symlink(target, token_path(7450))
    first = Access(7450)
    assert first.path == token_path(7450)
    assert target.read_text() == "precious", "a link is replaced, not followed"
    assert os.stat(first.path).st_mode & 0o777 == 0o600
    assert Path(first.path).read_text().strip() == first.token
    second = Access(7450)
    assert second.token != first.token
    assert not second.admits(first.token)
    first.close()
    assert Path(second.path).exists(), "the file of the next one stays"
    second.close()
    assert not Path(second.path).exists()


def test_nan_is_sent_as_null(client: Client) -> None:
    sample = client.call(do="get", sensor="diagnostics")
    assert sample["sample"]["thrusters"] == 6
    raw = json.dumps(sample)
    assert "NaN" not in raw


def test_the_command_serves_json(fleet: Fleet, tmp_path: Path) -> None:
    port, endpoint = free_port(), fleet.endpoints[0]
    with Program(tmp_path, "gateway", "json", "--connect", endpoint, "--listen", f"127.0.0.1:{port}") as program:
        program.expect(f"lines of JSON at 127.0.0.1:{port}")
        program.expect(f"(in {token_path(port)})")
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.sendall(b'{"do": "vehicles"}\n')
            assert b"uuv1" in connection.recv(1000)
            assert program.stop(signal.SIGINT) == 0
        assert "Traceback" not in program.output
    with Program(tmp_path, "gateway", "json", "--matlab") as program:
        assert program.wait() == 0
        assert os.path.samefile(program.output.strip(), ROOT / "hil" / "gateways" / "matlab")

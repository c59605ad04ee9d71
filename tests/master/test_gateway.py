"""Lines of JSON: what a stranger's program sees of a real vehicle, and what it cannot break; and Octave as one."""

import json
import os
import shutil
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import hil
from hil.errors import NetworkError
from hil.master.fleet import Fleet
from hil.master.gateway import LONGEST_LINE, SOCKET_OPTIONS, Gateway, _Client
from hil.master.vehicle_handle import Vehicle
from tests.processes import ROOT, Program, free_port, wait_for, write_scenario

MATLAB = ROOT / "hil" / "master" / "matlab"
Message = dict[str, Any]


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    folder = tmp_path_factory.mktemp("slave")
    scenario, port = write_scenario(folder)
    with Program(folder, "slave", scenario) as slave:
        slave.expect("ready")
        with hil.connect(f"tcp/127.0.0.1:{port}") as fleet:
            yield fleet


@pytest.fixture
def gateway(fleet: Fleet) -> Iterator[Gateway]:
    with Gateway(fleet, "127.0.0.1", 0) as gateway:
        yield gateway


class Stranger:
    """A program with a socket."""

    def __init__(self, gateway: Gateway) -> None:
        self.socket = socket.create_connection(("127.0.0.1", gateway.port), timeout=5)
        self._lines = self.socket.makefile("rb")
        self.samples: list[Message] = []

    def read(self) -> Message:
        message: Message = json.loads(self._lines.readline())
        return message

    def send(self, line: bytes) -> Message:
        """A line, and its answer; samples that come in between are kept."""
        self.socket.sendall(line + b"\n")
        while "ok" not in (message := self.read()):
            self.samples.append(message)
        return message

    def ask(self, **request: object) -> Message:
        return self.send(json.dumps(request).encode())


@pytest.fixture
def stranger(gateway: Gateway) -> Iterator[Stranger]:
    stranger = Stranger(gateway)
    with stranger.socket:
        yield stranger


def test_questions_and_commands(stranger: Stranger, fleet: Fleet) -> None:
    assert stranger.ask(id=7, do="vehicles") == {"id": 7, "ok": True, "vehicles": ["uuv1"]}
    state = stranger.ask(id="a", vehicle="uuv1", do="get", sensor="state")
    assert state["id"] == "a"
    assert 0 <= state["age"] < 0.3
    north, east, depth = state["sample"]["position"]
    assert depth == state["sample"]["depth"]
    assert stranger.ask(do="drive", surge=0.3, depth=depth)["ok"]
    assert wait_for(lambda: fleet["uuv1"].state.velocity[0] > 0.15, 4)
    assert stranger.ask(do="go_to", north=north + 0.5, east=east, depth=depth)["ok"]
    assert wait_for(lambda: stranger.ask(do="status")["done"], 12)
    assert stranger.ask(do="follow", way=[north, east, depth], speed=0.5, lookahead=0.8, tolerance=0.5)["ok"]
    assert stranger.ask(do="status") == {"id": None, "ok": True, "done": False, "over": False, "error": ""}
    assert stranger.ask(do="thrust", newtons=[-5, -5, -5, -5, 0, 0])["ok"]
    assert wait_for(lambda: fleet["uuv1"].state.velocity[0] < -0.05, 4)
    stranger.socket.close()
    stranger._lines.close()
    assert wait_for(lambda: abs(fleet["uuv1"].state.velocity[0]) < 0.05, 4), "it stops with the connection"


def test_samples_come_by_themselves(stranger: Stranger) -> None:
    assert stranger.ask(do="subscribe", sensor="imu", rate=20)["ok"]
    assert stranger.ask(do="subscribe", sensor="state", rate=5)["ok"]
    times: dict[str, list[int]] = {"imu": [], "odom": []}
    while len(times["imu"]) < 20:
        message = stranger.read()
        assert message["vehicle"] == "uuv1"
        times[message["sensor"]].append(message["sample"]["time_ns"])
    assert (times["imu"][-1] - times["imu"][0]) / 19 == pytest.approx(50e6, rel=0.15)
    assert 3 <= len(times["odom"]) <= 7
    stranger.ask(do="unsubscribe", sensor="imu")
    stranger.samples.clear()
    for _ in range(3):
        stranger.samples.append(stranger.read())
    assert {message["sensor"] for message in stranger.samples[-2:]} == {"odom"}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"hello", "not a line of JSON"),
        (b"", "not a line of JSON"),
        (b"[1]", "an object"),
        (b"\xff\xfe", "not a line of JSON"),
        (b"[" * 50_000, "not a line of JSON"),
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
        (b'{"do": "follow", "way": "/etc/passwd"}', "array of points"),
        (b'{"do": "follow", "way": [[1, 2]]}', "(north, east, depth)"),
        (b'{"do": "follow", "way": [[1, 2, 3]], "limits": 1}', "no 'limits'"),
        (b'{"do": "follow", "way": [[1e5, 2, 3]], "smooth": true}', "longer than 10000 m"),
        (b'{"do": "thrust", "newtons": [1, 2]}', "6 thrusters"),
        (b'{"do": "get", "sensor": "sonarr"}', "no topic"),
        (b'{"do": "get", "sensor": "camera/image_raw"}', "pictures"),
        (b'{"do": "subscribe", "sensor": "imu", "rate": 0}', "rate"),
        (b'{"do": "subscribe", "sensor": "imu", "rate": 1e9}', "rate"),
        (b'{"do": "subscribe", "sensor": "imu", "rate": 1e-320}', "rate"),
    ],
)
def test_nonsense_is_answered(stranger: Stranger, line: bytes, words: str) -> None:
    answer = stranger.send(line)
    assert not answer["ok"]
    assert words in answer["error"]
    assert stranger.ask(do="vehicles")["ok"], "and the connection goes on"


@pytest.mark.parametrize("size", [LONGEST_LINE, LONGEST_LINE + 1, 3 * LONGEST_LINE - 1, 3 * LONGEST_LINE])
def test_a_line_that_is_too_long_is_answered_once(stranger: Stranger, size: int) -> None:
    """`size` bytes and the newline; the next line is understood."""
    answer = stranger.send(b" " * (size - 2) + b"{}")
    assert (answer["ok"], answer["error"]) == (False, "a line of more than 65536 bytes; send several")
    assert stranger.ask(id=1, do="vehicles")["id"] == 1


def test_the_longest_line_is_understood(stranger: Stranger) -> None:
    request = b'{"do": "vehicles"}'
    assert stranger.send(b" " * (LONGEST_LINE - 1 - len(request)) + request)["ok"]


def test_what_nobody_foresaw_is_answered_too(stranger: Stranger, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Vehicle, "release", lambda _: 1 / 0)
    answer = stranger.ask(id=3, do="release")
    monkeypatch.undo()
    assert answer == {"id": 3, "ok": False, "error": "ZeroDivisionError: division by zero"}
    assert stranger.ask(do="vehicles")["ok"], "and the connection goes on"


def test_a_vehicle_is_stopped_whatever_ended_the_connection(
    stranger: Stranger, fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also one that was told nothing but nonsense; and one that cannot be told to stop is told nothing more."""
    stopped: list[Vehicle] = []

    def stop(vehicle: Vehicle) -> None:
        stopped.append(vehicle)
        raise NetworkError("gone")

    assert stranger.ask(do="drive")["ok"]
    assert fleet["uuv1"]._maneuver
    monkeypatch.setattr(Vehicle, "stop", stop)
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    monkeypatch.setattr(_Client, "_say", lambda *_: 1 / 0)
    stranger.socket.sendall(b"{}\n")
    assert wait_for(lambda: bool(stopped) and fleet["uuv1"]._maneuver is None, 4)
    assert stopped == [fleet["uuv1"]]


def test_a_connection_is_watched(gateway: Gateway, stranger: Stranger) -> None:
    """The kernel's part of it; tests/transport/netns lets a machine vanish."""
    assert stranger.ask(do="vehicles")["ok"]
    assert wait_for(lambda: bool(gateway._clients), 4)
    (client,) = gateway._clients
    for level, option, value in SOCKET_OPTIONS:
        assert client._connection.getsockopt(level, option) == value
    assert client.alive


def test_what_is_no_number_is_null(stranger: Stranger) -> None:
    sample = stranger.ask(do="get", sensor="diagnostics")
    assert sample["sample"]["thrusters"] == "6"
    raw = json.dumps(sample)
    assert "NaN" not in raw


def test_the_place_may_be_taken(gateway: Gateway, fleet: Fleet) -> None:
    with pytest.raises(NetworkError, match=f"127.0.0.1:{gateway.port}.*in use"):
        Gateway(fleet, "127.0.0.1", gateway.port)


def test_the_command(fleet: Fleet, tmp_path: Path) -> None:
    port, endpoint = free_port(), fleet._endpoints[0]
    with Program(tmp_path, "gateway", "--connect", endpoint, "--listen", f"127.0.0.1:{port}") as program:
        program.expect(f"lines of JSON at 127.0.0.1:{port}")
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.sendall(b'{"do": "vehicles"}\n')
            assert b"uuv1" in connection.recv(1000)
            assert program.stop(signal.SIGINT) == 0
        assert "Traceback" not in program.output
    with Program(tmp_path, "gateway", "--matlab") as program:
        assert program.wait() == 0
        assert os.path.samefile(program.output.strip(), MATLAB)
    with Program(tmp_path, "gateway") as program:
        assert program.wait() == 2
        assert "--connect" in program.output


OCTAVE = """
addpath('{folder}');
uuv = uuv_hil('127.0.0.1', {port});
names = uuv.vehicles();
state = uuv.get('uuv1', 'state');
here = state.position;
uuv.tell('uuv1', 'go_to', 'north', here(1) + 0.4, 'east', here(2), 'depth', here(3), 'heading', state.heading);
uuv.wait('uuv1', 20);
uuv.subscribe('uuv1', 'imu', 50);
count = 0;
while count < 25
  message = uuv.next(2);
  count = count + strcmp(message.sensor, 'imu');
end
uuv.tell('uuv1', 'follow', 'way', [here(1) here(2) here(3)], 'speed', 0.5, 'lookahead', 0.8, 'tolerance', 0.5);
uuv.tell('uuv1', 'thrust', 'newtons', [1 1 1 1 0 0]);
try
  uuv.tell('uuv1', 'drive', 'surge', 1000);
  said = 'nothing';
catch problem
  said = problem.message;
end
uuv.tell('uuv1', 'stop');
after = uuv.get('uuv1', 'state');
uuv.close();
printf('%s|%d|%.3f|%.3f|%s\\n', names{{1}}, count, here(1), after.position(1), said);
"""


@pytest.mark.skipif(not shutil.which("octave-cli"), reason="GNU Octave is not installed: apt install octave")
def test_octave_flies(gateway: Gateway) -> None:
    script = OCTAVE.format(folder=MATLAB, port=gateway.port)
    done = subprocess.run(
        ["octave-cli", "--norc", "--quiet", "--eval", script], capture_output=True, text=True, timeout=60
    )
    name, count, before, after, said = done.stdout.strip().split("|")
    assert (name, count) == ("uuv1", "25"), done.stderr
    assert float(after) - float(before) == pytest.approx(0.4, abs=0.4)
    assert "surge: 1000 is not between -20 and 20 m/s" in said

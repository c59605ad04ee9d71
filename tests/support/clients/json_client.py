"""A JSON gateway to a real slave, and a client of it."""

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import hil
from hil.client.fleet import Fleet
from hil.gateways.json_lines.server import JsonGateway
from tests.support.processes import Program, slave_with, wait_for, write_scenario

Message = dict[str, Any]

SEEING = """
[sensors.camera]
rate = "5 Hz"
width = 64
height = 48
[sensors.forward_sonar]
rate = "5 Hz"
[sensors.laser]
rate = "10 Hz"
beams = 91
[ros]
images = "{images}"
"""


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    folder = tmp_path_factory.mktemp("slave")
    scenario, port = write_scenario(folder)
    with Program(folder, "slave", scenario) as slave:
        slave.expect("ready")
        with hil.connect(f"tcp/127.0.0.1:{port}") as fleet:
            fleet.wait_for("uuv1")  # longer than a connection does by itself: the machine may be busy
            yield fleet


@contextmanager
def seeing_vehicle(folder: Path, images: str) -> Iterator[Fleet]:
    """Provide a fleet of a slave with camera, sonar and laser that sends pictures; `images` as in `[ros] images`."""
    with slave_with(folder, SEEING.format(images=images)) as endpoint, hil.connect(endpoint) as fleet:
        fleet.wait_for("uuv1")
        wait_for_pictures(fleet)
        yield fleet


@pytest.fixture(scope="module", name="fleet")
def seeing_fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    with seeing_vehicle(tmp_path_factory.mktemp("slave"), "raw") as fleet:
        yield fleet


@pytest.fixture(autouse=True)
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


@pytest.fixture
def gateway(fleet: Fleet) -> Iterator[JsonGateway]:
    with JsonGateway(fleet, "127.0.0.1", 0) as gateway:
        yield gateway


def wait_for_pictures(fleet: Fleet) -> None:
    """Wait until the imaging process has started, which may take long on a busy machine."""
    vehicle = fleet["uuv1"]
    assert wait_for(lambda: any(topic.startswith("camera/") for topic in vehicle.pictures()), 200.0)


class Client:
    """A client of the gateway with its socket."""

    def __init__(self, gateway: JsonGateway) -> None:
        self.socket = socket.create_connection(("127.0.0.1", gateway.port), timeout=60)
        self._lines = self.socket.makefile("rb")
        self.samples: list[Message] = []

    def close(self) -> None:
        self._lines.close()
        self.socket.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def read(self) -> Message:
        message: Message = json.loads(self._lines.readline())
        return message

    def send(self, line: bytes) -> Message:
        """Send a line and return its answer; samples that come in between are stored."""
        self.socket.sendall(line + b"\n")
        while "ok" not in (message := self.read()):
            self.samples.append(message)
        return message

    def call(self, **request: object) -> Message:
        return self.send(json.dumps(request).encode())


@pytest.fixture
def client(gateway: JsonGateway) -> Iterator[Client]:
    client = Client(gateway)
    with client:
        assert client.call(do="login", token=gateway.access.token)["ok"]
        yield client

"""Commands to a slave whose pictures are more than the network carries."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.autonomy.control import VelocityCommand
from hil.master.client import VehicleClient
from tests.processes import Program, wait_for, write_scenario
from tests.relay import Relay

CAMERA = """
[ros]
images = "raw"
[sensors.camera]
rate = 10
"""
BYTES_PER_S = 1e6  # the pictures are 2.3 MB a second
SECONDS = 4.0


@pytest.fixture
def client(tmp_path: Path) -> Iterator[VehicleClient]:
    scenario, port = write_scenario(tmp_path, top=CAMERA)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with Relay(port, BYTES_PER_S) as relay, VehicleClient(relay.endpoint, "uuv1") as client:
            assert client.wait_for_vehicle(10.0)
            yield client


def test_commands_do_not_wait_behind_them(client: VehicleClient) -> None:
    client.watch("camera/image_raw")
    assert wait_for(lambda: client.received["camera/image_raw"], 15), "the first one takes its time to begin"
    before = client.received["camera/image_raw"]
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        client.command(VelocityCommand(surge=0.1))
        time.sleep(0.05)
    delays = sorted(client.delays.totals_ns())
    assert len(delays) > 60
    assert delays[len(delays) * 9 // 10] < 15e6
    assert client.received["camera/image_raw"] > before + 5, "as many as it carries"

"""Commands to a slave whose pictures exceed the capacity of the network."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from tests.support.busy import retry_when_busy
from tests.support.processes import Program, wait_for, write_scenario
from tools.faults.relay import Relay

CAMERA = """
[ros]
images = "raw"
[sensors.camera]
rate = 10
"""
BYTES_PER_S = 1e6  # the pictures are 2.3 MB a second
BEHIND_ONE_S = 0.23  # a command that waits for one picture to pass
COMMANDS = 80


@pytest.fixture
def client(tmp_path: Path) -> Iterator[VehicleClient]:
    scenario, port = write_scenario(tmp_path, top=CAMERA)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with Relay(port, BYTES_PER_S) as relay, VehicleClient(relay.endpoint, "uuv1") as client:
            assert client.wait_for_vehicle(60)
            yield client


def p90_s(client: VehicleClient) -> float:
    """Return the delay that nine in ten of the next commands do not exceed."""
    before = len(client.delays)
    while len(client.delays) < before + COMMANDS:
        client.command(VelocityCommand(surge=0.1))
        time.sleep(0.05)
    return sorted(client.delays.totals_ns()[-COMMANDS:])[COMMANDS * 9 // 10] / 1e9


def test_commands_do_not_wait_behind_pictures(client: VehicleClient) -> None:
    alone = p90_s(client)
    client.watch("camera/image_raw")
    assert wait_for(lambda: client.received["camera/image_raw"]), "the first one takes its time to begin"

    def check_command_delays() -> None:
        before = client.received["camera/image_raw"]
        assert p90_s(client) < alone + 0.1 * BEHIND_ONE_S
        assert client.received["camera/image_raw"] > before + 5, "as many as it carries"

    retry_when_busy(check_command_delays, "delays between two processes, alone and beside pictures")

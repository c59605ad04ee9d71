"""Addresses that come late, change, and come back: what listens and what searches follows them."""

import time
from contextlib import closing
from pathlib import Path

import pytest

from tests.support.output_lines import Lines
from tests.support.processes import write_scenario
from tools.faults.spaces import Network

pytestmark = pytest.mark.netns


def scenario(folder: Path, host: str) -> Path:
    path, _ = write_scenario(folder, allow="", host=host, port=7447)
    path.write_text(path.read_text() + "[network]\ndiscovery = true\n")
    return path


def test_a_client_finds_a_slave_whose_address_comes_late_and_changes(tmp_path: Path) -> None:
    with Network("slave", "master") as network, closing(Lines(tmp_path / "gateway.txt")) as gateway:
        network.set_address("slave", "delete", 1)
        network.start("slave", "-m", "hil.cli", "slave", scenario(tmp_path, "0.0.0.0"))
        network.start("master", "-m", "hil.cli", "gateway", "json", "--connect", "lan", output=gateway.file)
        gateway.first("no vehicle at lan", time.monotonic(), 60)
        for number in (1, 7):
            came = time.monotonic()
            network.set_address("slave", "add", number)
            assert gateway.first("connected: uuv1", came, 30) < 15
            network.set_address("slave", "delete", number)
            gateway.first("no vehicle at lan", came, 30)


def test_named_addresses_that_come_late_are_listened_at_when_they_come_and_come_back(tmp_path: Path) -> None:
    path, late = scenario(tmp_path, "10.77.0.1"), "10.77.0.1:{}: waiting for it: this machine does not have that"
    servers = {7447: ("slave", path), 7500: ("router", "--listen", "tcp/10.77.0.1:7500")}
    servers |= {7450: ("gateway", "json", "--listen", "10.77.0.1:7450"), 7480: ("view", "--listen", "10.77.0.1:7480")}
    dial = "import socket; [socket.create_connection(('10.77.0.1', port), 9) for port in %s]" % [*servers]
    with Network("slave", "master") as network, closing(Lines(tmp_path / "output.txt")) as output:
        network.set_address("slave", "delete", 1)
        for port, words in servers.items():
            network.start("slave", "-m", "hil.cli", *words, output=output.file)
            output.first(late.format(port), 0.0, time.monotonic() + 60)
        for _ in range(2):
            network.set_address("slave", "add", 1)
            time.sleep(1.0)
            assert network.start("master", "-c", dial).wait(60) == 0
            network.set_address("slave", "delete", 1)


def test_a_name_server_that_does_not_answer_delays_nothing_else(tmp_path: Path) -> None:
    with Network("slave", "master") as network, closing(Lines(tmp_path / "gateway.txt")) as gateway:
        network.silence_name_server("master")
        network.start("slave", "-m", "hil.cli", "slave", scenario(tmp_path, "0.0.0.0"))
        both = ("--connect", "tcp/uuv2.lan:7447", "--connect", "tcp/10.77.0.1:7447")
        network.start("master", "-m", "hil.cli", "gateway", "json", *both, output=gateway.file)
        serves = gateway.first("lines of JSON", 0.0, time.monotonic() + 60)
        assert gateway.first("connected: uuv1", serves, 30) < 3
        network.unplug("slave")
        lost = time.monotonic()
        gateway.first("no vehicle at", lost, 5)
        network.plug("slave")
        assert gateway.first("connected: uuv1", time.monotonic(), 30) < 5

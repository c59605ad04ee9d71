"""Abandoned connections: they neither block new clients of a slave with TLS nor exhaust its descriptors."""

import socket
import struct
import time
from pathlib import Path

import psutil

from hil.client.client import VehicleClient
from hil.commands.keys import add_machine, init
from hil.network.workarounds.accept_queue import shorten_queues
from hil.scenario.config import load_scenario
from tests.support.processes import Program, write_scenario

MAX_WAITING = 28  # the byte of struct tcp_info where a listening socket has its backlog (tcpi_sacked)
SECURITY = """
[security]
slave = "keys/uuv1"
master = "keys/laptop"
may_command = ["laptop"]
"""


def queue_of(listener: socket.socket) -> int:
    info = listener.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 104)
    waiting: int = struct.unpack_from("I", info, MAX_WAITING)[0]
    return waiting


def test_only_listening_sockets_get_a_short_queue() -> None:
    with socket.create_server(("127.0.0.1", 0), backlog=128) as listener, socket.socket() as other_socket:
        assert queue_of(listener) == 128
        assert shorten_queues() >= 1
        assert queue_of(listener) == 0
        assert not other_socket.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
        with socket.create_connection(listener.getsockname(), 5.0), listener.accept()[0]:
            pass  # it is still served


def attack(port: int, connections: int, seconds: float) -> None:
    """Connect and close many times without waiting, from an address of its own."""
    start = time.monotonic()
    open_ones: list[socket.socket] = []
    for number in range(connections):
        end = socket.socket()
        end.bind(("127.0.0.2", 0))
        end.setblocking(False)
        end.connect_ex(("127.0.0.1", port + number % 2))
        open_ones.append(end)
        if len(open_ones) > 4:
            open_ones.pop(0).close()
        time.sleep(max(0.0, start + seconds * (number + 1) / connections - time.monotonic()))
    for end in open_ones:
        end.close()


def test_a_new_client_connects_soon_after_an_attack(tmp_path: Path) -> None:
    """Each failed handshake takes the library 0.1 s: a new client had to wait for all 600 in the queue."""
    init(str(tmp_path / "keys"))
    for name in ("uuv1", "laptop"):
        add_machine(str(tmp_path / "keys"), name, ["localhost"])
    scenario, port = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text() + SECURITY)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        security = load_scenario(str(scenario)).security
        endpoint = f"tcp/127.0.0.1:{port}"
        start = time.monotonic()
        with VehicleClient(endpoint, "uuv1", security=security) as first:
            assert first.wait_for_vehicle(60), "and what it listens on is in its final state"
        usual_s = time.monotonic() - start
        before = psutil.Process(slave.process.pid).num_fds()
        attack(port, 600, 2.0)
        assert psutil.Process(slave.process.pid).num_fds() < before + 50
        start = time.monotonic()
        with VehicleClient(endpoint, "uuv1", security=security) as newcomer:
            assert newcomer.wait_for_vehicle(60), slave.output
        took_s = time.monotonic() - start
        assert took_s < 15.0 + 5.0 * usual_s, "0.3 to 2 s on a quiet machine; 30 s if all had to be failed before"

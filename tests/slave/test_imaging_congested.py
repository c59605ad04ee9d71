"""Commands to a slave whose pictures are more than the network carries."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from hil.autonomy.control import VelocityCommand
from hil.master.client import VehicleClient
from tests.processes import Program, free_port, write_scenario

CAMERA = """
[ros]
images = "raw"
[sensors.camera]
rate = 10
"""
BYTES_PER_S = 1e6  # the pictures are 2.3 MB a second
PIECE = 4096
SECONDS = 4.0


class Relay:
    """A network in between: all to `port` at once, what comes from there at `rate` bytes a second, if any is given."""

    def __init__(self, here: int, port: int, rate: float) -> None:
        self._port, self._rate = port, rate
        self._ends: list[socket.socket] = []
        self._listener = self._small(socket.create_server(("127.0.0.1", here)))
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        for end in (self._listener, *self._ends):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                master = self._listener.accept()[0]
                slave = self._small(socket.socket())
                slave.connect(("127.0.0.1", self._port))
                self._ends += [master, slave]
                for ends in ((master, slave, 0.0), (slave, master, self._rate)):
                    threading.Thread(target=self._pass_on, args=ends, daemon=True).start()

    def _pass_on(self, source: socket.socket, target: socket.socket, rate: float) -> None:
        target.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with suppress(OSError):
            while piece := source.recv(PIECE):
                target.sendall(piece)
                time.sleep(len(piece) / rate if rate else 0.0)

    def _small(self, end: socket.socket) -> socket.socket:
        """Holds back little, as a bottleneck that is near."""
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2 * PIECE)
        return end


@pytest.fixture
def client(tmp_path: Path) -> Iterator[VehicleClient]:
    scenario, port = write_scenario(tmp_path, top=CAMERA)
    here = free_port()
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        relays = [Relay(here, port, 0.0), Relay(here + 1, port + 1, BYTES_PER_S)]
        with VehicleClient(f"tcp/127.0.0.1:{here}", "uuv1") as client:
            assert client.wait_for_vehicle(10.0)
            yield client
        for relay in relays:
            relay.close()


def test_commands_do_not_wait_behind_them(client: VehicleClient) -> None:
    client.watch("camera/image_raw")
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        client.command(VelocityCommand(surge=0.1))
        time.sleep(0.05)
    delays = sorted(client.delays.totals_ns())
    assert len(delays) > 60
    assert delays[len(delays) * 9 // 10] < 15e6

"""A slave that a model of ArduPilot flies: over the thruster link to the STM32, in real time, with what goes wrong."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hil.client.client import VehicleClient
from hil.common.ports import free_ports
from tests.support.ardupilot_peer import ArdupilotPeer
from tests.support.processes import Program, children_of, free_port, wait_for

SCENARIO = """
vehicle = "bluerov2"
world = "open_water"
controller = "ardupilot"
stm32 = "{stm32}"
master = {{}}
[start]
north = 20
east = 20
depth = 5
[slave]
listen = "tcp/127.0.0.1:{port}"
[autopilot]
address = "udp://127.0.0.1:{udp}"
[sensors.imu]
rate = 400
"""
AHEAD = (1400, 1400, 1600, 1600, 1500, 1500)


class Flyer:
    """The autopilot in a thread: sends `motors` whenever it is answered, until it is paused."""

    def __init__(self, port: int) -> None:
        self.peer = ArdupilotPeer(port)
        self.peer.socket.settimeout(0.3)
        self.motors = AHEAD
        self.running = True
        self.going = threading.Event()
        self.going.set()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while self.running:
            self.going.wait(0.1)
            if not self.going.is_set():
                continue
            try:
                self.peer.step(*self.motors)
            except TimeoutError:  # the same packet again
                continue

    def close(self) -> None:
        self.running = False
        self._thread.join(10)
        self.peer.close()


@contextmanager
def flown(folder: Path, stm32: str) -> Iterator[tuple[Program, Flyer, VehicleClient]]:
    port, udp = free_port(), free_ports(1)[0]
    path = folder / "flown.toml"
    path.write_text(SCENARIO.format(stm32=stm32, port=port, udp=udp))
    with Program(folder, "slave", path) as slave:
        slave.expect("waiting for ArduPilot on udp")
        flyer = Flyer(udp)
        try:
            with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1", part="observer") as client:
                assert client.wait_for_vehicle(60)
                yield slave, flyer, client
        finally:
            flyer.close()
    assert "thrusters neutral" in slave.output


def reported(client: VehicleClient, holds: Callable[[Any], bool]) -> Any:
    """Wait for diagnostics of which that holds."""
    assert wait_for(lambda: bool(client.diagnostics()) and holds(client.diagnostics()), 60.0), client.diagnostics()
    return client.diagnostics()


@pytest.mark.parametrize("stm32", ["python", "process"])
def test_its_outputs_reach_the_stm32(tmp_path: Path, stm32: str) -> None:
    """Also an STM32 that is another process; a silent autopilot stops the thrusters, and goes on as if nothing was."""
    with flown(tmp_path, stm32) as (slave, flyer, client):
        figures = reported(client, lambda found: found.pwm_us == AHEAD)
        assert figures.controller == "autopilot"
        assert figures.autopilot_frame == "vectored"
        assert figures.autopilot_outputs[:6] == AHEAD
        assert figures.autopilot_delay_p50_ms > 0.0
        flyer.going.clear()
        reported(client, lambda found: found.pwm_us == (1500,) * 6)  # by the STM32's watchdog, or by a command
        reported(client, lambda found: found.autopilot_silences >= 1)
        slave.expect("no outputs for 0.2 s: thrusters neutral")
        flyer.going.set()
        reported(client, lambda found: found.pwm_us == AHEAD)


def test_an_stm32_that_is_killed_comes_back_under_the_autopilot(tmp_path: Path) -> None:
    with flown(tmp_path, "process") as (slave, _, client):
        reported(client, lambda found: found.pwm_us == AHEAD)
        stm32 = children_of(slave.process.pid)
        assert stm32
        for pid in stm32:
            os.kill(pid, signal.SIGKILL)
        slave.expect("thruster link lost")
        slave.expect("thruster link back")
        reported(client, lambda found: found.pwm_us == AHEAD and found.link_losses >= 1)

"""The real ArduSub with an emulated STM32, in real time: pulse widths over the link, a reset in flight."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from firmware_stub.build import native_compiler
from hil.client.client import VehicleClient
from hil.common.ports import free_ports
from tests.support.autopilots.autopilot_dive import ARM, SET_MODE, WORLD, command
from tests.support.clients.ground_station import GroundStation, Mission, fly_live
from tests.support.processes import Program, children_of

PROGRAM = os.environ.get("UUV_HIL_ARDUSUB", "")
pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="UUV_HIL_ARDUSUB does not name ArduSub's SITL program"),
    pytest.mark.timeout(900),
]
SCENARIO = """
vehicle = "bluerov2_heavy"
world = "{world}"
controller = "ardupilot"
stm32 = "{stm32}"
master = {{}}
[start]
depth = 0
[slave]
listen = "tcp/127.0.0.1:{port}"
[autopilot]
program = "{program}"
folder = "ardusub"
wipe = true
instance = 6
[sensors.imu]
rate = 400
[sensors.pressure]
rate = 50
"""
ALT_HOLD = 2
LIMIT_S = 400.0
KINDS = ["process", pytest.param("native", marks=pytest.mark.skipif(not native_compiler(), reason="no C compiler"))]


class Vehicle:
    """A slave that has started ArduSub and its STM32, an observer of it, and a ground station."""

    def __init__(self, slave: Program, client: VehicleClient) -> None:
        self.slave, self.client = slave, client
        self.station = GroundStation(("127.0.0.1", 5820))

    @property
    def depth(self) -> float:
        return float(self.client.latest["ground_truth"].value.position[2])

    def stm32(self) -> list[int]:
        """Return the processes of the slave that are not ArduSub."""
        pids = children_of(self.slave.process.pid)
        return [pid for pid in pids if psutil.Process(pid).exe() != os.path.realpath(PROGRAM)]

    def dive(self, depth: float) -> Mission:
        """Arm, dive with the joystick, and hold depth."""
        yield lambda: self.station.output("ArduPilot Ready")
        yield from command(self.station, ARM, 1)
        self.station.sticks = (0, 0, 300, 0)
        yield lambda: self.depth > depth
        self.station.sticks = (0, 0, 500, 0)
        yield from command(self.station, SET_MODE, 1, ALT_HOLD)
        yield self.is_depth_steady()

    def hold(self, seconds: float, depths: list[float]) -> Mission:
        """Record the depth ten times a second."""
        for _ in range(round(10 * seconds)):
            depths.append(self.depth)
            yield 0.1

    def is_depth_steady(self) -> Callable[[], bool]:
        """Return a condition that comes true when the depth has moved by less than 5 cm in 5 s."""
        noted = [(time.monotonic(), self.depth)]

        def holds() -> bool:
            now = time.monotonic()
            noted.append((now, self.depth))
            recent = [depth for instant, depth in noted if instant > now - 5.0]
            return now - noted[0][0] > 5.0 and max(recent) - min(recent) < 0.05

        return holds


@contextmanager
def flying_vehicle(folder: Path, stm32: str) -> Iterator[Vehicle]:
    world, path, port = folder / "stream.toml", folder / "dive.toml", free_ports(1)[0]
    world.write_text(WORLD)
    path.write_text(SCENARIO.format(world=world, stm32=stm32, port=port, program=PROGRAM))
    with Program(folder, "slave", path) as slave:
        slave.expect("waiting for ArduPilot on udp")
        with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1", role="observer") as client:
            assert client.wait_for_vehicle(60)
            vehicle = Vehicle(slave, client)
            try:
                yield vehicle
            finally:
                vehicle.station.close()


@pytest.mark.parametrize("stm32", KINDS)
def test_ardusub_holds_depth_again_after_the_stm32_was_reset(tmp_path: Path, stm32: str) -> None:
    before: list[float] = []
    after: list[float] = []
    with flying_vehicle(tmp_path, stm32) as vehicle:

        def mission() -> Mission:
            yield from vehicle.dive(2.0)
            yield from vehicle.hold(10.0, before)
            pids = vehicle.stm32()
            assert len(pids) == 1
            os.kill(pids[0], signal.SIGKILL)
            yield lambda: "thruster link back" in vehicle.slave.output
            yield vehicle.is_depth_steady()
            yield from vehicle.hold(20.0, after)

        fly_live(vehicle.station, mission(), LIMIT_S)
        figures = vehicle.client.diagnostics()
        output = vehicle.slave.output
    print(f"{stm32}: depth {min(before):.2f} to {max(before):.2f} m, then {min(after):.2f} to {max(after):.2f} m")
    print(f"outputs to pulse widths p50 {figures.autopilot_delay_p50_ms:.2f} ms; {figures.autopilot_steps_held} held")
    assert figures.link_losses == 1
    assert figures.autopilot_resets == 0
    assert "thruster link lost" in output
    assert figures.pwm_us
    assert len(set(figures.pwm_us)) > 1  # the vehicle is light: its thrusters alone keep it down
    assert abs(sum(after) / len(after) - sum(before) / len(before)) < 0.15
    assert max(after) - min(after) < 0.2

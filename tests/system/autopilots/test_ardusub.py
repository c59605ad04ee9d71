"""The real ArduSub, where UUV_HIL_ARDUSUB names its SITL program: it arms, holds depth, drives a square, survives.

Everything happens in simulated time, in lockstep: how fast it goes depends on the machine, what happens does not.
"""

import os
import time
from collections.abc import Iterator
from math import hypot
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.run import AutopilotRun
from hil.scenario.config import load_scenario
from sim.vehicle.failures import Failure
from tests.support.autopilots.autopilot_dive import ARM, SET_MODE, WORLD, command
from tests.support.clients.ground_station import GroundStation, Mission, fly

PROGRAM = os.environ.get("UUV_HIL_ARDUSUB", "")
pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="UUV_HIL_ARDUSUB does not name ArduSub's SITL program"),
    pytest.mark.timeout(1200),  # six minutes of simulated time, on a machine that others use too
]
SCENARIO = """
vehicle = "{vehicle}"
world = "{world}"
controller = "ardupilot"
master = {{}}
[start]
depth = 0
[autopilot]
program = "{program}"
instance = {instance}
positions = "{positions}"
[sensors.imu]
rate = 400
[sensors.pressure]
rate = 50
drop_out = {drop_out}
[sensors.altimeter]
[sensors.odometry]
rate = 20
[sensors.gps]
rate = 5
position = [0, 0, -0.4]
"""
MANUAL, ALT_HOLD, GUIDED, POSHOLD = 19, 2, 4, 16


class Dive:
    """One ArduSub with its vehicle and a ground station."""

    def __init__(
        self, folder: Path, vehicle: str = "bluerov2_heavy", instance: int = 3, drop_out: float = 0.0,
        positions: str = "simulated",
    ) -> None:  # fmt: skip
        world, path = folder / "stream.toml", folder / "dive.toml"
        world.write_text(WORLD)
        text = SCENARIO.format(
            vehicle=vehicle, world=world, program=PROGRAM, instance=instance, drop_out=drop_out, positions=positions
        )
        path.write_text(text)
        self.reports: list[str] = []
        self.run = AutopilotRun(load_scenario(str(path)), self.reports.append)
        self.station = GroundStation(("127.0.0.1", 5760 + 10 * instance))
        self.began = time.monotonic()

    def close(self) -> None:
        self.station.close()
        simulated, took = self.run.simulation.time_ns / 1e9, time.monotonic() - self.began
        print(
            f"{simulated:.0f} s simulated in {took:.1f} s: {simulated / took:.1f} times real time; {self.reports[1:]}"
        )
        self.run.__exit__()

    @property
    def position(self) -> list[float]:
        return list(self.run.simulation.state.position)

    def command(self, number: int, *parameters: float) -> Mission:
        """Send until it is accepted."""
        return command(self.station, number, *parameters)

    def dive(self, depth: float) -> Mission:
        """Arm, go down by the sticks, and hold depth."""
        yield lambda: self.station.said("ArduPilot Ready")
        yield from self.command(ARM, 1)
        self.station.sticks = (0, 0, 300, 0)
        yield lambda: self.position[2] > depth
        self.station.sticks = (0, 0, 500, 0)
        yield from self.command(SET_MODE, 1, ALT_HOLD)
        yield 15.0

    def hold(self, seconds: float, depths: list[float]) -> Mission:
        """Note the depth twenty times a second."""
        for _ in range(round(20 * seconds)):
            depths.append(self.position[2])
            yield 0.05

    def go(self, north: float, east: float, depth: float) -> Mission:
        """Go to a place (m from the estimator's origin) in GUIDED; said once, as each target begins from rest."""
        mask = 0b1101_1111_1000  # positions only
        message = dialect.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, dialect.MAV_FRAME_LOCAL_NED, mask, north, east, depth, 0, 0, 0, 0, 0, 0, 0, 0
        )
        self.station.send(message)
        local = self.station.latest
        yield lambda: hypot(local["LOCAL_POSITION_NED"].x - north, local["LOCAL_POSITION_NED"].y - east) < 0.5


@pytest.fixture
def dive(tmp_path: Path) -> Iterator[Dive]:
    made = Dive(tmp_path)
    yield made
    made.close()


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_it_holds_depth_for_two_minutes_in_a_current(tmp_path: Path, vehicle: str) -> None:
    dive = Dive(tmp_path, vehicle)
    depths: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield from dive.hold(120.0, depths)
        yield from dive.command(ARM, 0)
        yield 0.5

    try:
        fly(dive.run, dive.station, mission(), 400.0)
    finally:
        dive.close()
    print(f"{vehicle}: depth {min(depths):.3f} to {max(depths):.3f} m")
    middle = 0.5 * (max(depths) + min(depths))
    assert max(depths) - middle < 0.1
    assert middle > 2.5
    assert set(dive.run.pwm_us) == {1500}  # disarmed


def test_it_drives_a_square_in_guided(dive: Dive) -> None:
    corners = [(0.0, 5.0), (5.0, 5.0), (5.0, 0.0), (0.0, 0.0)]
    misses: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield lambda: dive.station.said("is using GPS")
        yield from dive.command(SET_MODE, 1, GUIDED)
        yield 10.0
        first, origin = dive.position, dive.station.latest["LOCAL_POSITION_NED"]
        for north, east in corners:
            yield from dive.go(origin.x + north, origin.y + east, 3.0)
            yield 8.0
            misses.append(hypot(dive.position[0] - first[0] - north, dive.position[1] - first[1] - east))
        yield from dive.command(SET_MODE, 1, POSHOLD)
        before = dive.position
        yield 30.0
        misses.append(hypot(dive.position[0] - before[0], dive.position[1] - before[1]))

    fly(dive.run, dive.station, mission(), 600.0)
    print(f"square: {', '.join(f'{miss:.2f}' for miss in misses)} m from the corners, and in 30 s of POSHOLD")
    assert max(misses) < 1.5


@pytest.mark.parametrize(("positions", "most"), [("odometry", 1.0), ("dvl", 1.0)])
def test_it_holds_its_position_under_water_without_gps(tmp_path: Path, positions: str, most: float) -> None:
    dive = Dive(tmp_path, positions=positions)
    strayed: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield from dive.command(SET_MODE, 1, POSHOLD)
        yield 10.0
        north, east, _ = dive.position
        for _ in range(1200):
            strayed.append(hypot(dive.position[0] - north, dive.position[1] - east))
            yield 0.05

    try:
        fly(dive.run, dive.station, mission(), 400.0)
    finally:
        dive.close()
    print(f"{positions}: {max(strayed):.2f} m off in a minute of POSHOLD, in a current of 0.3 m/s")
    assert max(strayed) < most
    assert dive.station.latest["GPS_RAW_INT"].fix_type <= 1


def test_a_given_gps_has_a_position_at_the_surface_alone(tmp_path: Path) -> None:
    dive = Dive(tmp_path, positions="gps")
    fixes: list[int] = []

    def mission() -> Mission:
        yield lambda: dive.station.said("is using GPS")
        fixes.append(dive.station.latest["GPS_RAW_INT"].fix_type)
        yield from dive.dive(3.0)
        fixes.append(dive.station.latest["GPS_RAW_INT"].fix_type)

    try:
        fly(dive.run, dive.station, mission(), 400.0)
    finally:
        dive.close()
    assert fixes[0] >= 3
    assert fixes[1] <= 1


def test_it_survives_a_thruster_that_fails(dive: Dive) -> None:
    depths: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        dive.run.simulation.fail(Failure("vertical_front_right", "off"))
        yield 20.0
        yield from dive.hold(60.0, depths)

    fly(dive.run, dive.station, mission(), 400.0)
    print(f"one vertical thruster off: depth {min(depths):.3f} to {max(depths):.3f} m")
    assert max(depths) - min(depths) < 0.4


def test_it_holds_depth_when_half_of_the_pressure_samples_are_lost(tmp_path: Path) -> None:
    dive = Dive(tmp_path, drop_out=0.5)
    depths: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield from dive.hold(60.0, depths)

    try:
        fly(dive.run, dive.station, mission(), 400.0)
    finally:
        dive.close()
    assert max(depths) - min(depths) < 0.3


def test_two_vehicles_with_an_autopilot_each(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "other")]
    for folder in folders:
        folder.mkdir()
    dives = [Dive(folder, instance=instance) for folder, instance in zip(folders, (4, 5), strict=True)]

    def mission(dive: Dive, depth: float) -> Mission:
        yield from dive.dive(depth)

    try:
        for dive, depth in zip(dives, (2.0, 4.0), strict=True):
            fly(dive.run, dive.station, mission(dive, depth), 200.0)
        assert abs(dives[0].position[2] - 2.0) < 0.5
        assert abs(dives[1].position[2] - 4.0) < 0.5
    finally:
        for dive in dives:
            dive.close()

"""The real PX4, where UUV_HIL_PX4 names its build folder: it arms, obeys the sticks, holds depth and position."""

import os
import time
from math import hypot
from pathlib import Path

import pytest

from hil.autopilots.run import AutopilotRun
from hil.scenario.config import load_scenario
from tests.support.autopilot_dive import ARM, SET_MODE, WORLD, command
from tests.support.ground_station import GroundStation, Mission, fly

BUILD = os.environ.get("UUV_HIL_PX4", "")
pytestmark = [
    pytest.mark.skipif(not BUILD, reason="UUV_HIL_PX4 does not name PX4's build folder"),
    pytest.mark.timeout(1200),  # minutes of simulated time, on a machine that others use too
]
SCENARIO = """
vehicle = "bluerov2_heavy"
world = "{world}"
controller = "px4"
master = {{}}
[start]
depth = 0
[slave]
step = 0.004
[autopilot]
program = "{build}"
[sensors.imu]
rate = 250
[sensors.pressure]
rate = 50
[sensors.odometry]
rate = 50
"""
MANUAL, ALTITUDE, POSITION = 1, 2, 3


def test_it_holds_depth_and_position_in_a_current(tmp_path: Path) -> None:
    world, path = tmp_path / "stream.toml", tmp_path / "dive.toml"
    world.write_text(WORLD)
    path.write_text(SCENARIO.format(world=world, build=BUILD))
    depths: list[float] = []
    places: list[tuple[float, float]] = []
    began = time.monotonic()
    with AutopilotRun(load_scenario(str(path)), print) as run:
        station = GroundStation(("127.0.0.1", 14550), datagrams=True)

        def mission() -> Mission:
            yield lambda: "ATTITUDE" in station.latest
            yield 3.0
            yield from command(station, SET_MODE, 1, MANUAL, 0)
            yield from command(station, ARM, 1)
            station.sticks = (-500, 0, 500, 0)
            yield lambda: run.simulation.state.position[2] > 3.0
            station.sticks = (0, 0, 500, 0)
            yield 3.0
            yield from command(station, SET_MODE, 1, ALTITUDE, 0)
            yield 15.0
            for _ in range(2400):
                depths.append(run.simulation.state.position[2])
                yield 0.05
            yield from command(station, SET_MODE, 1, MANUAL, 0)
            yield 4.0  # PX4 takes as its set-point a position of the mode before, which it refreshes every 2 s
            yield from command(station, SET_MODE, 1, POSITION, 0)
            yield 30.0
            for _ in range(600):
                north, east, _ = run.simulation.state.position
                places.append((north, east))
                yield 0.05
            yield from command(station, ARM, 0)
            yield 0.5

        try:
            fly(run, station, mission(), 500.0)
        finally:
            station.close()
            simulated = run.simulation.time_ns / 1e9
            print(f"{simulated:.0f} s simulated: {simulated / (time.monotonic() - began):.1f} times real time")
        spread = max(hypot(n - places[0][0], e - places[0][1]) for n, e in places)
        print(f"depth {min(depths):.3f} to {max(depths):.3f} m; in 30 s of POSITION {spread:.2f} m away")
        middle = 0.5 * (min(depths) + max(depths))
        assert max(depths) - middle < 0.1
        assert spread < 0.5
        assert set(run.pwm_us) == {1500}

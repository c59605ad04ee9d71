"""The real PX4, where UUV_HIL_PX4 names its build folder: depth, position, offboard mode, faults.

Everything happens in simulated time, in lockstep: the duration depends on the machine, the results do not.
"""

import os
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import pairwise
from math import cos, degrees, hypot, sin
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.run import AutopilotRun
from hil.scenario.config import load_scenario
from sim.vehicle.failures import Failure
from tests.support.autopilots.autopilot_dive import ARM, SET_MODE, WORLD, command
from tests.support.clients.ground_station import GroundStation, Mission, fly

BUILD = os.environ.get("UUV_HIL_PX4", "")
pytestmark = [
    pytest.mark.skipif(not BUILD, reason="UUV_HIL_PX4 does not name PX4's build folder"),
    pytest.mark.timeout(1200),  # minutes of simulated time, on a machine that others use too
]
MANUAL, ALTITUDE, POSITION, OFFBOARD = 1, 2, 3, 6
MODE_AGES_S = 4.0  # PX4 takes as its set-point a position of the mode before, which it refreshes every 2 s


class Dive:
    """One PX4 with its vehicle and a ground station."""

    def __init__(self, folder: Path, **changes: object) -> None:
        world = folder / "stream.toml"
        world.write_text(WORLD)
        autopilot = {"program": BUILD, "folder": str(folder / "px4"), **changes}
        seed = autopilot.pop("seed", 1)
        keys = {f"autopilot.{name}": value for name, value in autopilot.items()}
        self.reports: list[str] = []
        self.run = AutopilotRun(
            load_scenario("px4_uuv", {**keys, "seed": seed, "world": str(world)}), self.reports.append
        )
        self.station = GroundStation(("127.0.0.1", 14550), datagrams=True)
        self.locked = 0.0, 0.0  # simulated and real time at which it was ready

    def close(self) -> None:
        self.station.close()
        simulated, real = self.run.simulation.time_ns / 1e9 - self.locked[0], time.monotonic() - self.locked[1]
        print(f"{simulated:.0f} s of lockstep in {real:.1f} s: {simulated / real:.1f} times real time")
        self.run.__exit__()

    @property
    def position(self) -> list[float]:
        return list(self.run.simulation.state.position)

    def mode(self, main: int) -> Mission:
        yield from command(self.station, SET_MODE, 1, main, 0)

    def dive(self, depth: float, mode: int) -> Mission:
        """Arm, dive with the joystick, and hold that mode."""
        yield lambda: "ATTITUDE" in self.station.latest
        self.locked = self.run.simulation.time_ns / 1e9, time.monotonic()
        yield 3.0
        yield from self.mode(POSITION)  # in MANUAL PX4 1.18 arms only with the stick's z at its lowest value
        yield from command(self.station, ARM, 1)
        self.station.sticks = (0, 0, 0, 0)  # down at 0.5 m/s
        yield lambda: self.position[2] > depth
        self.station.sticks = (0, 0, 500, 0)
        yield MODE_AGES_S
        yield from self.mode(mode)
        yield 15.0

    def watch(self, seconds: float, positions: list[list[float]]) -> Mission:
        """Record the position twenty times a second."""
        for _ in range(round(20 * seconds)):
            positions.append(self.position)
            yield 0.05


@pytest.fixture
def dive(tmp_path: Path) -> Iterator[Dive]:
    made = Dive(tmp_path)
    yield made
    made.close()


def test_px4_holds_depth_and_position_in_a_current(dive: Dive) -> None:
    deep: list[list[float]] = []
    positions: list[list[float]] = []

    def mission() -> Mission:
        yield from dive.dive(3.0, ALTITUDE)
        yield from dive.watch(120.0, deep)
        yield from dive.mode(MANUAL)
        yield MODE_AGES_S
        yield from dive.mode(POSITION)
        yield 30.0
        yield from dive.watch(30.0, positions)
        yield from command(dive.station, ARM, 0)
        yield 0.5

    fly(dive.run, dive.station, mission(), 500.0)
    depths = [place[2] for place in deep]
    spread = max(hypot(n - positions[0][0], e - positions[0][1]) for n, e, _ in positions)
    print(f"depth {min(depths):.3f} to {max(depths):.3f} m; in 30 s of POSITION {spread:.2f} m away")
    middle = 0.5 * (min(depths) + max(depths))
    assert max(depths) - middle < 0.1
    assert spread < 0.5
    assert set(dive.run.pwm_us) == {1500}


def test_px4_follows_a_square_in_position_mode(dive: Dive) -> None:
    """The sticks move the set-point at 0.5 m/s: each leg of 5 m takes 10 s of a full stick."""
    ahead, right = (1000, 0, 500, 0), (0, 1000, 500, 0)
    astern, left = (-1000, 0, 500, 0), (0, -1000, 500, 0)
    corners: list[list[float]] = []

    def mission() -> Mission:
        yield from dive.dive(3.0, POSITION)
        yield 15.0
        corners.append(dive.position)
        for sticks in (ahead, right, astern, left):
            dive.station.sticks = sticks
            yield 10.0
            dive.station.sticks = (0, 0, 500, 0)
            yield 15.0
            corners.append(dive.position)

    fly(dive.run, dive.station, mission(), 500.0)
    print("corners", [[round(value, 2) for value in corner] for corner in corners])
    legs = [hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(corners)]
    assert all(4.0 < leg < 6.0 for leg in legs)
    assert hypot(corners[4][0] - corners[0][0], corners[4][1] - corners[0][1]) < 1.0
    assert hypot(corners[2][0] - corners[0][0], corners[2][1] - corners[0][1]) > 5.5  # the diagonal: no line
    assert max(corner[2] for corner in corners) - min(corner[2] for corner in corners) < 0.3


def test_px4_holds_depth_after_a_thruster_failure(dive: Dive) -> None:
    positions: list[list[float]] = []

    def mission() -> Mission:
        yield from dive.dive(3.0, ALTITUDE)
        dive.run.simulation.fail(Failure("vertical_front_right", "off"))
        yield 20.0
        yield from dive.watch(60.0, positions)

    fly(dive.run, dive.station, mission(), 400.0)
    depths = [place[2] for place in positions]
    print(f"one vertical thruster off: depth {min(depths):.3f} to {max(depths):.3f} m")
    assert max(depths) - min(depths) < 0.4
    assert min(depths) > 2.0


def test_px4_receives_rc_channels(tmp_path: Path) -> None:
    dive = Dive(tmp_path, rc=[1510, 1520, 1530, 1540, 1550])

    def mission() -> Mission:
        yield lambda: "RC_CHANNELS" in dive.station.latest

    with closing(dive):
        fly(dive.run, dive.station, mission(), 60.0)
    channels = dive.station.latest["RC_CHANNELS"]
    assert (channels.chancount, channels.chan1_raw, channels.chan5_raw) == (5, 1510, 1550)


def test_px4_follows_attitude_and_thrust_in_offboard_mode(dive: Dive) -> None:
    """PX4's underwater controllers take an attitude and a thrust over MAVLink in OFFBOARD, and no position."""
    began: list[float] = []
    heading = 0.0

    def say() -> None:
        quaternion = (cos(heading / 2.0), 0.0, 0.0, sin(heading / 2.0))
        ignored = dialect.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
        ignored |= dialect.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
        ignored |= dialect.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
        dive.station.send(dialect.MAVLink_set_attitude_target_message(0, 1, 1, ignored, quaternion, 0, 0, 0, 0.3))

    def mission() -> Mission:
        nonlocal heading
        yield from dive.dive(3.0, ALTITUDE)
        dive.station.every = say
        yield 2.0
        yield from dive.mode(OFFBOARD)
        yield 5.0
        began.extend(dive.position)
        yield 10.0
        began.extend(dive.position)
        heading = 1.5708
        yield 10.0
        began.extend(dive.position)
        yield 10.0

    fly(dive.run, dive.station, mission(), 400.0)
    print("offboard", [round(value, 2) for value in [*began, *dive.position]], dive.station.texts[-5:])
    assert began[3] - began[0] > 2.0
    assert dive.position[1] - began[7] > 2.0


@pytest.mark.parametrize("seed", range(1, 6))
def test_px4_arms_with_every_seed_and_knows_its_attitude(seed: int, tmp_path: Path) -> None:
    errors: list[float] = []
    places: list[float] = []

    def mission(dive: Dive) -> Mission:
        yield from dive.dive(2.0, POSITION)
        for _ in range(60):
            estimate = dive.run.autopilot.estimate
            assert estimate
            errors.append(degrees(max(abs(estimate.roll), abs(estimate.pitch))))
            places.append(estimate.position)
            yield 1.0

    with closing(Dive(tmp_path, seed=seed)) as dived:
        fly(dived.run, dived.station, mission(dived), 200.0)
    print(f"attitude wrong by {max(errors):.2f} degrees at most, position by {max(places):.2f} m")
    assert max(errors) < 1.0
    assert max(places) < 1.0


def test_px4_finds_its_way_by_dvl_and_knows_the_origin(tmp_path: Path) -> None:
    dive = Dive(tmp_path, positions="dvl")
    places: list[tuple[list[float], Any]] = []

    def mission() -> Mission:
        yield from dive.dive(3.0, POSITION)
        for sticks in ((1000, 0, 500, 0), (0, 0, 500, 0)):
            places.append((dive.position, dive.station.latest["LOCAL_POSITION_NED"]))
            dive.station.sticks = sticks
            yield 20.0
        dive.station.command(512, dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
        yield 1.0

    with closing(dive):
        fly(dive.run, dive.station, mission(), 200.0)
    ((began, first), (ended, last)), origin = places, dive.station.latest["GPS_GLOBAL_ORIGIN"]
    error = hypot(last.x - first.x - ended[0] + began[0], last.y - first.y - ended[1] + began[1])
    print(f"wrong by {error:.2f} m after {hypot(ended[0] - began[0], ended[1] - began[1]):.1f} m")
    assert error < 0.15 * 10.0  # a heading by magnetometer is within 8 degrees
    assert abs(last.z - ended[2]) < 0.2
    assert abs(origin.latitude - 500_001_800) < 100  # the start, 20 m north of the world's origin


def test_px4_keeps_what_was_set_and_its_log_until_it_is_wiped(tmp_path: Path) -> None:
    values: list[float] = []

    def mission(dive: Dive) -> Mission:
        yield from dive.dive(1.0, POSITION)
        dive.station.send(dialect.MAVLink_param_request_read_message(1, 1, b"UUV_MGM_YAW", -1))
        yield 1.0
        values.append(dive.station.latest["PARAM UUV_MGM_YAW"])
        dive.station.set_parameter("UUV_MGM_YAW", 0.45)
        yield from command(dive.station, ARM, 0, 21196)
        yield 2.0

    logs = []
    for wipe in (False, False, True):
        with closing(Dive(tmp_path, wipe=wipe)) as dived:
            fly(dived.run, dived.station, mission(dived), 200.0)
        logs.append(len(list(tmp_path.glob("px4/log/*/*.ulg"))))
        values.append(any("UUV_MGM_YAW 0.45" in report for report in dived.reports))
    assert values == pytest.approx([0.3, False, 0.45, True, 0.3, False])
    assert logs == [1, 2, 1]

"""The real PX4, where UUV_HIL_PX4 names its build folder: depth, position, offboard mode, faults."""

import os
import subprocess
from itertools import pairwise
from math import cos, degrees, hypot, nan, sin
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.scenario.config import load_scenario
from sim.vehicle.failures import Failure
from tests.support.autopilots.autopilot_dive import ARM, SET_MODE, WORLD, AutopilotDive
from tests.support.clients.ground_station import GroundStation, Mission

BUILD = os.environ.get("UUV_HIL_PX4", "")
pytestmark = [
    pytest.mark.skipif(not BUILD, reason="UUV_HIL_PX4 does not name PX4's build folder"),
    pytest.mark.timeout(1200),  # minutes of simulated time, on a machine that others use too
]
MANUAL, ALTITUDE, POSITION, OFFBOARD = 1, 2, 3, 6
MODE_AGES_S = 4.0  # PX4 takes as its set-point a position of the mode before, which it refreshes every 2 s


class Dive(AutopilotDive):
    """One PX4 with its vehicle and a ground station."""

    def __init__(self, folder: Path, **changes: object) -> None:
        world = folder / "stream.toml"
        world.write_text(WORLD)
        autopilot = {"program": BUILD, "folder": str(folder / "px4"), **changes}
        seed = autopilot.pop("seed", 1)
        keys = {f"autopilot.{name}": value for name, value in autopilot.items()}
        scenario = load_scenario("px4_uuv", {**keys, "seed": seed, "world": str(world)})
        super().__init__(scenario, GroundStation(("127.0.0.1", 14550), datagrams=True))

    def mode(self, main: int) -> Mission:
        yield from self.command(SET_MODE, 1, main, 0)

    def dive(self, depth: float, mode: int) -> Mission:
        """Arm, dive with the joystick, and hold that mode."""
        yield lambda: "ATTITUDE" in self.station.latest
        yield 3.0
        yield from self.mode(POSITION)  # in MANUAL PX4 1.18 arms only with the stick's z at its lowest value
        yield from self.command(ARM, 1)
        self.station.sticks = (0, 0, 0, 0)  # down at 0.5 m/s
        yield lambda: self.position[2] > depth
        self.station.sticks = (0, 0, 500, 0)
        yield MODE_AGES_S
        yield from self.mode(mode)
        yield 15.0


def test_px4_holds_depth_and_position_in_a_current(tmp_path: Path) -> None:
    dive = Dive(tmp_path)
    depths: list[float] = []
    positions: list[list[float]] = []

    def mission() -> Mission:
        yield from dive.dive(3.0, ALTITUDE)
        yield from dive.hold(120.0, depths)
        yield from dive.mode(MANUAL)
        yield MODE_AGES_S
        yield from dive.mode(POSITION)
        yield 30.0
        for _ in range(60):
            positions.append(dive.position)
            yield 0.5
        yield from dive.command(ARM, 0)
        yield 0.5

    dive.fly(mission(), 500.0)
    spread = max(hypot(n - positions[0][0], e - positions[0][1]) for n, e, _ in positions)
    print(f"depth {min(depths):.3f} to {max(depths):.3f} m; in 30 s of POSITION {spread:.2f} m away")
    middle = 0.5 * (min(depths) + max(depths))
    assert max(depths) - middle < 0.1
    assert spread < 0.5
    assert set(dive.run.pwm_us) == {1500}


def test_px4_follows_a_square_in_position_mode(tmp_path: Path) -> None:
    """The sticks move the set-point at 0.5 m/s: each leg of 5 m takes 10 s of a full stick."""
    dive = Dive(tmp_path)
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

    dive.fly(mission(), 500.0)
    print("corners", [[round(value, 2) for value in corner] for corner in corners])
    legs = [hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(corners)]
    assert all(4.0 < leg < 6.0 for leg in legs)
    assert hypot(corners[4][0] - corners[0][0], corners[4][1] - corners[0][1]) < 1.0
    assert hypot(corners[2][0] - corners[0][0], corners[2][1] - corners[0][1]) > 5.5  # the diagonal: no line
    assert max(corner[2] for corner in corners) - min(corner[2] for corner in corners) < 0.3


def test_px4_holds_depth_after_a_thruster_failure(tmp_path: Path) -> None:
    dive = Dive(tmp_path)
    depths: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0, ALTITUDE)
        dive.run.simulation.fail(Failure("vertical_front_right", "off"))
        yield 20.0
        yield from dive.hold(60.0, depths)

    dive.fly(mission(), 400.0)
    print(f"one vertical thruster off: depth {min(depths):.3f} to {max(depths):.3f} m")
    assert max(depths) - min(depths) < 0.4
    assert min(depths) > 2.0


def test_px4_follows_attitude_and_thrust_in_offboard_mode(tmp_path: Path) -> None:
    """PX4's underwater controllers take an attitude and a thrust over MAVLink in OFFBOARD, and no position."""
    dive = Dive(tmp_path)
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

    dive.fly(mission(), 400.0)
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

    dived = Dive(tmp_path, seed=seed)
    dived.fly(mission(dived), 200.0)
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

    dive.fly(mission(), 200.0)
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
        yield from dive.command(ARM, 0, 21196)
        yield 2.0

    logs = []
    for wipe in (False, False, True):
        dived = Dive(tmp_path, wipe=wipe)
        dived.fly(mission(dived), 200.0)
        logs.append(len(list(tmp_path.glob("px4/log/*/*.ulg"))))
        values.append(any("UUV_MGM_YAW 0.45" in report for report in dived.reports))
    assert values == pytest.approx([0.3, False, 0.45, True, 0.3, False])
    assert logs == [1, 2, 1]


def test_px4_moves_lights_gripper_and_camera(tmp_path: Path) -> None:
    dive = Dive(tmp_path)
    seen: list[dict[str, float]] = []

    def look(seconds: float) -> Mission:
        yield seconds
        simulation = dive.run.simulation
        assert simulation.accessories
        seen.append(simulation.accessories.positions(simulation.time_ns))

    def mission() -> Mission:
        yield from dive.dive(1.0, POSITION)
        yield from look(0.0)
        yield from dive.command(dialect.MAV_CMD_DO_SET_ACTUATOR, 0.5, *[nan] * 5, 0)
        yield from dive.command(dialect.MAV_CMD_DO_GRIPPER, 1, dialect.GRIPPER_ACTION_RELEASE)
        yield from dive.command(dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, 255, 190)
        yield from dive.command(dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, -30, 0, nan, nan, 0, 0, 0)
        yield from look(4.0)
        yield from dive.command(dialect.MAV_CMD_DO_GRIPPER, 1, dialect.GRIPPER_ACTION_GRAB)
        yield from look(4.0)

    dive.fly(mission(), 200.0)
    print(seen, dive.station.texts)
    assert [round(each["lights"], 2) for each in seen] == [1.0, 0.75, 0.75]  # those of the vehicle's file at first
    assert [each["gripper"] for each in seen] == [0.0, 1.0, 0.0]
    assert [each["camera_tilt"] for each in seen] == pytest.approx([0.0, -30 / 45, -30 / 45], abs=0.05)


def test_the_parameters_that_a_px4_started_by_hand_lacks_are_reported(tmp_path: Path) -> None:
    """It is started as an underwater vehicle, with one of the parameters of the scenario."""
    variables = {"PX4_SYS_AUTOSTART": "1022", "PX4_SIM_HOST_ADDR": "127.0.0.1", "PX4_PARAM_UUV_MGM_YAW": "0.3"}
    started = [f"{BUILD}/bin/px4", "-d", "-w", str(tmp_path), f"{BUILD}/etc"]
    dived = Dive(tmp_path, program="")
    with subprocess.Popen(started, env={**os.environ, **variables}, stdout=subprocess.DEVNULL) as process:
        try:
            dived.fly(iter([lambda: "not those" in dived.reports[-1]]), 60.0)
        finally:
            process.kill()
    (report,) = [report for report in dived.reports if "not those of this scenario" in report]
    print(report)
    assert "CA_ROTOR0_PX is 0.5, not 0.156" in report
    assert "UUV_MGM_YAW" not in report

"""Accessories of a vehicle: lights, camera tilt and gripper move in simulated time, and cameras show it."""

from math import radians
from typing import Any

import numpy as np
import pytest

from hil.autopilots.accessory_outputs import AccessoryOutputs
from hil.autopilots.parameters import FOLDER, read_parameters
from hil.common.schema import preset_folder
from hil.ros.joints import decode_accessories, encode_accessories
from sim.dynamics import State
from sim.environment.world import load_world
from sim.sensors.sensor_set import read_sensors
from sim.simulation import Simulation
from sim.vehicle.accessories import Accessories, AccessoryKeys
from sim.vehicle.vehicle import load_vehicle

S = 1_000_000_000
POOL = load_world("pool")


@pytest.fixture
def moving() -> Accessories:
    return Accessories(AccessoryKeys(tilt=radians(45.0), tilt_rate=radians(90.0), gripper_time=4.0))


def test_cameras_turn_at_their_rate_and_lights_change_at_once(moving: Accessories) -> None:
    moving.command("camera_tilt", 1.0, S)
    moving.command("lights", 0.25, S)
    assert moving.lights(S) == 0.25
    assert moving.tilt(S + S // 4) == pytest.approx(radians(22.5))
    moving.command("camera_tilt", -9.0, S + S // 4)  # limited to full tilt down
    assert moving.tilt(S + S // 2) == pytest.approx(0.0)
    assert moving.tilt(9 * S) == pytest.approx(radians(-45.0))


def test_a_gripper_stops_where_it_is(moving: Accessories) -> None:
    moving.command("gripper", 1.0, 0)
    moving.command("gripper", 0.0, S)
    assert moving.positions(3 * S)["gripper"] == pytest.approx(0.25)
    moving.command("gripper", -1.0, 3 * S)
    assert moving.positions(9 * S)["gripper"] == 0.0


@pytest.mark.parametrize(
    ("name", "share", "end"),
    [("lights", -0.5, 0.0), ("lights", 1.5, 1.0), ("camera_tilt", 1.5, 1.0), ("gripper", 0.06, 1.0),
     ("gripper", 0.04, 0.0), ("gripper", -0.04, 0.0)],
)  # fmt: skip
def test_a_share_is_limited_and_a_small_one_stops_a_gripper(
    moving: Accessories, name: str, share: float, end: float
) -> None:
    moving.command(name, share, S)
    assert moving.positions(S - 1)[name] == moving.positions(S)[name], "not before the command"
    assert moving.positions(99 * S)[name] == pytest.approx(end)


def test_a_repeated_command_goes_on_and_a_placed_camera_is_there_at_once(moving: Accessories) -> None:
    for at in range(5):  # a gripper is commanded again and again while it opens
        moving.command("gripper", 1.0, at * S)
    assert moving.positions(4 * S)["gripper"] == pytest.approx(1.0)
    moving.place(0.5, radians(-22.5))
    assert [moving.lights(0), moving.tilt(0)] == pytest.approx([0.5, radians(-22.5)])


def test_messages_of_accessories_hold_known_names_and_finite_shares() -> None:
    assert decode_accessories(encode_accessories(0, {"lights": 0.5, "gripper": -1.0})) == {"lights": 0.5, "gripper": -1}
    for wrong in ({"light": 0.5}, {"lights": float("nan")}):
        assert decode_accessories(encode_accessories(0, wrong)) is None


def picture(keys: dict[str, Any], lights: float, tilt: float) -> tuple[float, float]:
    """Return the mean level and the mean depth (m) of a picture in the dark of 60 m, 3 m over the ground."""
    world = POOL._replace(depth=63.0, cylinder=(), box=())
    camera = {"width": 32, "height": 24, "exposure": 10.0, "lamps": 1.0, "max_range": 200.0, **keys}
    simulation = Simulation(load_vehicle("bluerov2")[0], world, position=(0.0, 0.0, 60.0))
    sensor = read_sensors({"camera": camera}, "here")["camera"].build(1, simulation)
    assert simulation.accessories
    simulation.accessories.command("lights", lights, 0)
    simulation.accessories.command("camera_tilt", tilt, 0)
    sample: Any = sensor.sample(10 * S, State((0.0, 0.0, 60.0)))
    depth = np.frombuffer(sample.depth, np.float32)
    return float(np.frombuffer(sample.rgb, np.uint8).mean()), float(depth[np.isfinite(depth)].mean())


@pytest.mark.parametrize("keys", [{}, {"lamp_offset": 0.3, "backscatter": 1.0, "snow": 50.0}])
def test_lights_dim_the_lamps_of_a_camera(keys: dict[str, Any]) -> None:
    down = {"orientation": [0.0, -0.7, 0.0], **keys}
    full, half, none = (picture(down, lights, 0.0)[0] for lights in (1.0, 0.5, 0.0))
    assert full > half + 2.0
    assert half > none + 2.0


def test_tilt_turns_a_camera_unless_it_is_fixed() -> None:
    """Turned down by 45 degrees, the ground 3 m below is 3 m / sin 45 away along the axis."""
    assert picture({"field_of_view": 0.1}, 1.0, -1.0)[1] == pytest.approx(4.24, abs=0.1)
    looking_down = {"field_of_view": 0.1, "orientation": [0.0, -1.57, 0.0], "tilts": False}
    assert picture(looking_down, 1.0, 1.0)[1] == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_outputs_of_ardusub_command_what_hangs_at_them(vehicle: str, moving: Accessories) -> None:
    outputs = AccessoryOutputs(read_parameters(f"{preset_folder(FOLDER)}/ardupilot_{vehicle}.parm"))
    outputs.move((1500,) * 8 + (1700, 1100, 1900, 1100, 0, 0, 0, 0), moving, 0)
    assert moving.positions(9 * S) == {"lights": 0.75, "camera_tilt": -1.0, "gripper": 1.0}
    outputs.move((1500,) * 8 + (1100, 1100, 1900, 1100, 0, 0, 0, 0), moving, 9 * S)
    moving.command("camera_tilt", 1.0, 9 * S)  # by another: outputs that stay the same command nothing
    outputs.move((1500,) * 8 + (1100, 1100, 1500, 1100, 0, 0, 0, 0), moving, 10 * S)
    assert moving.positions(19 * S) == {"lights": 0.0, "camera_tilt": 1.0, "gripper": 1.0}
    parameters = {"SERVO3_FUNCTION": 181, "SERVO3_MIN": 1000, "SERVO3_MAX": 2000, "SERVO3_REVERSED": 1} | {
        "SERVO4_FUNCTION": 7,
        "SERVO4_MIN": 1500,
        "SERVO4_MAX": 1500,  # no range
    }
    AccessoryOutputs(parameters).move((0, 0, 1200, 1100), moving, 0)
    assert moving.lights(0) == pytest.approx(0.8)


def test_outputs_follow_parameters_that_are_set_later(moving: Accessories) -> None:
    outputs = AccessoryOutputs({"SERVO11_FUNCTION": 28})
    outputs.set_parameter("SERVO11_FUNCTION", 0)
    outputs.set_parameter("SERVO9_FUNCTION", 28)
    outputs.set_parameter("SERVO9_REVERSED", 1)
    outputs.move((1500,) * 8 + (1100, 0, 1100), moving, 0)
    assert moving.positions(9 * S)["gripper"] == 1.0


def test_outputs_of_px4_command_from_the_first_that_is_not_neutral(moving: Accessories) -> None:
    """PX4 sends 0 for an output without command, the neutral pulse."""
    outputs = AccessoryOutputs({"PWM_MAIN_FUNC13": 301, "PWM_MAIN_FUNC14": 430, "PWM_MAIN_FUNC15": 421})
    before = moving.positions(0)
    outputs.move((1500,) * 16, moving, 0)
    assert moving.positions(9 * S) == before
    outputs.move((1500,) * 12 + (1300, 1100, 1700, 1500), moving, 9 * S)
    assert moving.positions(19 * S) == {"lights": 0.25, "camera_tilt": 0.5, "gripper": 1.0}

"""The motor test: each motor alone, compared with the frame; a thruster that pushes another way is found."""

import pytest

from hil.autopilots.frames import Motor, MotorMap, map_motors
from hil.autopilots.motor_test import test_motors as turn_motors
from hil.cli import main
from hil.scenario.config import load_scenario
from sim.vehicle.vehicle import load_vehicle


def test_every_motor_agrees_with_the_frame() -> None:
    scenario = load_scenario("ardusub")
    vehicle, _ = load_vehicle(scenario.vehicle)
    results = turn_motors(scenario, vehicle, map_motors("vectored_6dof", vehicle))
    assert [result.number for result in results] == list(range(1, 9))
    assert all(result.agrees for result in results)
    assert results[0].push.startswith("astern, to the right")
    assert "bow down" in results[4].push


def test_a_motor_with_the_wrong_sign_is_found() -> None:
    scenario = load_scenario("ardusub")
    vehicle, _ = load_vehicle(scenario.vehicle)
    sound = map_motors("vectored_6dof", vehicle)
    motors = [Motor(m.output, m.channel, -m.sign if m.output == 2 else m.sign) for m in sound.motors]
    results = turn_motors(scenario, vehicle, MotorMap("vectored_6dof", motors, 8))
    assert [result.number for result in results if not result.agrees] == [3]


def test_the_command_prints_motors_and_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["autopilot", "motors", "ardusub"]) == 0
    assert "motor 1 (front_right, mirrored): astern, to the right, turn right" in capsys.readouterr().out
    assert main(["autopilot", "parameters", "ardusub"]) == 0
    assert "FRAME_CONFIG 2\n" in capsys.readouterr().out
    assert main(["autopilot", "motors", "paper_field"]) == 2
    assert "no autopilot" in capsys.readouterr().err

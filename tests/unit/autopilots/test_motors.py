"""Checks between an autopilot's outputs and the thrusters: timeout, arming, a frame that does not match."""

from hil.autopilots.contract import Outputs
from hil.autopilots.frames import map_motors
from hil.autopilots.motors import MotorOutputs
from sim.vehicle.vehicle import load_vehicle

MS = 1_000_000


def make(reports: list[str], name: str = "bluerov2") -> MotorOutputs:
    return MotorOutputs(map_motors("auto", load_vehicle(name)[0]), 200 * MS, "ArduPilot", reports.append)


def test_a_timeout_sets_the_thrusters_to_neutral_once() -> None:
    reports: list[str] = []
    motors = make(reports)
    assert motors.at(10**12).pwm_us == (1500,) * 6  # no output was received, so there is no timeout to report
    assert motors.update(Outputs((1600,) * 6, None, 0)).pwm_us == (1600,) * 6
    assert motors.at(200 * MS).pwm_us == (1600,) * 6
    for now in (201 * MS, 400 * MS):
        assert motors.at(now) == ((1500,) * 6, False)
    assert motors.silences == 1
    assert reports == ["ArduPilot: no outputs for 0.2 s: thrusters neutral"]
    assert motors.update(Outputs((1600,) * 6, None, 900 * MS)).pwm_us == (1600,) * 6


def test_disarmed_thrusters_are_neutral_for_any_pulse_width() -> None:
    motors = make([])
    assert motors.update(Outputs((1700,) * 6, False, 0)) == ((1500,) * 6, False)
    assert motors.update(Outputs((1700,) * 6, True, 0)) == ((1700,) * 6, True)


def test_missing_outputs_at_boot_are_not_reported_as_a_wrong_frame() -> None:
    reports: list[str] = []
    motors = make(reports)
    for step in range(100):
        assert motors.update(Outputs((0,) * 16, None, step * 100 * MS)) == ((1500,) * 6, False)
    assert reports == []

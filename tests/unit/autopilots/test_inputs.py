"""Sensors of an autopilot: what remains of their errors after a calibration, and no value for an old one."""

from math import degrees, isnan
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from hil.autopilots.inputs import SensorInputs
from hil.scenario.config import build_simulation, load_scenario
from sim.environment.world import load_world
from sim.sensors.extra_samples import BatterySample, RangeSample
from sim.vehicle.vehicle import load_vehicle

SCENARIO = """
vehicle = "bluerov2"
world = "open_water"
controller = "ardupilot"
master = {}
[sensors.imu]
[sensors.altimeter]
rate = 10
[sensors.battery]
rate = 1
"""
SECOND = 1_000_000_000


@pytest.mark.parametrize("preset", ["ardusub", "px4_uuv"])
@pytest.mark.parametrize("seed", range(1, 6))
def test_the_imu_of_a_preset_is_calibrated_as_before_a_dive(preset: str, seed: int) -> None:
    """An uncalibrated one, with the default errors, is 0.5 degrees a second and 1 degree of tilt off (1 sigma)."""
    scenario = load_scenario(preset)
    simulation = build_simulation(scenario, load_vehicle(scenario.vehicle)[0], load_world(scenario.world))
    imu = scenario.sensors["imu"].build(seed, simulation)
    period = round(SECOND / scenario.sensors["imu"].model.rate)
    samples: list[Any] = [imu.sample(i * period, simulation.state) for i in range(2000)]
    rates = [fmean(sample.angular_velocity[axis] for sample in samples) for axis in range(3)]
    tilts = [fmean(sample.acceleration[axis] for sample in samples) / 9.81 for axis in range(2)]
    assert max(map(abs, rates)) < 1e-3  # rad/s: within what an estimator finds
    assert degrees(max(map(abs, tilts))) < 0.5


def test_a_sensor_that_has_been_silent_for_three_periods_has_no_value(tmp_path: Path) -> None:
    path = tmp_path / "silent.toml"
    path.write_text(SCENARIO)
    scenario = load_scenario(str(path))
    inputs = SensorInputs(scenario, load_world(scenario.world))
    inputs.update("altimeter", RangeSample(SECOND, 8.01, (0.3, 100.0)))
    inputs.update("battery", BatterySample(SECOND, 16.0, 5.0, 10.0, 18.0, False))
    inputs.expire(SECOND + SECOND // 5)
    assert inputs.range_m == 8.01
    inputs.expire(SECOND + SECOND // 2)
    assert inputs.range_m is not None
    assert isnan(inputs.range_m)
    assert inputs.battery.voltage == 16.0
    inputs.expire(5 * SECOND)
    assert inputs.battery.voltage == 0.0

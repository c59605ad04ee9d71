"""Named devices: each is read, its errors come through, and the reference filter flies by them."""

from math import dist, radians
from pathlib import Path
from random import Random
from statistics import fmean, pstdev
from typing import Any

import pytest

from hil.common.schema import preset_names
from hil.common.tables import read_table
from sim import load_device
from sim.dynamics import State
from sim.environment.world import World
from sim.sensors.error import ErrorModel, ErrorProcess
from sim.sensors.imu import Imu, ImuModel
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import DEVICES, SensorSpec
from sim.simulation import Simulation
from tests.support.fitted import EXACT, VEHICLE, scene
from tests.support.processes import ROOT, Program

SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 20.0, gravity=9.8)
EXACT_IMU = ImuModel(rate=20.0, attitude=EXACT, angular_velocity=EXACT, acceleration=EXACT)


@pytest.mark.parametrize("name", preset_names(DEVICES))
def test_each_device_is_read_and_says_where_its_numbers_are_from(name: str) -> None:
    spec = load_device(name)
    assert spec.model != type(spec.model)()
    source = read_table(str(ROOT / DEVICES / f"{name}.toml"))["source"]
    assert ":" in source


def test_errors_of_warming_up_decay_and_outliers_are_rare() -> None:
    random_numbers = Random(4)
    warm = ErrorProcess(ErrorModel(warm_up=1.0, warm_up_time=10.0), 1.0, random_numbers)
    values = [warm.measure(5.0) - 5.0 for _ in range(100)]
    assert values[10] == pytest.approx(values[0] / 2.718281828459045)
    assert abs(values[99]) < 1e-3 * abs(values[0])
    rare = ErrorProcess(ErrorModel(outliers=0.1, outlier=1.0), 1.0, random_numbers)
    off = [rare.measure(5.0) - 5.0 for _ in range(5000)]
    assert sum(x != 0.0 for x in off) == pytest.approx(500, rel=0.15)
    assert pstdev([x for x in off if x]) == pytest.approx(1.0, rel=0.1)
    growing = ErrorProcess(ErrorModel(noise=0.3, noise_share=0.1), 1.0, random_numbers)
    assert pstdev([growing.measure(4.0) for _ in range(5000)]) == pytest.approx(0.5, rel=0.05)


def test_a_misalignment_turns_the_sensor_but_not_what_is_known_of_it() -> None:
    spec = SensorSpec(Imu, EXACT_IMU, Mounting(orientation=(0.0, 0.0, 1.0), misalignment=0.01))
    samples: list[Any] = [spec.build(seed, scene(SEA)).sample(0, State()) for seed in range(400)]
    across = [sample.acceleration[0] / 9.8 for sample in samples]
    assert pstdev(across) == pytest.approx(0.01, rel=0.1)
    assert fmean(across) == pytest.approx(0.0, abs=0.002)
    assert spec.mounting.quaternion == Mounting(orientation=(0.0, 0.0, 1.0)).quaternion
    assert spec.build(3, scene(SEA)).sample(0, State()) == samples[3]


def test_gyros_feel_the_specific_force_by_their_g_sensitivity() -> None:
    model = EXACT_IMU._replace(g_sensitivity=1e-3)
    samples = [Imu(model, Mounting(), seed, scene(SEA)).sample(0, State()) for seed in range(300)]
    assert pstdev([x for s in samples for x in s.angular_velocity]) == pytest.approx(9.8e-3, rel=0.08)


def test_samples_with_jitter_arrive_late_and_none_is_lost() -> None:
    spec = SensorSpec(Imu, EXACT_IMU, Mounting(latency=0.01, jitter=0.03))
    simulation = Simulation(VEHICLE, SEA, {"imu": spec}, position=(0.0, 0.0, 5.0))
    late = [simulation.time_ns - s.time_ns for _ in range(2000) for _, s in simulation.step((1500,) * 8)]
    assert len(late) >= 98
    assert min(late) >= 10_000_000
    assert max(late) < 45_000_000
    assert pstdev(late) > 6e6


def test_the_reference_filter_flies_to_its_goal(tmp_path: Path) -> None:
    """It is off by the error of its heading, 2 deg, and of its velocity log, 1 %."""
    devices = {"imu": "vectornav_vn100", "dvl": "waterlinked_a50", "pressure": "bar30"}
    text = '[planner]\nclass = "reference_filter:StraightByFilter"\n'
    text += "".join(f'{kind} = "{name}"\n' for kind, name in devices.items())
    text += "".join(f'[sensors.{kind}]\ndevice = "{name}"\n' for kind, name in devices.items())
    task = 'vehicle = "bluerov2_heavy"\nworld = "open_water"\n[master]\ngoal = [30.0, 20.0]\ndepth = 8.0\nspeed = 0.8\n'
    (tmp_path / "mine.toml").write_text(task + text)
    (tmp_path / "reference_filter.py").write_text((ROOT / "examples/navigation/reference_filter.py").read_text())
    with Program(tmp_path, "sim", "mine.toml", "--fast", "--output", "flight.csv", cwd=tmp_path) as sim:
        assert sim.wait() == 0, sim.output
    north, east = [float(x) for x in (tmp_path / "flight.csv").read_text().splitlines()[-1].split(",")[1:3]]
    assert 0.0 < dist((north, east), (30.0, 20.0)) < 0.5 + 36.0 * 3.0 * (radians(2.0) + 0.01)

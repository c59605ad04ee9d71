"""The simulation of one vehicle: repeatability, rates of samples, motion, collisions, refused arguments."""

from collections import Counter

import pytest

from hil.common.errors import ConfigError
from sim.environment.world import load_world
from sim.sensors.imu import ImuModel
from sim.sensors.mounting import Mounting
from sim.sensors.odometry import OdometryModel
from sim.sensors.ranging.dvl import Dvl, DvlModel
from sim.sensors.sensor_set import SensorSet, SensorSpec, read_sensors, select_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("paper_six")
FIELD = load_world("paper_field")
IDLE = (1500,) * 6


def test_a_sensor_does_not_change_the_samples_of_others() -> None:
    def imu(sensors: SensorSet) -> list[object]:
        simulation = Simulation(VEHICLE, FIELD, sensors, seed=3, position=(0, 0, 3))
        return [sample for _ in range(200) for topic, sample in simulation.step(IDLE) if topic == "imu"]

    alone = select_sensors(dvl=None, odometry=OdometryModel(rate=3.0))
    assert imu(select_sensors()) == imu(alone)
    assert len(imu(select_sensors())) == 50


def test_sample_rates_do_not_drift() -> None:
    """A rate of 7 Hz does not divide 400 Hz: 20 s hold 7 samples a second, each with the first step due."""
    simulation = Simulation(VEHICLE, FIELD, select_sensors(dvl=DvlModel(rate=7.0)), position=(0, 0, 3))
    counts: Counter[str] = Counter()
    for step in range(1, 8001):
        for topic, sample in simulation.step(IDLE):
            counts[topic] += 1
            assert sample.time_ns == step * 2_500_000
            if topic == "dvl":
                assert 0 <= sample.time_ns - counts["dvl"] * 1e9 / 7.0 < 2_500_001
    assert simulation.time_ns == 20_000_000_000
    assert counts == {"imu": 2000, "dvl": 139 if 20e9 < 140 * 142_857_143 else 140, "pressure": 400, "odom": 400,
                      "ground_truth": 400}  # fmt: skip


def test_a_collision_appears_in_the_acceleration() -> None:
    simulation = Simulation(VEHICLE, load_world("pool"), position=(8.5, 0.0, 2.0))
    hardest = 0.0
    for _ in range(1200):
        simulation.step((1900, 1900, 1900, 1900, 1500, 1500))
        hardest = min(hardest, simulation.state.nu_dot[0])
    assert simulation.contacts > 0
    assert hardest < -20.0


def test_a_start_in_an_obstacle_and_a_rate_above_the_step_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"paper_six cannot start at .*; move the start"):
        Simulation(VEHICLE, FIELD, position=(6.5, 7.5, 3.0))
    with pytest.raises(ConfigError, match="'imu': its rate is above 400 Hz"):
        Simulation(VEHICLE, FIELD, select_sensors(imu=ImuModel(rate=500.0)))


def test_sensor_sections_of_a_scenario_change_the_defaults() -> None:
    table = {"imu": {"rate": "50 Hz", "acceleration": {"noise": 0.1}}, "dvl": {"rate": 0}, "odometry": {"rate": 10}}
    sensors = read_sensors(table, "scenario.toml: sensors")
    assert sensors["imu"].model.acceleration.noise == 0.1
    assert sensors["imu"].model.angular_velocity == ImuModel().angular_velocity
    simulation = Simulation(VEHICLE, FIELD, sensors, position=(0, 0, 3))
    counts = Counter(topic for _ in range(400) for topic, _ in simulation.step(IDLE))
    assert counts == {"imu": 50, "pressure": 20, "odom": 10, "ground_truth": 20}


def test_latency_delays_samples_and_drop_out_loses_them() -> None:
    """A late sample has the time of its measurement; a lost one does not change the others."""

    def dvl(mounting: Mounting) -> list[tuple[int, object]]:
        sensors = select_sensors(dvl=SensorSpec(Dvl, DvlModel(rate=10.0), mounting))
        simulation = Simulation(VEHICLE, FIELD, sensors, seed=2, position=(0, 0, 3))
        stream = ((simulation.time_ns, pair) for _ in range(8000) for pair in simulation.step(IDLE))
        return [(now, sample) for now, (topic, sample) in stream if topic == "dvl"]

    prompt, late, lossy = dvl(Mounting()), dvl(Mounting(latency=0.33)), dvl(Mounting(drop_out=0.25))
    assert [now for now, _ in prompt] == [k * 100_000_000 for k in range(1, 201)]
    assert [now for now, _ in late] == [now + 330_000_000 for now, _ in prompt[:-4]]
    assert [sample for _, sample in late] == [sample for _, sample in prompt[:-4]]
    assert set(lossy) < set(prompt)
    assert 25 < len(prompt) - len(lossy) < 75
    silent = dvl(Mounting(drop_out=1.0, drop_out_from=5.0, drop_out_until=15.0))
    assert silent == [(now, sample) for now, sample in prompt if not 5 * 10**9 <= now < 15 * 10**9]

"""The same scenario and seed give the same bits: over many steps, in another process, with and without C."""

import os
import subprocess
import sys
from hashlib import sha256
from itertools import cycle
from pathlib import Path

from sim.environment.world import load_world
from sim.native import choose
from sim.sensors.imu import ImuModel
from sim.sensors.odometry import GroundTruthModel, OdometryModel
from sim.sensors.ranging.dvl import DvlModel
from sim.sensors.sensor_set import select_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

ROOT = Path(__file__).parents[3]
STEPS = 15_000  # 37 s at 400 Hz


def fingerprint(steps: int) -> str:
    """Return the number of the step and every bit of every sample and of the end state."""
    vehicle, _ = load_vehicle("paper_six")
    world = load_world("paper_field")._replace(current=(0.02, -0.01, 0.0))
    sensors = select_sensors(
        imu=ImuModel(4.0), dvl=DvlModel(1.0), odometry=OdometryModel(1.0), ground_truth=GroundTruthModel(1.0)
    )
    simulation = Simulation(vehicle, world, sensors, seed=11, position=(4.0, 5.0, 3.0), heading=0.7)
    digest = sha256()
    pulses = cycle([(1560, 1540, 1545, 1555, 1510, 1490), (1440, 1462, 1455, 1450, 1490, 1510), (1500,) * 6])
    pwm_us = next(pulses)
    for step in range(steps):
        if step % 3000 == 0:
            pwm_us = next(pulses)
        for topic, sample in simulation.step(pwm_us):
            digest.update(f"{topic} {sample!r}".encode())
    digest.update(repr((simulation.truth(), simulation.contacts)).encode())
    return f"{choose()[0].__name__} {digest.hexdigest()}"


def check_repeats(steps: int) -> None:
    """Assert that two processes, one without C and with another hash seed, have the same bits after so many steps."""
    code = f"from tests.process.sim.test_determinism import fingerprint; print(fingerprint({steps}))"
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": seed, "UUV_HIL_NATIVE": native},
        )
        for seed, native in (("1", "0"), ("2", ""))
    ]  # fmt: skip
    (python, one), (quickest, other) = (process.communicate()[0].split() for process in processes)
    assert python == "Dynamics"
    assert quickest == choose()[0].__name__  # the C, where it was compiled
    assert one == other
    assert fingerprint(2000).split()[1] != one


def test_many_steps_repeat_bit_for_bit_in_another_process() -> None:
    check_repeats(STEPS)

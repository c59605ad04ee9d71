"""The same simulation in Python and in C, with the same pulses, compared bit for bit after each step."""

import os
import random
from collections.abc import Sequence
from struct import pack
from typing import Any

import pytest

from sim.dynamics import State
from sim.environment.world import World
from sim.rotations import normalise
from sim.sensors.imu import Imu, ImuModel
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import SensorSpec, select_sensors
from sim.simulation import Simulation
from sim.vehicle.vehicle import Vehicle, load_vehicle

HEAVY, _ = load_vehicle("bluerov2_heavy")
PULSES = (0, 1100, 1480, 1500, 1650, 1900, 2500)
SENSORS = select_sensors(imu=SensorSpec(Imu, ImuModel(100.0), Mounting((0.1, -0.2, 0.05))))


def twins(
    monkeypatch: pytest.MonkeyPatch, world: World, vehicle: Vehicle = HEAVY, **others: Any
) -> tuple[Simulation, Simulation]:
    """Return the same simulation in Python and in C; `others` are further arguments of Simulation."""
    arguments = {"sensors": SENSORS, "seed": 3, "position": (0.0, 0.0, 3.0), "heading": 0.4, **others}
    pair = []
    for native in "01":
        monkeypatch.setenv("UUV_HIL_NATIVE", native)
        pair.append(Simulation(vehicle, world, **arguments))
    python, quick = pair
    assert type(python.state) is State
    assert type(quick.state) is not State
    return python, quick


def all_of(simulation: Simulation) -> bytes:
    """Return every bit that can be read: == would take -0.0 for 0.0."""
    state, equipment = simulation.state, simulation.equipment
    values = [state.position, state.quaternion, state.nu, state.nu_dot, simulation.thrusts, *simulation.forces()]
    servos = (equipment.fins, equipment.azimuths, equipment.bladder) if equipment else ()
    values += [part.servos.values for part in servos if part]
    numbers = [x for part in values for x in part]
    return pack(f"{len(numbers)}d?q", *numbers, simulation.touching, simulation.contacts)


class Ride:
    """Two simulations with the same pulses, which change now and then; they are compared after each step."""

    def __init__(self, pair: tuple[Simulation, Simulation], seed: int = 1) -> None:
        self.pair = pair
        self.rng = random.Random(seed)
        self.samples = self.touches = 0
        self._pulses = [1500] * len(pair[0].vehicle.channels)

    def run_and_compare(self, steps: int, choices: Sequence[int] = PULSES) -> None:
        for step in range(steps):
            if step % 60 == 0:  # in place: the same list, with other numbers
                self._pulses[:] = [self.rng.choice(choices) for _ in self._pulses]
            held = tuple(self._pulses)
            given: Sequence[int] = self._pulses if step % 7 else held
            outputs = []
            for native, simulation in zip("01", self.pair, strict=True):
                os.environ["UUV_HIL_NATIVE"] = native  # one that drops a weight is built again
                outputs.append(simulation.step(given))
            assert repr(outputs[0]) == repr(outputs[1])
            assert all_of(self.pair[0]) == all_of(self.pair[1])
            self.samples += len(outputs[0])
            self.touches += self.pair[0].touching

    def set_position(self, position: Sequence[float]) -> None:
        """Place both, as the slave's loop does, with random attitude and velocity."""
        quaternion = normalise([self.rng.uniform(-1.0, 1.0) for _ in range(4)])
        nu = [self.rng.uniform(-2.0, 2.0) for _ in range(6)]
        for simulation in self.pair:
            state = simulation.state
            state.position, state.quaternion, state.nu = list(position), list(quaternion), list(nu)
            state.nu_dot = [0.0] * 6

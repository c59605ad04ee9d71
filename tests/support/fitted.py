"""Sensors on a vehicle at rest: the worlds around it, and what its sensors are made with."""

from typing import Any

import numpy as np

from sim.environment.world import World
from sim.sensors.error import ErrorModel
from sim.sensors.mounting import Mounting
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

EXTENT = (-60.0, 60.0, -60.0, 60.0)
VEHICLE, _ = load_vehicle("bluerov2_heavy")
FLAT = World("flat", "test", EXTENT, 20.0)
DEEP = FLAT._replace(depth=500.0)
EXACT = ErrorModel()
NU = (0.8, -0.3, 0.2, 0.4, -0.5, 0.6)
ASKEW = Mounting((0.3, -0.1, 0.2), (0.3, -0.4, 2.5))


def scene(world: World = FLAT, depth: float = 5.0) -> Simulation:
    return Simulation(VEHICLE, world, {}, position=(0.0, 0.0, depth))


def image(sample: Any) -> Any:
    """Return the echoes of a sonar's sample, bins x beams."""
    return np.frombuffer(sample.intensities, sample.encoding).reshape(sample.bins, -1)

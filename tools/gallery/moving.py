"""Plots of sensors whose samples are a few numbers: their samples during a flight, and the true values."""

from collections import defaultdict
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim.environment.world import load_world
from sim.rotations import rotate_inverse, to_euler
from sim.sensors.sensor_set import SENSORS, read_sensors, select_sensors
from sim.simulation import Simulation
from tools.gallery.places import INK, SEED, SOFT, VEHICLE, Entry

_SECONDS, _STEPS = 40, 400
_AHEAD, _TURN, _REST = (
    (1580, 1580, 1420, 1420, 1500, 1500, 1500, 1500),
    (1580, 1540, 1460, 1420, 1530, 1530, 1530, 1530),
    (1500,) * 8,
)
_FITTED = ("imu", "dvl", "pressure", "odometry", "ground_truth", "ahrs", "magnetometer", "altimeter", "gps")


@lru_cache(maxsize=1)
def _flight() -> dict[str, list[Any]]:
    """Return all samples of a flight by topic: ahead, in a curve, then drifting, near the surface of `fractal`."""
    world = load_world("fractal")._replace(origin=(57.7, 11.9))
    sensors = select_sensors(**{name: read_sensors({name: {}}, "gallery")[name] for name in _FITTED if name in SENSORS})
    simulation = Simulation(VEHICLE, world, sensors, seed=SEED, position=(-10.0, 0.0, 0.4))
    samples: dict[str, list[Any]] = defaultdict(list)
    for step in range(_SECONDS * _STEPS):
        pulses = (_AHEAD, _TURN, _REST)[min(2, step // (15 * _STEPS))]
        for topic, sample in simulation.step(pulses):
            samples[topic].append(sample)
    return samples


def _plot_quantity(axes: Any, topic: str, quantity: Any, label: str, truth: Any = None, **style: Any) -> None:
    """Plot one quantity of a topic's samples over time, and that of the true state."""
    flight = _flight()
    if truth:
        rows = flight["ground_truth"]
        axes.plot([s.time_ns * 1e-9 for s in rows], [truth(s) for s in rows], color=SOFT, linewidth=2.5, label="true")
    rows = flight[topic]
    axes.plot([s.time_ns * 1e-9 for s in rows], [quantity(s) for s in rows], color=INK, linewidth=0.7, **style)
    axes.set_ylabel(label)
    axes.margins(x=0.0)


def imu(figure: Figure) -> None:
    """A flight of 40 s: 15 s ahead, 15 s in a curve, then drifting. Turn rate about the vertical and specific force
    along the vehicle, over the true values."""
    rate, force = figure.subplots(2, 1, sharex=True)
    _plot_quantity(rate, "imu", lambda s: s.angular_velocity[2], "r, rad/s", lambda s: s.nu[5])
    _plot_quantity(force, "imu", lambda s: s.acceleration[0], "x, m/s²")
    force.set_xlabel("time, s")


def dvl_and_pressure(figure: Figure) -> None:
    """The same flight. The log's velocity ahead and the depth that follows from the pressure, over the truth."""
    speed, depth = figure.subplots(2, 1, sharex=True)
    _plot_quantity(speed, "dvl", lambda s: s.velocity[0], "u, m/s", lambda s: s.nu[0])
    _plot_quantity(depth, "pressure", lambda s: (s.pascal - 101_325.0) / (1025.0 * 9.80665), "depth, m",
           lambda s: s.position[2])  # fmt: skip
    depth.invert_yaxis()
    depth.set_xlabel("time, s")


def heading_and_field(figure: Figure) -> None:
    """The same flight. Heading by the attitude reference, and the field along the vehicle by the magnetometer."""
    heading, field = figure.subplots(2, 1, sharex=True)

    def course(sample: Any) -> float:
        return float(np.degrees(to_euler(sample.orientation)[2]))

    north = 49e-6 * np.cos(1.15), 0.0, 49e-6 * np.sin(1.15)
    _plot_quantity(heading, "ahrs", course, "heading, deg", course)
    _plot_quantity(field, "magnetometer", lambda s: s.field[0] * 1e6, "x, uT",
           lambda s: rotate_inverse(s.orientation, north)[0] * 1e6)  # fmt: skip
    field.set_xlabel("time, s")


def altimeter(figure: Figure) -> None:
    """The same flight over rough ground: the distance to the seabed along a thin beam, straight down."""
    axes = figure.add_subplot()
    _plot_quantity(axes, "altimeter", lambda s: s.distance, "distance, m")
    axes.set_xlabel("time, s")


ENTRIES = (
    Entry("imu", "Inertial measurement unit", (imu,), (8.0, 3.6)),
    Entry("pressure", "Pressure, and velocity over ground", (dvl_and_pressure,), (8.0, 3.6)),
    Entry("magnetometer", "Attitude reference and magnetometer", (heading_and_field,), (8.0, 3.6)),
    Entry("altimeter", "Altimeter", (altimeter,), (8.0, 2.4)),
)

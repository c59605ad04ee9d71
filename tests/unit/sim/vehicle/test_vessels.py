"""Surface vessels against the models and data that they are from: PythonVehicleSimulator, MSS, Clearpath."""

from math import atan2, cos, pi, radians, sin, sqrt

import pytest

from sim.environment.world import World
from sim.simulation import Simulation
from sim.vehicle.hydrostatics import afloat
from sim.vehicle.vehicle import load_vehicle

OTTER, HERON = load_vehicle("otter")[0], load_vehicle("heron")[0]
G = 9.81
SEA = World("sea", "test", (-500.0, 500.0, -500.0, 500.0), 100.0, density=1025.0, gravity=G)
LAKE = SEA._replace(density=1000.0)
# Bollard pull of one propeller and its coefficient: otter.py of PythonVehicleSimulator.
FULL_SPEED, FULL_ASTERN = sqrt(0.5 * 24.4 * G / (0.5 * 0.02216)), sqrt(0.5 * 13.6 * G / (0.5 * 0.01289))
# Computed with otter.py of PythonVehicleSimulator (MIT licence, commit c717e07), steps of 2 ms, from rest: speeds of
# the left and right propeller (rad/s), time (s), u, v (m/s), r (rad/s), distance from the start (m). Its payload is
# corrected: the inertia of MSS (otter.m: lever arms from the common centre of gravity), no second weight.
RUNS = [
    (60.0, 60.0, 2.0, 0.83575, 0.0, 0.0, 0.98347),
    (60.0, 60.0, 5.0, 1.01605, 0.0, 0.0, 3.87138),
    (60.0, 60.0, 10.0, 1.02851, 0.0, 0.0, 9.00092),
    (100.0, 100.0, 2.0, 2.32172, 0.0, 0.0, 2.73233),
    (100.0, 100.0, 5.0, 2.82241, 0.0, 0.0, 10.75452),
    (100.0, 100.0, 10.0, 2.85698, 0.0, 0.0, 25.00331),
    (100.0, 80.0, 2.0, 1.89048, -0.09848, 0.187715, 2.23150),
    (100.0, 80.0, 5.0, 2.23326, -0.20400, 0.253052, 8.42938),
    (100.0, 80.0, 10.0, 2.23854, -0.21314, 0.257585, 16.23860),
    (80.0, -60.0, 2.0, 0.49612, -0.03689, 0.243422, 0.58441),
    (80.0, -60.0, 5.0, 0.59082, -0.05589, 0.245416, 2.18968),
    (80.0, -60.0, 10.0, 0.59515, -0.05739, 0.245579, 4.26860),
    (-80.0, -80.0, 10.0, -1.06358, 0.0, 0.0, 9.30771),
]


def pulse(speed: float) -> int:
    return round(1500.0 + 400.0 * speed / (FULL_SPEED if speed > 0.0 else FULL_ASTERN))


@pytest.mark.parametrize("run", RUNS)
def test_the_otter_moves_as_pythonvehiclesimulators(run: tuple[float, ...]) -> None:
    left, right, time, u, v, r, distance = run
    simulation = Simulation(OTTER, SEA)
    while simulation.time_ns < time * 1e9:
        simulation.step((pulse(left), pulse(right)))
    nu, position = simulation.state.nu, simulation.state.position
    assert (nu[0], nu[1], nu[5]) == pytest.approx((u, v, r), rel=0.02, abs=1e-4)
    assert sqrt(position[0] ** 2 + position[1] ** 2) == pytest.approx(distance, rel=0.02)


def test_the_otter_floats_as_fossens() -> None:
    """The hydrostatics of MSS, otter.m, by its own formulas (Fossen 2021, chapter 4)."""
    volume, length, beam, fullness = 80.0 / 1025.0, 2.0, 0.25, 0.75
    draught = volume / (2.0 * 0.4 * beam * length)
    plane = 2.0 * fullness * length * beam
    shape = 6.0 * fullness**3 / ((1.0 + fullness) * (1.0 + 2.0 * fullness))
    across = length * beam**3 / 6.0 * shape + plane * 0.395**2
    along = 0.8 * beam * length**3 / 6.0
    above_keel = (2.5 * draught - 0.5 * volume / (length * beam)) / 3.0 - (draught + 0.246875)
    floating = afloat(OTTER, 1025.0, G)
    assert floating
    assert floating.depth == pytest.approx(0.0, abs=1e-4)
    assert floating.trim == pytest.approx(0.0, abs=1e-4)
    assert (floating.draught, floating.waterplane) == pytest.approx((draught, plane), rel=1e-3)
    heights = across / volume + above_keel, along / volume + above_keel
    assert floating.metacentres == pytest.approx(heights, rel=0.01)


def test_the_heron_has_its_draught_and_rated_speed() -> None:
    """Clearpath's manual: 150 mm with 10 kg of payload, 1.7 m/s; without payload the mesh displaces 29 kg at 124 mm."""
    loaded, light = afloat(HERON._replace(mass=39.0), 1000.0, G), afloat(HERON, 1000.0, G)
    assert loaded
    assert light
    assert loaded.draught == pytest.approx(0.15, abs=0.002)
    assert light.draught == pytest.approx(0.124, abs=0.002)
    simulation = Simulation(HERON, LAKE)
    for _ in range(400 * 12):
        simulation.step((1900, 1900))
    assert simulation.state.nu[0] == pytest.approx(1.7, rel=0.02)
    assert abs(simulation.state.position[2]) < 0.05, "it stays at the surface"


def test_a_current_carries_a_vessel() -> None:
    """Adrift in a current it takes up the current's velocity, and keeps to the surface."""
    flow = 0.5 * cos(radians(30.0)), 0.5 * sin(radians(30.0)), 0.0
    simulation = Simulation(OTTER, SEA._replace(current=flow))
    for _ in range(400 * 20):
        simulation.step((1500, 1500))
    w, _, _, z = simulation.state.quaternion
    heading = 2.0 * atan2(z, w)
    assert abs(heading) < pi / 2.0
    u, v, *_ = simulation.state.nu
    ground = u * cos(heading) - v * sin(heading), u * sin(heading) + v * cos(heading)
    assert ground == pytest.approx(flow[:2], abs=0.01)

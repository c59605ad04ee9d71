"""Wind: Blendermann's force on a vessel, the share above the water, gusts of the right size and length."""

from math import cos, pi, radians, sin, sqrt

import pytest

from sim.environment.wind import Wind, WindForce
from sim.environment.world import World
from sim.rotations import matrix
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

OTTER, REMUS = load_vehicle("otter")[0], load_vehicle("remus100")[0]
LEVEL = matrix((1.0, 0.0, 0.0, 0.0))
AIR = 1.225


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 90.0, 135.0, 180.0])
def test_the_force_is_blendermanns(angle: float) -> None:
    """Fossen 2021, eq. 10.11 to 10.15, with the angle of attack from the bow: 0 ahead, 90 deg from starboard's side."""
    windage, attack = OTTER.windage, radians(angle)
    assert windage
    force = WindForce(OTTER, Wind(8.0, direction=attack + pi), None, 1)
    surge, sway, heave, roll, _, yaw = force.wrench((0.0, 0.0, 0.0), LEVEL, (0.0,) * 6)
    speed = 8.0 * (0.3 / 10.0) ** (1.0 / 7.0)
    along = 0.55 * windage.frontal_area / windage.lateral_area
    bracket = 1.0 - 0.5 * 0.6 * (1.0 - along / 0.9) * sin(2.0 * attack) ** 2
    c_x = -along * windage.lateral_area / windage.frontal_area * cos(attack) / bracket
    c_y = 0.9 * sin(attack) / bracket
    pressure = 0.5 * AIR * speed * speed
    assert surge == pytest.approx(pressure * c_x * windage.frontal_area, abs=1e-9)
    assert sway == pytest.approx(-pressure * c_y * windage.lateral_area, abs=1e-9)
    arm = -0.18 * (attack - 0.5 * pi)
    assert yaw == pytest.approx(-pressure * arm * c_y * windage.lateral_area * 2.0, abs=1e-9)
    assert heave == 0.0
    assert roll == pytest.approx(0.3 * sway)


def test_only_what_is_above_the_water_counts() -> None:
    force = WindForce(OTTER, Wind(8.0, 0.5 * pi), None, 1)
    sways = [force.wrench((0.0, 0.0, depth), LEVEL, (0.0,) * 6)[1] for depth in (-1.0, 0.0, 0.3, 0.6, 5.0)]
    assert sways == pytest.approx([sways[0], sways[0], 0.5 * sways[0], 0.0, 0.0])
    assert sways[0] > 1.0
    dived = WindForce(REMUS, Wind(20.0), None, 1)
    assert not any(dived.wrench((0.0, 0.0, 1.0), LEVEL, (0.0,) * 6))
    assert dived.wrench((0.0, 0.0, 0.0), LEVEL, (0.0,) * 6)[0] > 0.1, "half of its hull is out of the water"


def test_gusts_have_their_deviation_and_their_time_scale() -> None:
    """From the force on a vessel at rest, which grows with the square of the speed; over 4000 s in steps of 0.5 s."""
    wind = Wind(10.0, gusts=0.2, gust_time=8.0, components=100)
    force, speeds = WindForce(OTTER, wind, None, 3), []
    calm = WindForce(OTTER, wind._replace(gusts=0.0), None, 3).wrench((0.0, 0.0, 0.0), LEVEL, (0.0,) * 6)[0]
    for step in range(8000):
        force.begin(step * 500_000_000)
        speeds.append(sqrt(force.wrench((0.0, 0.0, 0.0), LEVEL, (0.0,) * 6)[0] / calm) - 1.0)
    square = sum(x * x for x in speeds) / len(speeds)
    assert sqrt(square) == pytest.approx(0.2, rel=0.05)
    correlations = [sum(map(float.__mul__, speeds, speeds[lag:])) / len(speeds) / square for lag in range(40)]
    assert 0.5 * (sum(correlations) - 0.5) == pytest.approx(8.0, rel=0.3)
    assert WindForce(OTTER, wind, None, 3).numbers() == force.numbers() != WindForce(OTTER, wind, None, 4).numbers()


def test_a_vessel_drifts_where_drag_balances_the_wind() -> None:
    """With the wind astern it drifts at the speed u where 77.55 u is the force of the wind that it feels."""
    world = World("sea", "test", (-500.0, 500.0, -500.0, 500.0), 100.0, wind=Wind(10.0))
    simulation = Simulation(OTTER, world)
    for _ in range(400 * 20):
        simulation.step((1500, 1500))
    u = simulation.state.nu[0]
    felt = 10.0 * (0.3 / 10.0) ** (1.0 / 7.0) - u
    assert 77.55443234836703 * u == pytest.approx(0.5 * AIR * 0.35 * 0.55 * felt * felt, rel=0.01)

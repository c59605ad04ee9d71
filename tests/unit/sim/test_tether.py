"""The tether: against the elastic catenary, against integration in a current, its winch, and its stability."""

from collections.abc import Sequence
from itertools import pairwise
from math import asinh, dist, hypot, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest

from hil.common.errors import ConfigError
from hil.recording.events import repeat
from sim.dynamics import State
from sim.environment.world import World
from sim.simulation import Simulation
from sim.tether import Tether, TetherKeys
from sim.vehicle.vehicle import load_vehicle
from tests.support.lazy import import_lazily

integrate, optimize = import_lazily("scipy.integrate"), import_lazily("scipy.optimize")

WORLD = World("deep", "test", (-300.0, 300.0, -300.0, 300.0), 500.0, density=1000.0, gravity=9.81)
LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
KEYS = TetherKeys(60.0, mass=0.3, diameter=0.01)
END = (40.0, 0.0, 20.0)
STEP_NS, SLOW_NS = 2_500_000, 10_000_000
WEIGHT = (KEYS.mass - 1000.0 * 0.25 * pi * KEYS.diameter**2) * 9.81  # N a metre


def taut_tether(keys: TetherKeys, world: World = WORLD, end: Sequence[float] = END, dt: float = 0.01) -> Tether:
    """Return a tether whose end is fixed."""
    return Tether(keys, world, dt, lambda: (State(end), [[0.0] * 6] * 6))


def at_rest(keys: TetherKeys, world: World = WORLD, steps: int = 1000) -> tuple[Tether, Any]:
    """Return a tether whose end was held at END, and its wrench there."""
    tether = taut_tether(keys, world)
    for step in range(steps):
        tether.begin(step * SLOW_NS)
        wrench = tether.wrench(END, LEVEL, (0.0,) * 6)
    return tether, wrench


def test_a_tether_hangs_as_the_elastic_catenary() -> None:
    """The pull follows from the distance of the ends (Irvine 1981, Cable Structures, eqs 1.26 and 1.27)."""

    def end_errors(pull: Any) -> tuple[float, float]:
        h, v = pull  # horizontal, and vertical at the anchor
        left = v - WEIGHT * KEYS.length
        x = h * KEYS.length / KEYS.stiffness + h / WEIGHT * (asinh(v / h) - asinh(left / h))
        z = (v - 0.5 * WEIGHT * KEYS.length) * KEYS.length / KEYS.stiffness
        z += h / WEIGHT * (sqrt(1.0 + (v / h) ** 2) - sqrt(1.0 + (left / h) ** 2))
        return x - END[0], z - END[2]

    h, v = optimize.fsolve(end_errors, (30.0, 90.0))
    tether, wrench = at_rest(KEYS)
    assert wrench[0] == pytest.approx(-h, rel=0.03)
    assert wrench[2] == pytest.approx(WEIGHT * KEYS.length - v, rel=0.03)
    assert max(map(max, tether._velocities)) < 0.1


def test_a_tether_weighs_more_in_air_than_in_water() -> None:
    """It hangs straight down from a ship's deck; half of each end segment is carried there."""
    for lowest, weight in ((-0.5, KEYS.mass * 9.81), (29.5, WEIGHT)):
        keys = KEYS._replace(length=10.0, anchor=(0.0, 0.0, lowest - 9.9))
        tether = taut_tether(keys, end=(0.0, 0.0, lowest))
        loads: list[list[float]] = []
        for step in range(400):
            tether.begin(step * SLOW_NS)
            loads = tether._loads(1.0)[0]
        assert sum(load[2] for load in loads) == pytest.approx(10.0 * weight, rel=1e-3)


def test_a_tether_in_a_current_equals_an_integration() -> None:
    """The tether in 0.8 m/s across equals an integration of d(pull)/ds = -(weight + drag), shot from the anchor."""
    world = WORLD._replace(current=(0.0, 0.8, 0.0))
    flow = np.array(world.current)

    def slope(_: float, y: Any) -> Any:
        size = np.linalg.norm(y[3:])
        tangent = y[3:] / size
        slide = flow @ tangent
        normal = flow - slide * tangent
        drag = 500.0 * KEYS.diameter * (
            KEYS.drag * np.linalg.norm(normal) * normal + KEYS.drag_along * pi * abs(slide) * slide * tangent
        )  # fmt: skip
        stretched = 1.0 + size / KEYS.stiffness
        return np.concatenate([tangent * stretched, -stretched * drag - np.array([0.0, 0.0, WEIGHT])])

    def shoot(pull: Any) -> Any:
        start = np.concatenate([np.zeros(3), pull])
        return integrate.solve_ivp(slope, (0.0, KEYS.length), start, rtol=1e-8, atol=1e-8).y[:, -1]

    pull = optimize.fsolve(lambda pull: shoot(pull)[:3] - np.array(END), (50.0, -50.0, 90.0))
    _, wrench = at_rest(KEYS, world, 4000)
    assert np.array(wrench[:3]) == pytest.approx(-shoot(pull)[3:], abs=0.05 * float(np.linalg.norm(pull)))


@pytest.mark.parametrize(
    ("length", "stiffness", "step"),
    [(1.0, 1e3, 0.01), (1.0, 5e6, 0.0025), (30.0, 1e5, 0.01), (300.0, 1e3, 0.01), (300.0, 1e7, 0.0025)],
)
def test_a_tether_gains_no_energy(stiffness: float, length: float, step: float) -> None:
    """The tether is slack, weightless, without drag, and thrown aside: it never exceeds its first speed, and slows
    down.
    """
    keys = KEYS._replace(length=length, stiffness=stiffness, drag=0.0, drag_along=0.0)
    keys = keys._replace(mass=1000.0 * 0.25 * pi * keys.diameter**2, anchor=(0.0, 0.0, 200.0))
    tether = taut_tether(keys, end=(0.9 * length, 0.0, 200.0 + 0.3 * length), dt=step)
    tether.begin(0)
    for k, speed in enumerate(tether._velocities):
        speed[1] = sin(pi * k / keys.segments)
    energies = []
    for number in range(1, 600):
        energies.append(sum(x * x for speed in tether._velocities[1:-1] for x in speed))
        tether.begin(round(number * step * 1e9))
    assert max(energies) <= 1.001 * energies[0]
    assert energies[-1] <= max(energies[300:450])


@pytest.mark.parametrize(
    ("step_ns", "length", "stiffness"), [(STEP_NS, 1.0, 1e7), (SLOW_NS, 1.0, 2e4), (SLOW_NS, 10.0, 5e6)]
)
def test_a_vehicle_on_a_short_or_stiff_tether_comes_to_rest(length: float, stiffness: float, step_ns: int) -> None:
    """The vehicle is carried off by a current: the pull is its drag, and stretches the line by its share of EA."""
    keys = TetherKeys(length, anchor=(0.0, 0.0, 5.0), stiffness=stiffness, drag_along=0.0)
    simulation = Simulation(
        load_vehicle("bluerov2_heavy")[0], WORLD._replace(current=(0.6, 0.0, 0.0)), {},
        position=(0.98 * length, 0.0, 5.0), tether=keys, dt_ns=step_ns,
    )  # fmt: skip
    assert simulation.tether
    pulls = []
    for step in range(round(7e9 / step_ns)):
        simulation.step((1500,) * 8)
        if step > 5e9 / step_ns:
            pulls.append(simulation.tether.tension)
    forces = simulation.forces()
    drag = forces.linear_damping[0] + forces.quadratic_damping[0]
    assert max(pulls) - min(pulls) < 0.01 * drag
    assert pulls[-1] == pytest.approx(drag, rel=0.005)
    chords = sum(dist(a, b) for a, b in pairwise(simulation.tether.nodes))
    assert chords - length == pytest.approx(
        drag * length / stiffness, rel=0.02, abs=drag / 20.0 * (step_ns * 1e-9) ** 2
    )


@pytest.mark.parametrize("stiffness", [2e4, 1e7])
def test_a_tether_on_the_seabed_has_a_steady_pull(stiffness: float) -> None:
    """Half of it lies; the rest hangs from the end as a catenary that begins level: pull = H + weight x height."""
    world = WORLD._replace(depth=30.0)
    keys = KEYS._replace(stiffness=stiffness, anchor=(0.0, 0.0, 30.0))
    tether, pulls = taut_tether(keys, world, (40.0, 0.0, 10.0)), []
    for step in range(1500):
        tether.begin(step * SLOW_NS)
        pulls.append(tether.tension)
    hanging = sum(node[2] < 30.0 for node in tether.nodes)
    assert 3 <= hanging <= 6
    assert max(pulls[-500:]) - min(pulls[-500:]) < 0.03 * pulls[-1]
    level = hypot(*tether._force[:2])
    assert pulls[-1] == pytest.approx(level + WEIGHT * 20.0, rel=0.05)
    floating, _ = at_rest(KEYS._replace(mass=0.02), steps=150)
    assert [node[2] for node in floating.nodes][:8] == [0.0] * 7 + [pytest.approx(3.6, abs=0.1)]


def test_segments_that_are_too_short_are_refused() -> None:
    assert TetherKeys(1.0, segments=50).validate() == "segments: 50 of 1 m are too short to compute: use at most 40"
    assert TetherKeys(1.0, segments=40).validate() is None


def test_a_winch_pays_out_at_its_speed_and_the_pull_falls() -> None:
    tether, _ = at_rest(KEYS._replace(length=45.0, winch_speed=1.0), steps=600)
    taut = tether.tension
    tether.set_length(48.0)
    for step in range(600, 700):
        tether.begin(step * SLOW_NS)
    assert tether.length == pytest.approx(46.0)
    for step in range(700, 1200):
        tether.begin(step * SLOW_NS)
    assert tether.length == pytest.approx(48.0)
    assert tether.tension < 0.9 * taut
    with pytest.raises(ConfigError, match=r"length 0\.1 m of 10 segments is outside 0\.5 to"):
        tether.set_length(0.1)


def test_moving_a_vehicle_elsewhere_causes_no_large_pull_of_its_tether() -> None:
    """The line is laid out again from the anchor's new position: nothing has moved at the speed of the jump.

    A repeated recording moves it as the slave did.
    """
    simulation = Simulation(
        load_vehicle("bluerov2")[0], WORLD, {}, position=(5.0, 0.0, 10.0),
        tether=KEYS._replace(anchor_velocity=(0.2, 0.0, 0.0)),
    )  # fmt: skip
    tether = simulation.tether
    assert tether is not None
    neutral = (1500,) * len(simulation.vehicle.thrusters)
    for _ in range(200):
        simulation.step(neutral)
    repeat({"place": [[40.0, 0.0, 20.0], [1.0, 0.0, 0.0, 0.0], [0.0] * 6]}, simulation)
    pulls = []
    for _ in range(400):
        simulation.step(neutral)
        pulls.append(tether.tension)
    assert max(pulls) < 100.0
    assert tether.nodes[0] == pytest.approx([0.2 * 1.5, 0.0, 0.0], abs=2e-3)

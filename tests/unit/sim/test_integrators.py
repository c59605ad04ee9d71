"""The integrator is chosen by its error: the table in sim/dynamics.py, figure by figure.

Semi-implicit Euler is written out here: its position from rest is off by a dt t / 2.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import sqrt
from random import Random
from typing import NamedTuple

import pytest

from sim import rotations
from sim.assembly import make_dynamics
from sim.dynamics import Dynamics, State
from sim.environment.world import load_world
from sim.matrices import product
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.support.flights.runge_kutta import RungeKutta
from tests.unit.sim.test_dynamics import DEEP, HEAVY, NOTHING, STILL, undamped

AHEAD, TURNING = (40.0, 0.0, 0.0, 0.0, 0.0, 0.0), (40.0, 0.0, 0.0, 0.0, 0.0, 3.0)
WATER = 1025.0, 9.81
SECONDS = 10.0


class Euler(Dynamics):
    """An integrator that advances the velocities first, then the pose with the new velocities."""

    def step(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        rotation = rotations.matrix(state.quaternion)
        state.nu_dot = self.acceleration(state.position[2], rotation, state.nu, wrench, current)
        state.nu = [x + dt * dx for x, dx in zip(state.nu, state.nu_dot, strict=True)]
        velocity = rotations.rotate(state.quaternion, state.nu[:3])
        state.position = [x + dt * dx for x, dx in zip(state.position, velocity, strict=True)]
        state.quaternion = list(rotations.integrate(state.quaternion, state.nu[3:], dt))


EULER = Euler(HEAVY, *WATER)
REFERENCE = RungeKutta(HEAVY, *WATER)
METHODS = {"euler": EULER, "ours": make_dynamics(HEAVY, *WATER)}


class Deviation(NamedTuple):
    """The greatest errors of a run: position in m, quaternion."""

    position: float
    quaternion: float


def simulate(dynamics: Dynamics, wrench: Sequence[float], dt: float) -> list[tuple[list[float], list[float]]]:
    """Return position and quaternion after each step of `dt`, from rest."""
    state, states = State((0.0, 0.0, 50.0)), []
    for _ in range(round(SECONDS / dt)):
        dynamics.step(state, wrench, STILL, dt)
        states.append((list(state.position), list(state.quaternion)))
    return states


def errors(dynamics: Dynamics, wrench: Sequence[float], dt: float) -> Deviation:
    """Return the greatest errors against Runge-Kutta with half the step."""
    true = simulate(REFERENCE, wrench, 0.5 * dt)[1::2]
    deviations = [
        [max(abs(a - b) for a, b in zip(mine[i], theirs[i], strict=True)) for i in (0, 1)]
        for mine, theirs in zip(simulate(dynamics, wrench, dt), true, strict=True)
    ]
    return Deviation(*(max(column) for column in zip(*deviations, strict=True)))


@pytest.mark.parametrize(
    ("method", "wrench", "dt", "position", "quaternion"),
    [
        ("euler", AHEAD, 0.01, 4.0e-3, 5.2e-4),
        ("ours", AHEAD, 0.01, 2.4e-5, 8.5e-6),
        ("euler", TURNING, 0.01, 4.7e-3, 5.8e-3),
        ("ours", TURNING, 0.01, 3.7e-5, 1.5e-5),
        ("ours", TURNING, 0.0025, 2.6e-6, 1.2e-6),
    ],
)
def test_the_errors_equal_those_of_the_table(
    method: str, wrench: Sequence[float], dt: float, position: float, quaternion: float
) -> None:
    """The rows at 10 ms are compared, and of those at 2.5 ms the one of the default in a turn."""
    found = errors(METHODS[method], wrench, dt)
    assert found.position == pytest.approx(position, rel=0.05)
    assert found.quaternion == pytest.approx(quaternion, rel=0.05)


def test_position_from_rest_is_that_of_a_constant_acceleration() -> None:
    """The position without drag is a t² / 2, to rounding; semi-implicit Euler has a dt t / 2 more."""
    vehicle, dt, seconds, acceleration = undamped([10.0] * 3 + [1.0] * 3), 0.0025, 2.0, 0.4
    final_states = []
    for kind in (Dynamics, Euler):
        dynamics, state = kind(vehicle, 1000.0, 9.8), State((0.0, 0.0, DEEP))
        for _ in range(round(seconds / dt)):
            dynamics.step(state, (4.0, 0.0, 0.0, 0.0, 0.0, 0.0), STILL, dt)
        final_states.append(state.position[0])
    assert final_states[0] == pytest.approx(0.5 * acceleration * seconds**2, rel=1e-12)
    assert final_states[1] - final_states[0] == pytest.approx(0.5 * acceleration * dt * seconds, rel=1e-6)


def test_a_tumbling_body_conserves_its_energy() -> None:
    """An uneven body without drag conserves it for ten seconds at 2.5 ms: semi-implicit Euler adds 13 %."""
    gains = []
    for kind in (Dynamics, Euler):
        dynamics = kind(undamped([10.0, 20.0, 30.0, 5.0, 15.0, 25.0]), 1000.0, 9.8)
        state = State((0.0, 0.0, DEEP), nu=(1.5, -0.3, 0.7, 0.4, -0.9, 1.4))

        def energy(dynamics: Dynamics = dynamics, state: State = state) -> float:
            momentum = [row[0] for row in product(dynamics.mass, [[x] for x in state.nu])]
            return 0.5 * sum(a * b for a, b in zip(momentum, state.nu, strict=True))

        start = energy()
        for _ in range(4000):
            dynamics.step(state, NOTHING, STILL, 0.0025)
        gains.append(energy() / start - 1.0)
    assert abs(gains[0]) < 1e-4
    assert gains[1] > 0.01


@pytest.mark.parametrize("rate", [50.0, 150.0, 190.0])
def test_damping_faster_than_a_step_stays_stable(rate: float) -> None:
    """A terminal speed is held, not oscillated about, to a rate of 2 / dt, where Euler's step begins to diverge too."""
    inertia, dt = 1.0, 0.01
    dynamics = Dynamics(undamped([inertia] * 6, linear_damping=(rate,) * 6), 1000.0, 9.8)
    state, speeds = State((0.0, 0.0, DEEP)), []
    for _ in range(400):
        dynamics.step(state, (rate, 0.0, 0.0, 0.0, 0.0, 0.0), STILL, dt)
        speeds.append(state.nu[0])
    assert speeds[-1] == pytest.approx(1.0, abs=1e-9)
    away = [abs(speed - 1.0) for speed in speeds[10:60]]
    assert all(after <= before + 1e-12 for before, after in pairwise(away))


def test_a_vehicle_with_little_inertia_is_stable_at_the_longest_step() -> None:
    """The quickest damping of all presets (160 / s at 2 rad/s) at 20 ms, the most that a scenario may ask for."""
    vehicle, _ = load_vehicle("bluerov2_blue")
    world = load_world("pool")._replace(walls=False, depth=1e4)
    random, pulses = Random(1), [1500] * 6
    simulation = Simulation(vehicle, world, {}, dt_ns=20_000_000, position=(0.0, 0.0, 500.0))
    for step in range(1000):
        if step % 50 == 0:
            pulses = [random.randint(1100, 1900) for _ in vehicle.channels]
        simulation.step(pulses)
        assert sqrt(sum(x * x for x in simulation.state.nu)) < 4.0


@pytest.mark.parametrize("dt_ns", [10_000_000, 2_500_000])
def test_thrust_leads_by_half_a_step_only(dt_ns: int) -> None:
    """The lead is the speed times dt / 2, as the thrusters' docstring says; it no longer grows at top speed."""

    def flight(dt_ns: int, seconds: float) -> tuple[float, float]:
        run = Simulation(
            load_vehicle("paper_six")[0], load_world("open_water"), {}, dt_ns=dt_ns, position=(0.0, 0.0, 10.0)
        )
        for _ in range(round(seconds * 1e9) // dt_ns):
            run.step([1650] * 4 + [1500] * 2)
        truth = run.truth()
        return truth.position[0], truth.nu[0]

    for seconds in (1.0, 4.0):
        (far, speed), (exact, _) = flight(dt_ns, seconds), flight(156_250, seconds)
        assert far - exact == pytest.approx(speed * dt_ns * 1e-9 / 2.0, rel=0.1)


def test_the_step_is_of_first_order_while_thrusters_start() -> None:
    """The thrust at the end of a step acts during all of it; so the error halves with the step."""

    def end(step_ns: int) -> float:
        simulation = Simulation(HEAVY, load_world("open_water"), {}, dt_ns=step_ns, position=(0.0, 0.0, 5.0))
        for _ in range(200_000_000 // step_ns):
            simulation.step((1600, 1600, 1400, 1400, *[1500] * 4))
        return simulation.state.position[0]

    true = end(62_500)
    errors = [abs(end(step_ns) - true) for step_ns in (4_000_000, 2_000_000, 1_000_000)]
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.15)

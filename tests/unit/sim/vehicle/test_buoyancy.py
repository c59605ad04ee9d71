"""Buoyancy at the surface: continuous, correct for a box, and conserving energy."""

from itertools import pairwise

import pytest

from sim import rotations
from sim.dynamics import Dynamics, State
from sim.rotations import from_euler
from sim.vehicle.buoyancy import Hull
from sim.vehicle.vehicle import Vehicle, load_vehicle

RHO, G = 1000.0, 9.81
STILL, NOTHING = (0.0, 0.0, 0.0), (0.0,) * 6
PLAIN, _ = load_vehicle("paper_six")
LEVEL = rotations.matrix((1.0, 0.0, 0.0, 0.0))


def float_(**changes: object) -> Vehicle:
    """Return a frictionless box that floats half out of the water, its two centres in the origin."""
    calm = PLAIN._replace(
        mass=9.7, volume=0.0194, neutrally_buoyant=False, center_of_buoyancy=(0.0, 0.0, 0.0),
        linear_damping=(0.0,) * 6, quadratic_damping=(0.0,) * 6,
    )  # fmt: skip
    return calm._replace(**changes)  # type: ignore[arg-type]


def energy(dynamics: Dynamics, state: State) -> float:
    """Return the energy: kinetic, of the weight, and of the displaced water, the lift times the depth of its centre."""
    down = rotations.matrix(state.quaternion)[6:]
    depth = state.position[2]
    lift, *moments = dynamics.hull.buoyancy(depth, down)
    lifted = lift * depth + sum(n * moment for n, moment in zip(down, moments, strict=True))
    pairs = zip(dynamics.mass, state.nu, strict=True)
    kinetic = 0.5 * sum(v * sum(m * x for m, x in zip(row, state.nu, strict=True)) for row, v in pairs)
    return kinetic + lifted - dynamics.weight * depth


def largest_jump(values: list[float]) -> float:
    return max(abs(b - a) for a, b in pairwise(values))


def test_lift_is_continuous() -> None:
    hull = Hull(float_(), RHO, G)
    depths = [-0.3 + 0.0001 * i for i in range(6001)]
    for attitude in (LEVEL, rotations.matrix(from_euler(0.7, -0.4, 0.2)), rotations.matrix(from_euler(3.1, 0.0, 0.0))):
        lifts = [hull.buoyancy(d, attitude[6:]) for d in depths]
        assert lifts[0] == (0.0, 0.0, 0.0, 0.0)
        assert lifts[-1] == pytest.approx((hull.full, 0.0, 0.0, 0.0))
        assert largest_jump([lift for lift, *_ in lifts]) < 0.002 * hull.full
        assert all(b[0] >= a[0] - 1e-9 for a, b in pairwise(lifts))


@pytest.mark.parametrize("start", [0.08, 0.4])
def test_the_energy_of_bobbing_does_not_grow(start: float) -> None:
    """The energy of 16 s of bobbing, leaping out and falling back stays within 0.1 % with the default integrator.

    Drag in turning only: without any, leaping winds up the smallest roll (parametric resonance).
    """
    dynamics = Dynamics(float_(linear_damping=(0.0, 0.0, 0.0, 0.5, 0.5, 0.5)), RHO, G)
    state = State((0.0, 0.0, start))
    rest_energy = energy(dynamics, State())
    first = energy(dynamics, state) - rest_energy
    for _ in range(16):
        for _ in range(400):
            dynamics.step(state, NOTHING, STILL, 0.0025)
        assert energy(dynamics, state) - rest_energy == pytest.approx(first, rel=0.001)


def test_a_trimmed_vehicle_hovers_in_any_water() -> None:
    for density in (998.0, 1028.0):
        dynamics = Dynamics(PLAIN, density, 9.81)
        assert dynamics.acceleration(5.0, LEVEL, NOTHING, NOTHING, STILL) == pytest.approx([0.0] * 6, abs=1e-12)

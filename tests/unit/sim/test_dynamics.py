"""The equations of motion against published numbers and conservation laws."""

from collections.abc import Sequence
from math import sqrt
from typing import Any

import pytest

from sim import rotations
from sim.dynamics import Dynamics, State
from sim.matrices import cross_matrix, product, square
from sim.rotations import from_euler, rotate, rotate_inverse
from sim.vehicle.vehicle import Vehicle, load_vehicle
from tests.support.flights.runge_kutta import RungeKutta

LEVEL = rotations.matrix((1.0, 0.0, 0.0, 0.0))
STILL = (0.0, 0.0, 0.0)
NOTHING = (0.0,) * 6
DEEP = 1000.0
HEAVY, _ = load_vehicle("bluerov2_heavy_vonbenzon2022")


def undamped(matrix: list[float], **changes: Any) -> Vehicle:
    """Return a weightless, frictionless body whose whole mass matrix is `matrix` (6 or 36 numbers)."""
    rigid = square([0.5] * 6, 6)
    added = [m - r for row in zip(square(matrix, 6), rigid, strict=True) for m, r in zip(*row, strict=True)]
    return HEAVY._replace(
        mass=0.5, inertia=(0.5, 0.5, 0.5), added_mass=tuple(added), neutrally_buoyant=True,
        center_of_buoyancy=(0.0, 0.0, 0.0), linear_damping=(0.0,) * 6, quadratic_damping=(0.0,) * 6,
    )._replace(**changes)  # fmt: skip


def coriolis(vehicle: Vehicle, nu: list[float]) -> list[float]:
    """Return C(nu) nu, read out of the accelerations."""
    dynamics = Dynamics(vehicle, 1000.0, 9.8)
    nu_dot = dynamics.acceleration(DEEP, LEVEL, nu, NOTHING, STILL)
    return [-row[0] for row in product(dynamics.mass, [[x] for x in nu_dot])]


@pytest.mark.parametrize(
    ("axis", "force", "rate"),
    [(0, 129.2, 0.910), (1, 85.0, sqrt(85.0 / 217.0)), (2, 120.0, 0.7136), (5, 10.0, sqrt(10.0 / 1.5))],
)
def test_terminal_rates_balance_force_and_drag(axis: int, force: float, rate: float) -> None:
    """The rate is where (linear + quadratic |v|) v equals the force: von Benzon's table 4 within 1 %."""
    wrench = [force if i == axis else 0.0 for i in range(6)]
    dynamics = Dynamics(HEAVY._replace(neutrally_buoyant=True), 1000.0, 9.82)
    state = State((0.0, 0.0, DEEP))
    for _ in range(4000):
        dynamics.step(state, wrench, STILL, 0.0025)
        state.quaternion = [1.0, 0.0, 0.0, 0.0]
    assert state.nu[axis] == pytest.approx(rate, rel=2e-3)


def test_added_mass_six_times_the_mass_is_stable() -> None:
    vehicle = HEAVY._replace(
        mass=10.0, neutrally_buoyant=True, added_mass=(60.0, 60.0, 60.0, 3.0, 3.0, 3.0),
        linear_damping=(1.0,) * 6, quadratic_damping=(30.0,) * 3 + (1.0,) * 3,
    )  # fmt: skip
    dynamics = Dynamics(vehicle, 1000.0, 9.8)
    state = State((0.0, 0.0, DEEP))
    dynamics.step(state, (10.0, 0.0, 0.0, 0.0, 0.0, 0.0), STILL, 0.01)
    assert state.nu_dot[0] == pytest.approx(10.0 / 70.0, rel=1e-3)
    for _ in range(3000):
        dynamics.step(state, (10.0, 5.0, -5.0, 0.2, -0.2, 0.3), STILL, 0.01)
        assert max(map(abs, state.nu)) < 1.0


def test_full_matrices_with_only_a_diagonal_equal_diagonal_ones() -> None:
    def full(diagonal: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(x for row in square(diagonal, 6) for x in row)

    linear = list(full(HEAVY.linear_damping))
    linear[1] = 1e-300  # a negligible coupling, which selects the general code path
    coupled = HEAVY._replace(
        added_mass=full(HEAVY.added_mass), linear_damping=tuple(linear),
        quadratic_damping=full(HEAVY.quadratic_damping), inertia=(0.26, 0, 0, 0, 0.23, 0, 0, 0, 0.37),
    )  # fmt: skip
    one, other = State((0, 0, DEEP), nu=(1, 2, 3, 1, 2, 3)), State((0, 0, DEEP), nu=(1, 2, 3, 1, 2, 3))
    first, second = Dynamics(HEAVY, 1000.0, 9.8), Dynamics(coupled, 1000.0, 9.8)
    for _ in range(200):
        first.step(one, (1, 2, 3, 0.1, 0.2, 0.3), STILL, 0.0025)
        second.step(other, (1, 2, 3, 0.1, 0.2, 0.3), STILL, 0.0025)
    assert one.position == pytest.approx(other.position, rel=1e-12)
    assert one.nu == pytest.approx(other.nu, rel=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_munk_moment_scales_with_its_share(share: float) -> None:
    """The moment of two speeds about each axis is (A_jj - A_ii) v_i v_j in ideal fluid (Lamb 1932, article 124)."""
    a, b, c = HEAVY.added_mass[:3]
    for axis, ideal, nu in (
        (3, (c - b) * 0.3 * 0.2, [0.0, 0.3, 0.2, 0.0, 0.0, 0.0]),
        (4, (a - c) * 1.5 * 0.2, [1.5, 0.0, 0.2, 0.0, 0.0, 0.0]),
        (5, (b - a) * 1.5 * 0.3, [1.5, 0.3, 0.0, 0.0, 0.0, 0.0]),
    ):
        shares = share if axis == 3 else 1.0, share if axis == 4 else 1.0, share if axis == 5 else 1.0
        dynamics = Dynamics(HEAVY._replace(munk_share=shares), 1000.0, 9.8)
        found = [-x for x in dynamics.forces(State((0.0, 0.0, DEEP), nu=nu), NOTHING, STILL).coriolis]
        assert found[axis] == pytest.approx(share * ideal, abs=1e-12)
        assert [x for i, x in enumerate(found) if i != axis] == pytest.approx([0.0] * 5, abs=1e-12)


@pytest.mark.parametrize("shares", [(1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.7, 0.1, 0.4)])
def test_a_free_body_conserves_energy_and_momentum(shares: tuple[float, float, float]) -> None:
    """The work on a body without drag, with an uneven mass matrix, cancels with any share of the Munk moment.

    With the whole moment the momentum in the world is constant too.
    """
    matrix = [10, 1, 0, 0, 0, 0.5, 1, 20, 2, 0, 0, 0, 0, 2, 30, 0, 0, 0,
              0, 0, 0, 5, 0.3, 0, 0, 0, 0, 0.3, 15, 1, 0.5, 0, 0, 0, 1, 25]  # fmt: skip
    dynamics = RungeKutta(undamped([float(x) for x in matrix], munk_share=shares), 1000.0, 9.8)
    state = State((0, 0, DEEP), from_euler(0.3, 0.2, 0.1), (1.5, -0.3, 0.7, 0.4, -0.9, 1.4))

    def momentum() -> tuple[float, tuple[float, float, float]]:
        p = [row[0] for row in product(dynamics.mass, [[x] for x in state.nu])]
        energy = 0.5 * sum(a * b for a, b in zip(p, state.nu, strict=True))
        return energy, rotate(state.quaternion, p[:3])

    energy, linear = momentum()
    for _ in range(1000):
        dynamics.step(state, NOTHING, STILL, 0.01)
        work = sum(a * b for a, b in zip(dynamics.forces(state, NOTHING, STILL).coriolis, state.nu, strict=True))
        assert work == pytest.approx(0.0, abs=1e-11)
    assert momentum()[0] == pytest.approx(energy, rel=1e-8)
    if shares == (1.0, 1.0, 1.0):
        assert momentum()[1] == pytest.approx(linear, rel=1e-6)


@pytest.mark.parametrize("depth", [DEEP, 0.05])
@pytest.mark.parametrize("full", [False, True])
def test_the_forces_add_up_to_the_equation_of_motion(full: bool, depth: float) -> None:
    """They sum to M nu_r', where nu_r' is nu' less the rate of the water seen from turning axes."""
    damping = [list(HEAVY.linear_damping), list(HEAVY.quadratic_damping)]
    if full:
        damping = [[x for row in square(each, 6) for x in row] for each in damping]
        damping[0][1 * 6 + 5] = damping[1][5 * 6 + 1] = 0.7
    linear, quadratic = map(tuple, damping)
    vehicle = HEAVY._replace(linear_damping=linear, quadratic_damping=quadratic, munk_share=(1.0, 0.2, 0.5))
    vehicle = vehicle._replace(center_of_gravity=(0.02, 0.01, 0.03))
    dynamics = Dynamics(vehicle, 1025.0, 9.82, forces=[Tow()])
    state = State((1.0, 2.0, depth), from_euler(0.4, -0.3, 2.0), (0.8, -0.5, 0.3, 0.6, -0.4, 0.9))
    wrench, current = [30.0, -12.0, 7.0, 1.0, -2.0, 0.5], (0.3, -0.2, 0.1)
    forces = dynamics.forces(state, wrench, current)
    rotation = rotations.matrix(state.quaternion)
    pushed = dynamics.add_forces(state.position, rotation, state.nu, wrench, current)
    nu_dot = dynamics.acceleration(depth, rotation, state.nu, pushed, current)
    water = [[x] for x in rotate_inverse(state.quaternion, current)]
    turning = [-row[0] for row in product(cross_matrix(state.nu[3:]), water)] + [0.0] * 3
    relative = [[a - b] for a, b in zip(nu_dot, turning, strict=True)]
    assert forces.total == pytest.approx([row[0] for row in product(dynamics.mass, relative)], rel=1e-12, abs=1e-12)
    assert forces.total == [sum(row) for row in zip(*forces[:-1], strict=True)]
    assert forces.thrusters == wrench
    assert list(forces.others) == Tow().wrench(state.position, rotation, _relative(state, current))
    assert all(any(term) for term in forces[:-2])
    assert not any(forces.contact)  # which a simulation adds


class Tow:
    """A spring to the origin, with a drag of its own."""

    def begin(self, time_ns: int) -> None:
        """Do nothing: it does not change with time."""

    def wrench(self, position: Sequence[float], rotation: rotations.Rotation, nu_r: Sequence[float]) -> list[float]:
        north, east, down = position
        xx, xy, _, yx, yy, _, zx, zy, _ = rotation
        pull = [-(xx * north + yx * east + zx * down), -(xy * north + yy * east + zy * down), 0.0]
        return [*(pull[i] - 5.0 * nu_r[i] for i in range(3)), 0.0, 0.1, 0.0]


def _relative(state: State, current: Sequence[float]) -> list[float]:
    water = [*rotate_inverse(state.quaternion, current), 0.0, 0.0, 0.0]
    return [a - b for a, b in zip(state.nu, water, strict=True)]


def test_a_users_force_is_integrated_with_the_methods_order() -> None:
    """Halving the step divides the error by four, or more."""

    def end(steps: int) -> list[float]:
        dynamics, state = Dynamics(HEAVY, 1025.0, 9.82, [Tow()]), State((2.0, 1.0, 30.0), nu=[0.5] * 6)
        for _ in range(steps):
            dynamics.step(state, NOTHING, (0.2, 0.1, 0.0), 2.0 / steps)
        return [*state.position, *state.nu]

    true = end(3200)
    errors = [max(abs(a - b) for a, b in zip(end(steps), true, strict=True)) for steps in (50, 100)]
    assert errors[0] / errors[1] > 3.0


def test_each_force_does_the_work_of_its_kind() -> None:
    """Coriolis forces do no work, damping takes energy whatever the motion; level and deep, weight is along z alone."""
    dynamics = Dynamics(HEAVY, 1025.0, 9.82)
    for nu in ([0.8, -0.5, 0.3, 0.6, -0.4, 0.9], [-1.0, 0.2, -0.7, -0.1, 0.5, -0.3]):
        forces = dynamics.forces(State((0.0, 0.0, DEEP), nu=nu), NOTHING, STILL)
        power = [sum(f * v for f, v in zip(term, nu, strict=True)) for term in forces]
        assert power[0] == pytest.approx(0.0, abs=1e-12)
        assert power[1] < 0.0
        assert power[2] < 0.0
        x, y, z, k, m, n = forces.restoring
        assert (x, y, n) == (0.0, 0.0, 0.0)
        assert z == pytest.approx(HEAVY.mass * 9.82 - dynamics.hull.full)
        assert k == m == 0.0  # both centres are on the z axis

"""Quaternions and Euler angles: conventions, inverses, integration."""

from math import cos, pi, sin
from random import Random

import pytest

from sim import rotations
from sim.rotations import down_axis, from_euler, integrate, multiply, normalise, rotate, rotate_inverse, to_euler


def test_angles_follow_the_frame_conventions() -> None:
    """A yaw of 90 deg turns the bow east; a positive pitch lifts it (z down); a positive roll lowers starboard."""
    assert rotate(from_euler(0, 0, pi / 2), (1, 0, 0)) == pytest.approx((0, 1, 0))
    assert rotate(from_euler(0, pi / 6, 0), (1, 0, 0)) == pytest.approx((cos(pi / 6), 0, -0.5))
    assert rotate(from_euler(pi / 6, 0, 0), (0, 1, 0)) == pytest.approx((0, cos(pi / 6), 0.5))


@pytest.mark.parametrize("euler", [(0.1, -0.2, 0.3), (-3.0, 1.5, -3.0), (2.0, -1.5, 1.0), (0.0, 0.0, 3.1)])
def test_euler_angles_survive_a_round_trip(euler: tuple[float, float, float]) -> None:
    assert to_euler(from_euler(*euler)) == pytest.approx(euler)


def test_the_inverse_rotation_undoes_and_preserves_length() -> None:
    q = from_euler(0.4, -1.1, 2.2)
    turned = rotate(q, (1.0, -2.0, 3.0))
    assert rotate_inverse(q, turned) == pytest.approx((1.0, -2.0, 3.0))
    assert sum(x * x for x in turned) == pytest.approx(14.0)


def test_multiplication_composes_rotations() -> None:
    a, b, v = from_euler(0.4, -1.1, 2.2), from_euler(-1.0, 0.3, 0.9), (1.0, -2.0, 3.0)
    assert rotate(multiply(a, b), v) == pytest.approx(rotate(a, rotate(b, v)))


def test_integration_turns_about_body_axes() -> None:
    """The quaternion after a second at 2 rad/s about a slanted body axis is the exact one of that rotation."""
    start, axis = from_euler(0.4, -1.1, 2.2), (0.6, 0.0, 0.8)
    q = start
    for _ in range(400):
        q = integrate(q, [2.0 * x for x in axis], 0.0025)
    exact = multiply(start, (cos(1.0), *(sin(1.0) * x for x in axis)))
    assert q == pytest.approx(exact, abs=3e-6)
    assert sum(x * x for x in q) == pytest.approx(1.0, abs=1e-15)


def test_shortcuts_equal_the_full_formulas_exactly() -> None:
    """The direction of down is the matrix's last row; a step is the product with (1, half the angles), normalised."""
    random = Random(3)
    for _ in range(500):
        q = normalise([random.uniform(-1.0, 1.0) for _ in range(4)])
        x, y, z = omega = [random.uniform(-3.0, 3.0) for _ in range(3)]
        dt = random.uniform(0.0, 1.0)
        half = 0.5 * dt
        assert down_axis(q) == rotations.matrix(q)[6:]
        assert integrate(q, omega, dt) == normalise(multiply(q, (1.0, half * x, half * y, half * z)))


def test_normalisation_gives_unit_length() -> None:
    assert normalise((2.0, 0.0, 0.0, 0.0)) == (1.0, 0.0, 0.0, 0.0)
    assert rotations.matrix((1.0, 0.0, 0.0, 0.0)) == (1, 0, 0, 0, 1, 0, 0, 0, 1)
    with pytest.raises(FloatingPointError):
        normalise((0.0, 0.0, 0.0, 0.0))

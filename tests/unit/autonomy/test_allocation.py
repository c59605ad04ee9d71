"""Thrust allocation: exact within the limits, by priority beyond them, and valid for underactuated vehicles."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from hil.autonomy.control.allocation import Allocator, pseudo_inverse
from hil.common.errors import ConfigError

Vector = tuple[float, float, float]


def column(position: Vector, axis: Vector) -> list[float]:
    """Return the wrench of 1 N along `axis` at `position`."""
    (x, y, z), (a, b, c) = position, axis
    return [a, b, c, y * c - z * b, z * a - x * c, x * b - y * a]


def matrix_of(thrusters: Sequence[tuple[Vector, Vector]]) -> list[list[float]]:
    columns = [column(*thruster) for thruster in thrusters]
    return [list(row) for row in zip(*columns, strict=True)]


S = math.sqrt(0.5)
VECTORED = [
    ((0.156, 0.111, 0.085), (S, -S, 0.0)),
    ((0.156, -0.111, 0.085), (S, S, 0.0)),
    ((-0.156, 0.111, 0.085), (S, S, 0.0)),
    ((-0.156, -0.111, 0.085), (S, -S, 0.0)),
]
# eight thrusters: everything; six: no pitch
HEAVY = matrix_of([*VECTORED, *[((x, y, 0.0), (0.0, 0.0, 1.0)) for x in (0.12, -0.12) for y in (0.218, -0.218)]])
SIX = matrix_of([*VECTORED, ((0.0, 0.111, 0.0), (0.0, 0.0, 1.0)), ((0.0, -0.111, 0.0), (0.0, 0.0, 1.0))])

FORCES = st.floats(-400.0, 400.0)
WRENCHES = st.tuples(FORCES, FORCES, FORCES, st.floats(-30, 30), st.floats(-30, 30), st.floats(-30, 30))


def wrench_of(matrix: list[list[float]], thrusts: Sequence[float]) -> list[float]:
    return [sum(a * f for a, f in zip(row, thrusts, strict=True)) for row in matrix]


def make_allocator(matrix: list[list[float]], forward: float = 50.0, reverse: float = 40.0) -> Allocator:
    count = len(matrix[0])
    return Allocator(matrix, [forward] * count, [reverse] * count)


@given(WRENCHES)
def test_a_wrench_within_the_limits_is_produced_exactly(wrench: tuple[float, ...]) -> None:
    thrusts, residual = make_allocator(HEAVY, 1e6, 1e6).allocate(wrench)
    assert wrench_of(HEAVY, thrusts) == pytest.approx(wrench, abs=1e-9)
    assert residual == pytest.approx([0.0] * 6, abs=1e-9)


@given(WRENCHES)
def test_six_thrusters_leave_a_residual_in_pitch_only(wrench: tuple[float, ...]) -> None:
    thrusts, residual = make_allocator(SIX, 1e6, 1e6).allocate(wrench)
    delivered = wrench_of(SIX, thrusts)
    for axis in (0, 1, 2, 3, 5):
        assert delivered[axis] == pytest.approx(wrench[axis], abs=1e-3 + 1e-5 * abs(wrench[0]))
    # the surge thrusters lie low: their moment comes with the surge
    assert residual[4] == pytest.approx(wrench[4] - 0.085 * delivered[0], abs=1e-9)


@pytest.mark.parametrize(("matrix", "rank"), [(HEAVY, 6), (SIX, 5), (matrix_of(VECTORED), 3)])
def test_the_allocator_reports_the_rank_of_its_matrix(matrix: list[list[float]], rank: int) -> None:
    assert make_allocator(matrix).rank == rank


HUNDREDTHS = st.integers(-100, 100).map(lambda number: number / 100.0)


@given(st.lists(st.lists(HUNDREDTHS, min_size=6, max_size=6), min_size=1, max_size=9))
@example([[0.01, 0, 0.01, 0, 0, 0], [0.01, 0.01, 0, 0, 0, 0.01], [0.01, 0.01, 0, 0, 0.01, 0.01]])  # weak beside strong
def test_pseudo_inverse_agrees_with_lapack(columns: list[list[float]]) -> None:
    assume(any(map(any, columns)))
    weights = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 1.0])
    weighted = np.array(columns).T * weights[:, None]
    values = np.linalg.svd(weighted, compute_uv=False)
    assume(not np.any((values > 0.9e-4 * values[0]) & (values < 1.1e-4 * values[0])))  # on the edge of the rank
    inverse, rank = pseudo_inverse([list(row) for row in zip(*columns, strict=True)])
    assert rank == np.sum(values > 1e-4 * values[0])
    expected = np.linalg.pinv(weighted, rcond=1e-4) * weights
    assert np.array(inverse) == pytest.approx(expected, rel=1e-6, abs=1e-8 * np.abs(expected).max())


@given(WRENCHES)
def test_thrusts_stay_within_limits_and_the_residual_is_the_missing_wrench(wrench: tuple[float, ...]) -> None:
    thrusts, residual = make_allocator(HEAVY).allocate(wrench)
    assert all(-40.0 <= thrust <= 50.0 for thrust in thrusts)
    assert [a + b for a, b in zip(wrench_of(HEAVY, thrusts), residual, strict=True)] == pytest.approx(wrench, abs=1e-9)


@given(st.tuples(FORCES, FORCES, FORCES), st.floats(-1.0, 1.0))
def test_saturated_horizontal_force_keeps_its_direction(force: Vector, yaw: float) -> None:
    x, y, z = force
    thrusts, residual = make_allocator(HEAVY).allocate((x, y, z, 0.0, 0.0, yaw))
    delivered = wrench_of(HEAVY, thrusts)
    assert delivered[0] * y == pytest.approx(delivered[1] * x, abs=1e-6)
    assert delivered[0] * x + delivered[1] * y >= -1e-9
    assert residual[5] == pytest.approx(0.0, abs=1e-9)  # a small moment is served first


@pytest.mark.parametrize(("first", "second"), [(5, 2), (2, 0), (2, 1), (5, 0), (4, 2), (3, 1)])
def test_coupled_thrusters_serve_moments_then_heave_then_horizontal_force(first: int, second: int) -> None:
    """Two thrusters make both axes: their sum one, their difference the other. What is left of 10 N each is 4 N."""
    matrix = [[0.0, 0.0] for _ in range(6)]
    matrix[first], matrix[second] = [1.0, -1.0], [1.0, 1.0]
    wrench = [0.0] * 6
    wrench[first], wrench[second] = 12.0, 100.0
    delivered = wrench_of(matrix, make_allocator(matrix, 10.0, 10.0).allocate(wrench)[0])
    assert [delivered[first], delivered[second]] == pytest.approx([12.0, 8.0])


def test_forward_and_reverse_limits_differ() -> None:
    single = [[1.0], [0.0], [0.0], [0.0], [0.0], [0.0]]
    one = Allocator(single, [30.0], [20.0])
    assert one.allocate((100.0, 0.0, 0.0, 0.0, 0.0, 0.0)) == ([30.0], (70.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert one.allocate((-100.0, 0.0, 0.0, 0.0, 0.0, 0.0)) == ([-20.0], (-80.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert one.allocate((0.0, 5.0, 0.0, 0.0, 0.0, 0.0)) == ([0.0], (0.0, 5.0, 0.0, 0.0, 0.0, 0.0))


def test_invalid_matrices_and_limits_are_refused() -> None:
    with pytest.raises(ConfigError, match="6 rows and 7 columns"):
        Allocator(HEAVY, [1.0] * 7, [1.0] * 7)
    with pytest.raises(ConfigError, match="6 rows"):
        Allocator(HEAVY[:5], [1.0] * 8, [1.0] * 8)
    with pytest.raises(ConfigError, match="above 0 N"):
        Allocator(HEAVY, [1.0] * 8, [0.0, *[1.0] * 7])
    with pytest.raises(ConfigError, match="pushes"):
        Allocator([[0.0]] * 6, [1.0], [1.0])


def test_axis_weights_decide_between_axes_that_cannot_all_be_produced() -> None:
    """A thruster a metre to starboard couples surge and yaw. Least squares by hand: f = w² / (w² + v²) X."""
    lone = [[1.0], [0.0], [0.0], [0.0], [0.0], [-1.0]]
    for surge, yaw in ((1.0, 1.0), (1.0, 0.01), (0.01, 1.0)):
        one = Allocator(lone, [900.0], [900.0], axis_weights=[surge, 1.0, 1.0, 1.0, 1.0, yaw])
        thrusts, residual = one.allocate((100.0, 0, 0, 0, 0, 0))
        assert thrusts[0] == pytest.approx(100.0 * surge**2 / (surge**2 + yaw**2))
        assert residual == pytest.approx((100.0 - thrusts[0], 0, 0, 0, 0, thrusts[0]))


@given(WRENCHES, st.lists(st.floats(0.1, 10.0), min_size=6, max_size=6))
def test_axis_weights_have_no_effect_where_all_axes_can_be_produced(
    wrench: tuple[float, ...], weights: list[float]
) -> None:
    thrusts, _ = Allocator(HEAVY, [1e6] * 8, [1e6] * 8, axis_weights=weights).allocate(wrench)
    assert thrusts == pytest.approx(make_allocator(HEAVY, 1e6, 1e6).allocate(wrench)[0], abs=1e-6)


def test_wrong_weights_are_refused() -> None:
    with pytest.raises(ConfigError, match="axis weights must be 6 numbers above 0"):
        Allocator(HEAVY, [1.0] * 8, [1.0] * 8, axis_weights=[1.0, 1.0, 1.0, 0.0, 1.0, 1.0])

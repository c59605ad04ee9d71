"""The closed form for the reference platform's four horizontal thrusters, compared with the general allocator."""

from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.control.allocation import Allocator
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, load_vehicle
from tests.support.flights.four_vectored import four_vectored

FORCES = st.floats(-500.0, 500.0)


def allocate_generally(vehicle: Vehicle, wrench: tuple[float, ...]) -> list[float]:
    count = len(vehicle.thrusters)
    return Allocator(wrench_matrix(vehicle), [1e6] * count, [1e6] * count).allocate(wrench)[0]


@pytest.mark.parametrize("name", ["paper_six", "paper_seven"])
@given(FORCES, FORCES, FORCES)
def test_the_closed_form_equals_the_general_solution_for_its_geometry(
    name: str, surge: float, sway: float, yaw: float
) -> None:
    vehicle, _ = load_vehicle(name)
    lever = (0.14 + 0.11) / sqrt(2.0)
    thrusts = allocate_generally(vehicle, (surge, sway, 0.0, 0.0, 0.0, yaw))
    assert list(four_vectored(surge, sway, yaw, lever)) == pytest.approx(thrusts[:4], abs=1e-9)
    assert thrusts[4:] == pytest.approx([0.0] * len(thrusts[4:]), abs=1e-9)


def test_the_closed_form_is_wrong_where_the_levers_differ() -> None:
    """The closed form turns a BlueROV2, whose levers are 164 mm in front and 171 mm astern, by 5 N m for each kN of
    sway. In the general answer the pair astern does less and nothing turns.
    """
    vehicle, _ = load_vehicle("bluerov2")
    signs = (-1.0, -1.0, 1.0, 1.0)  # its two in front push astern
    matrix = wrench_matrix(vehicle)

    def wrench_of(thrusts: list[float]) -> list[float]:
        return [sum(a * f for a, f in zip(row, thrusts, strict=False)) for row in matrix]

    mean_lever = 0.5 * (0.14 + 0.15 + 2.0 * 0.092) / sqrt(2.0)
    closed = wrench_of([sign * f for sign, f in zip(signs, four_vectored(0.0, 1000.0, 10.0, mean_lever), strict=True)])
    assert closed[1] == pytest.approx(1000.0)
    assert closed[5] == pytest.approx(10.0 - 5.0)
    assert wrench_of(allocate_generally(vehicle, (0.0, 1000.0, 0.0, 0.0, 0.0, 10.0)))[5] == pytest.approx(
        10.0, abs=1e-9
    )


def test_the_closed_form_ignores_limits_that_the_allocator_keeps() -> None:
    """The closed form gives 85 N for thrusters of 73.5 N and 49 N at full yaw and full surge together."""
    vehicle, _ = load_vehicle("paper_six")
    wrench = (150.0, 0.0, 0.0, 0.0, 0.0, 23.0)
    closed = four_vectored(150.0, 0.0, 23.0, (0.14 + 0.11) / sqrt(2.0))
    assert max(closed) > 85.0
    forward, reverse = zip(*((t.max_forward, t.max_reverse) for t in vehicle.thrusters), strict=True)
    thrusts, residual = Allocator(wrench_matrix(vehicle), forward, reverse).allocate(wrench)
    assert all(-49.04 < f < 73.55 for f in thrusts)
    assert residual[5] == pytest.approx(0.0, abs=1e-9)  # moments first
    assert residual[0] > 30.0  # and the missing force is the residual

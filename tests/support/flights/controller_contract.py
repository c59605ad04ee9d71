"""Conformance tests of every control law: one class, subclassed with the law to test."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import product
from typing import Any, ClassVar

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from hil.autonomy.control.controller import NO_RESIDUAL, Navigation, VelocityCommand, Wrench
from hil.autonomy.control.families import Controller
from sim.rotations import from_euler
from tests.support.examples import examples

DT = 0.02
AT_REST = Navigation((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 5.0)
ANY = st.floats(allow_nan=True, allow_infinity=True)
# Every subclass runs these tests for itself.
EACH = examples(40, HealthCheck.differing_executors)
FINITE = st.floats(allow_nan=False, allow_infinity=False)


def triples(numbers: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float, float, float]]:
    return st.tuples(numbers, numbers, numbers)


def inputs(numbers: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[VelocityCommand, Navigation, float, Wrench]]:
    """Return a strategy for commands, navigation, periods and residuals; quaternions may have any length."""
    optional = st.none() | numbers
    return st.tuples(
        st.builds(VelocityCommand, numbers, numbers, numbers, numbers, optional, optional),
        st.builds(Navigation, st.tuples(numbers, *[numbers] * 3), triples(numbers), triples(numbers), numbers),
        st.floats(1e-6, 1.0),
        st.tuples(*[numbers] * 6),
    )


class ControllerContract(ABC):
    """The contract of a control law: subclass it with `make`, and `limits` (N, N m) of each axis."""

    limits: ClassVar[Wrench]
    pushes: ClassVar[Sequence[tuple[int, float]]] = tuple(product(range(3), (1.0, -1.0)))  # axes, and which way

    @abstractmethod
    def make(self) -> Controller:
        """Return a new object."""

    @EACH
    @given(st.lists(inputs(ANY), min_size=1, max_size=4))
    def test_any_input_gives_finite_output_and_leaves_no_state(self, calls: list[Any]) -> None:
        """An ordinary call has an ordinary result after any input."""
        controller = self.make()
        for call in calls:
            assert self.is_within_limits(controller.update(*call))
        for _ in range(3):
            wrench = controller.update(VelocityCommand(surge=0.2), AT_REST, DT)
            assert self.is_within_limits(wrench)
        controller.reset()
        assert controller.update(VelocityCommand(), AT_REST, DT) == self.make().update(VelocityCommand(), AT_REST, DT)

    @EACH
    @given(st.lists(inputs(FINITE), min_size=1, max_size=4))
    def test_the_output_is_within_limits_for_any_finite_input(self, calls: list[Any]) -> None:
        controller = self.make()
        for call in calls:
            assert self.is_within_limits(controller.update(*call))

    @EACH
    @given(st.lists(inputs(st.floats(-3.0, 3.0)), min_size=1, max_size=5))
    def test_the_same_calls_give_the_same_wrenches(self, calls: list[Any]) -> None:
        first, second = self.make(), self.make()
        for call in calls:
            assert first.update(*call) == second.update(*call)

    @EACH
    @given(st.lists(inputs(st.floats(-3.0, 3.0)), min_size=1, max_size=5))
    def test_reset_equals_a_new_object(self, calls: list[Any]) -> None:
        used, new = self.make(), self.make()
        for call in calls:
            used.update(*call)
        used.reset()
        for call in calls:
            assert used.update(*call) == new.update(*call)

    def test_the_wrench_points_towards_the_setpoint(self) -> None:
        neutral = self.make().update(VelocityCommand(), AT_REST, DT)
        for axis, sign in self.pushes:
            command = VelocityCommand(*(sign * 0.3 if number == axis else 0.0 for number in range(3)))
            wrench = self.make().update(command, AT_REST, DT)
            assert sign * (wrench[axis] - neutral[axis]) > 0.0, (axis, sign)

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_a_fin_vehicle_reaches_heading_and_depth(self, sign: float) -> None:
        turning = self.make().update(VelocityCommand(heading=sign * 0.5), AT_REST, DT)
        assert sign * turning[5] > 0.0
        diving = self.make().update(VelocityCommand(depth=5.0 + sign), AT_REST, DT)
        assert sign * (diving[2] - self.make().update(VelocityCommand(), AT_REST, DT)[2]) > 0.0

    @pytest.mark.parametrize(("roll", "pitch"), [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3)])
    def test_the_wrench_levels_the_vehicle(self, roll: float, pitch: float) -> None:
        tilted = AT_REST._replace(orientation=from_euler(roll, pitch, 1.0))
        held, level = self.unlevelled(tilted), self.make().update(VelocityCommand(), tilted, DT)
        assert (level[3] - held[3]) * roll <= 0.0
        assert (level[4] - held[4]) * pitch <= 0.0
        assert (level[3] - held[3], level[4] - held[4]) != (0.0, 0.0)

    def unlevelled(self, navigation: Navigation) -> Wrench:
        """Return the wrench at this attitude apart from levelling: weight and lift, if the law has them."""
        return NO_RESIDUAL

    def is_within_limits(self, wrench: Wrench) -> bool:
        finite = all(map(math.isfinite, wrench))
        return finite and all(abs(x) <= most * (1.0 + 1e-9) for x, most in zip(wrench, self.limits, strict=True))

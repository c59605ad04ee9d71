"""The cascaded controller: single loops against closed forms, then the whole on a simple vehicle."""

import math

import pytest

from hil.autonomy.control.controller import (
    AxisGains,
    CascadedController,
    Drag,
    Gains,
    HoldGains,
    Navigation,
    VelocityCommand,
    Wrench,
    heave_for_depth,
    wrap,
)
from hil.common.schema import parse
from sim.rotations import from_euler, integrate, rotate, to_euler

LEVEL = (1.0, 0.0, 0.0, 0.0)
STILL = (0.0, 0.0, 0.0)
AT_REST = Navigation(LEVEL, STILL, STILL, 5.0)
# a small observation vehicle: rigid plus added
INERTIA: Wrench = (19.9, 20.6, 32.2, 0.45, 0.37, 0.59)
DT = 0.02

PLAIN = AxisGains(p=2.0, limit=100.0)
P_ONLY = Gains(
    *(PLAIN, PLAIN, PLAIN, PLAIN, PLAIN, PLAIN),
    depth=HoldGains(p=0.5, limit=0.4),
    heading=HoldGains(p=1.5, limit=0.5),
    roll=HoldGains(p=2.0, limit=2.0),
    pitch=HoldGains(p=2.0, limit=2.0),
)


def first_wrench(gains: Gains, command: VelocityCommand, navigation: Navigation = AT_REST) -> Wrench:
    return CascadedController(gains, INERTIA).update(command, navigation, DT)


def test_proportional_force_is_gain_times_error_times_inertia() -> None:
    wrench = first_wrench(P_ONLY, VelocityCommand(0.3, -0.2, 0.1, 0.25))
    rates = (0.3, -0.2, 0.1, 0.0, 0.0, 0.25)
    assert wrench == pytest.approx([2.0 * rate * inertia for rate, inertia in zip(rates, INERTIA, strict=True)])
    moving = AT_REST._replace(velocity=(0.3, -0.2, 0.1), angular_velocity=(0.0, 0.0, 0.25))
    assert first_wrench(P_ONLY, VelocityCommand(0.3, -0.2, 0.1, 0.25), moving) == pytest.approx([0.0] * 6)


def test_integral_force_grows_with_error_times_time() -> None:
    gains = P_ONLY._replace(surge=AxisGains(p=0.0, i=3.0))
    controller = CascadedController(gains, INERTIA)
    forces = [controller.update(VelocityCommand(surge=0.1), AT_REST, DT)[0] for _ in range(50)]
    assert forces[-1] == pytest.approx(INERTIA[0] * 3.0 * 0.1 * 50 * DT)
    controller.reset()
    assert controller.update(VelocityCommand(), AT_REST, DT) == pytest.approx([0.0] * 6)


def test_derivative_opposes_acceleration_and_ignores_command_steps() -> None:
    gains = P_ONLY._replace(yaw_rate=AxisGains(p=0.0, d=0.5, filter=0.0))
    controller = CascadedController(gains, INERTIA)
    controller.update(VelocityCommand(), AT_REST, DT)
    assert controller.update(VelocityCommand(yaw_rate=1.0), AT_REST, DT)[5] == 0.0
    turning = AT_REST._replace(angular_velocity=(0.0, 0.0, 0.1))
    assert controller.update(VelocityCommand(yaw_rate=1.0), turning, DT)[5] == pytest.approx(-0.5 * 0.1 / DT * 0.59)


def test_derivative_has_no_spike_when_updates_are_irregular() -> None:
    """A command that comes just after an update runs the loop again 10 us later."""
    gains = P_ONLY._replace(yaw_rate=AxisGains(p=0.0, d=0.5, filter=0.02))
    controller = CascadedController(gains, INERTIA)
    controller.update(VelocityCommand(), AT_REST, DT)
    noisy = AT_REST._replace(angular_velocity=(0.0, 0.0, 0.001))
    assert abs(controller.update(VelocityCommand(), noisy, 1e-5)[5]) <= 0.5 * 0.001 / 0.02 * 0.59


def test_feedforward_is_added_and_limited() -> None:
    gains = P_ONLY._replace(surge=AxisGains(p=0.0, feedforward=1.5), sway=AxisGains(p=5.0, limit=2.0))
    wrench = first_wrench(gains, VelocityCommand(surge=0.4, sway=-3.0))
    assert wrench[0] == pytest.approx(1.5 * 0.4 * INERTIA[0])
    assert wrench[1] == pytest.approx(-2.0 * INERTIA[1])


def test_integral_stops_at_the_limit_and_recovers_at_once() -> None:
    gains = P_ONLY._replace(surge=AxisGains(p=1.0, i=5.0, limit=2.0))
    controller = CascadedController(gains, INERTIA)
    for _ in range(1000):
        controller.update(VelocityCommand(surge=1.0), AT_REST, DT)
    fast = AT_REST._replace(velocity=(1.5, 0.0, 0.0))
    forces = [controller.update(VelocityCommand(surge=1.0), fast, DT)[0] for _ in range(30)]
    assert forces[0] < 2.0 * INERTIA[0]
    assert forces[-1] < 0.0


@pytest.mark.parametrize(("lack", "grows"), [(10.0, False), (0.0, True), (-10.0, True)])
def test_a_saturated_axis_does_not_integrate_further(lack: float, grows: bool) -> None:
    gains = P_ONLY._replace(surge=AxisGains(p=1.0, i=5.0))
    controller = CascadedController(gains, INERTIA)
    residual = (lack, 0.0, 0.0, 0.0, 0.0, 0.0)
    first, *_, last = [controller.update(VelocityCommand(surge=0.2), AT_REST, DT, residual)[0] for _ in range(20)]
    assert (last > first) == grows


@pytest.mark.parametrize(
    ("field", "value"), [("velocity", (math.nan,) * 3), ("orientation", (math.nan,) * 4), ("depth", math.nan)]
)
def test_non_finite_measurements_have_no_effect_on_later_output(field: str, value: object) -> None:
    broken = Navigation(**(AT_REST._asdict() | {field: value}))
    controller = CascadedController(Gains(), INERTIA)
    command = VelocityCommand(depth=5.0, heading=0.0)
    controller.update(command, AT_REST, DT)
    assert all(map(math.isfinite, controller.update(command, broken, DT)))
    assert controller.update(command, AT_REST, DT) == pytest.approx([0.0] * 6)


def test_depth_error_gives_a_limited_heave_command() -> None:
    assert first_wrench(P_ONLY, VelocityCommand(depth=5.2))[2] == pytest.approx(2.0 * 0.5 * 0.2 * INERTIA[2])
    assert first_wrench(P_ONLY, VelocityCommand(depth=50.0))[2] == pytest.approx(2.0 * 0.4 * INERTIA[2])
    assert first_wrench(P_ONLY, VelocityCommand(depth=0.0))[2] == pytest.approx(-2.0 * 0.4 * INERTIA[2])
    assert first_wrench(P_ONLY, VelocityCommand(heave=9.0, depth=5.0))[2] == 0.0


@pytest.mark.parametrize(("roll", "pitch"), [(0.3, 0.0), (0.0, -0.4), (-0.2, 0.3)])
def test_a_tilted_vehicle_corrects_depth_along_the_vertical(roll: float, pitch: float) -> None:
    """The heave command gives the vertical speed that the depth error requires."""
    orientation = from_euler(roll, pitch, 0.7)
    navigation = Navigation(orientation, STILL, (0.3, 0.1, 0.0), 5.0)
    heave = first_wrench(P_ONLY, VelocityCommand(depth=5.2), navigation)[2] / (2.0 * INERTIA[2])
    assert rotate(orientation, (0.3, 0.1, heave))[2] == pytest.approx(0.5 * 0.2)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_steep_fast_vehicle_is_not_commanded_more_heave_than_its_limit(side: float) -> None:
    """At 60 degrees of pitch, 2 m/s ahead is 1.7 m/s vertically, which heave cannot compensate."""
    steep = AT_REST._replace(orientation=from_euler(0.0, side * 1.05, 0.0), velocity=(2.0, 0.0, 0.0))
    assert heave_for_depth(5.0, steep, P_ONLY.depth) == pytest.approx(side * 0.4 / 0.5)


@pytest.mark.parametrize(("heading", "target", "rate"), [(0.0, 0.2, 0.3), (3.1, -3.1, 0.5), (-3.1, 3.1, -0.5)])
def test_heading_turns_the_short_way_within_its_rate_limit(heading: float, target: float, rate: float) -> None:
    navigation = AT_REST._replace(orientation=from_euler(0.0, 0.0, heading))
    turn = first_wrench(P_ONLY, VelocityCommand(heading=target), navigation)[5] / (2.0 * INERTIA[5])
    assert turn == pytest.approx(max(-0.5, min(0.5, 1.5 * wrap(target - heading))))
    assert turn * rate > 0.0


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.5, 0.0), (0.0, 0.6), (-0.4, 0.5)])
def test_yaw_rate_acts_about_the_vertical_while_roll_and_pitch_level(roll: float, pitch: float) -> None:
    """The output rates change the heading as commanded, and roll and pitch as their loops require."""
    orientation = from_euler(roll, pitch, 1.0)
    navigation = AT_REST._replace(orientation=orientation)
    moments = first_wrench(P_ONLY, VelocityCommand(yaw_rate=0.3), navigation)[3:]
    rates = [moment / (2.0 * inertia) for moment, inertia in zip(moments, INERTIA[3:], strict=True)]
    after = to_euler(integrate(orientation, rates, 1e-6))
    change = [(b - a) / 1e-6 for a, b in zip(to_euler(orientation), after, strict=True)]
    assert change == pytest.approx([-2.0 * roll, -2.0 * pitch, 0.3], abs=1e-5)


@pytest.mark.parametrize("angle", [-10.0, -math.pi, -3.0, 0.0, 3.0, math.pi, 7.0, 100.0])
def test_angles_are_wrapped_to_half_a_turn(angle: float) -> None:
    assert -math.pi <= wrap(angle) < math.pi
    assert math.remainder(wrap(angle) - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_gains_are_parsed_from_a_table() -> None:
    table = {
        "surge": {"p": 3.0, "limit": 5.0},
        "yaw_rate": {"p": 2.0, "filter": "10 ms"},
        "depth": {"p": 1, "limit": 0.3},
    }
    gains = parse(table, Gains, "vehicle.toml: control")
    assert gains.surge == AxisGains(p=3.0, limit=5.0)
    assert gains.yaw_rate.filter == 0.01
    assert gains.depth == HoldGains(1.0, 0.3)
    assert gains.sway == Gains().sway


def test_a_vehicle_holds_position_in_the_current_that_its_gains_allow_for() -> None:
    """The integral's bound is large enough for a current of this speed."""
    drag, current = Drag(12.0, 40.0), 1.0
    controller, speed = CascadedController(Gains(), INERTIA, [drag, drag]), 0.0
    for _ in range(round(30.0 / DT)):
        navigation = AT_REST._replace(velocity=(speed, 0.0, 0.0))
        x = controller.update(VelocityCommand(), navigation, DT)[0]
        relative = speed + current
        speed += (x - drag.at(abs(relative)) * (1.0 if relative > 0.0 else -1.0)) / INERTIA[0] * DT
    assert abs(speed) < 0.01

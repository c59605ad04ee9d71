"""Trajectories: on the curve they describe, within the limits, from rest to rest."""

import importlib
import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.paths.curves import Chain, Curve, circle, helix, polyline, straight
from hil.autonomy.paths.dubins import Pose, dubins
from hil.autonomy.paths.spline import Spline
from hil.autonomy.paths.trajectory import Limits, Setpoint, Trajectory, track_setpoint
from hil.common.errors import MissionError

WIDE = Limits(speed=2.0, vertical_speed=2.0, yaw_rate=2.0, acceleration=0.3, lateral_acceleration=5.0)
COORDINATES = st.floats(-20.0, 20.0)
POINTS = st.tuples(COORDINATES, COORDINATES, st.floats(1.0, 10.0))
HEADINGS = st.floats(-math.pi, math.pi)
WAYPOINTS = [(0.0, 0.0, 3.0), (10.0, 2.0, 4.0), (14.0, 12.0, 6.0), (5.0, 15.0, 5.0), (0.0, 25.0, 5.0)]
CURVES: dict[str, Curve] = {
    "straight": Chain([straight((1.0, 2.0, 3.0), (9.0, -4.0, 5.0))]),
    "spline": Spline(WAYPOINTS),
    "dubins": dubins(Pose((0.0, 0.0, 2.0), 1.0), Pose((15.0, 5.0, 6.0), -2.0), 2.0),
    "helix": helix((5.0, 5.0, 2.0), 3.0, -2.5, 6.0, 0.7),
    "circle": circle((5.0, 5.0, 2.0), 3.0),
    "polyline": polyline(WAYPOINTS),
}


def wrap_angle(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


@pytest.mark.parametrize("name", CURVES)
def test_direction_turn_and_length_agree_with_the_position(name: str) -> None:
    """Direction, turn and length of the curve equal finite differences of its position."""
    curve, step = CURVES[name], 1e-4
    corners = curve.corners()
    for number in range(1, 200):
        along = curve.length * number / 200
        if any(abs(along - corner) < 2.0 * step for corner in corners):
            continue
        before, middle, after = (curve.at(along + side * step) for side in (-1.0, 0.0, 1.0))
        north, east, down = ((b - a) / (2.0 * step) for a, b in zip(before.position, after.position, strict=True))
        assert math.hypot(north, east, down) == pytest.approx(1.0, abs=1e-6)  # measured along the curve
        assert math.atan2(down, math.hypot(north, east)) == pytest.approx(middle.slope, abs=1e-6)
        assert wrap_angle(math.atan2(east, north) - middle.heading) == pytest.approx(0.0, abs=1e-6)
        assert wrap_angle(after.heading - before.heading) / (2.0 * step) == pytest.approx(middle.heading_rate, abs=1e-5)


@pytest.mark.parametrize("name", CURVES)
def test_a_trajectory_starts_and_ends_at_rest(name: str) -> None:
    run, step = Trajectory(CURVES[name], 0.8, WIDE), 0.02
    times = [step * number for number in range(int(run.duration / step) + 1)]
    points = [run.at(time) for time in times]
    assert points[0].position == pytest.approx(CURVES[name].at(0.0).position)
    end = CURVES[name].at(CURVES[name].length).position
    assert run.at(run.duration + 5.0).position == pytest.approx(end, abs=1e-6)
    assert run.at(run.duration).velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    for before, after in pairwise(points):
        moved = [(b - a) / step for a, b in zip(before.position, after.position, strict=True)]
        mean = [(a + b) / 2.0 for a, b in zip(before.velocity, after.velocity, strict=True)]
        assert moved == pytest.approx(mean, abs=0.01)  # the velocity is that of the position
        assert math.hypot(*after.velocity) <= 0.8 + 1e-9
        assert abs(math.hypot(*after.velocity) - math.hypot(*before.velocity)) <= WIDE.acceleration * step + 1e-9
        assert abs(wrap_angle(after.heading - before.heading)) <= WIDE.yaw_rate * step + 1e-9
        assert abs(after.yaw_rate) <= WIDE.yaw_rate


def test_a_trapezoidal_speed_profile_has_the_values_worked_out_by_hand() -> None:
    """A path of 10 m at 1 m/s with 0.5 m/s² has ramps of 2 s and 1 m and takes 12 s; one of 1 m never reaches that
    speed.
    """
    limits = WIDE._replace(acceleration=0.5)
    run = Trajectory(polyline([(0.0, 0.0, 5.0), (10.0, 0.0, 5.0)]), 1.0, limits)
    assert run.duration == pytest.approx(12.0)
    for time, north, speed in ((1.0, 0.25, 0.5), (2.0, 1.0, 1.0), (6.0, 5.0, 1.0), (11.0, 9.75, 0.5)):
        assert run.at(time).position == pytest.approx((north, 0.0, 5.0))
        assert run.at(time).velocity == pytest.approx((speed, 0.0, 0.0))
    short = Trajectory(polyline([(0.0, 0.0, 5.0), (0.5, 0.0, 5.0)]), 1.0, limits)
    assert short.duration == pytest.approx(2.0)
    assert short.at(1.0).velocity[0] == pytest.approx(0.5)


def test_corners_are_turned_on_the_spot() -> None:
    """Two legs of 10 m with a right angle between take 2 x 12 s and a quarter turn at 0.5 rad/s."""
    limits = WIDE._replace(acceleration=0.5, yaw_rate=0.5)
    run = Trajectory(polyline([(0.0, 0.0, 5.0), (10.0, 0.0, 5.0), (10.0, -10.0, 5.0)]), 1.0, limits)
    assert run.duration == pytest.approx(24.0 + math.pi)
    turning = run.at(12.0 + math.pi / 2.0)
    assert turning.position == pytest.approx((10.0, 0.0, 5.0))
    assert turning.velocity == (0.0, 0.0, 0.0)
    assert (turning.heading, turning.yaw_rate) == pytest.approx((-math.pi / 4.0, -0.5))
    assert run.at(12.0 + math.pi + 6.0).position == pytest.approx((10.0, -5.0, 5.0))


@given(st.floats(0.5, 5.0), st.floats(0.1, 3.0), st.sampled_from([-1.0, 1.0]), st.floats(-5.0, 5.0), HEADINGS)
def test_a_helix_has_its_radius_and_pitch(
    radius: float, turns: float, side: float, dive: float, bearing: float
) -> None:
    curve = helix((7.0, -3.0, 10.0), radius, side * turns, dive, bearing)
    assert curve.length == pytest.approx(math.hypot(2.0 * math.pi * radius * turns, dive))
    for share in (0.0, 0.3, 1.0):
        (north, east, down), *_ = curve.at(share * curve.length)
        assert math.dist((north, east), (7.0, -3.0)) == pytest.approx(radius)
        assert down == pytest.approx(10.0 + share * dive)
        angle = bearing + side * share * turns * 2.0 * math.pi
        assert wrap_angle(math.atan2(east + 3.0, north - 7.0) - angle) == pytest.approx(0.0, abs=1e-6)


def test_a_spline_agrees_with_scipy() -> None:
    interpolate = importlib.import_module("scipy.interpolate")  # it has no type information
    knots = [0.0]
    for a, b in pairwise(WAYPOINTS):
        knots.append(knots[-1] + math.dist(a, b))
    reference = interpolate.CubicSpline(knots, WAYPOINTS, bc_type="natural")
    curve = Spline(WAYPOINTS)
    fine = reference([knots[-1] * number / 20000 for number in range(20001)]).tolist()
    along = [0.0]
    for a, b in pairwise(fine):
        along.append(along[-1] + math.dist(a, b))
    assert curve.length == pytest.approx(along[-1], rel=1e-6)
    for number in range(0, 20001, 997):
        assert curve.at(along[number]).position == pytest.approx(fine[number], abs=1e-4)


@given(POINTS, HEADINGS, POINTS, HEADINGS, st.floats(0.5, 4.0))
def test_a_dubins_path_arrives_within_turn_radius_and_slope(
    start: Any, heading: float, end: Any, toward: float, radius: float
) -> None:
    if math.dist(start[:2], end[:2]) < 0.1:
        return
    curve = dubins(Pose(start, heading), Pose(end, toward), radius, 0.4)
    place = curve.at(curve.length)
    assert place.position == pytest.approx(end, abs=1e-6)
    assert wrap_angle(place.heading - toward) == pytest.approx(0.0, abs=1e-6)
    assert curve.corners() == []
    for piece in curve.pieces:
        assert abs(piece.slope) <= 0.4 + 1e-9
        assert abs(piece.heading_rate) <= math.cos(piece.slope) / radius + 1e-9
    again = curve.at(0.0)
    assert again.position == start
    assert wrap_angle(again.heading - heading) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), HEADINGS, HEADINGS)
def test_no_other_three_segments_are_shorter_than_dubins(
    north: float, east: float, heading: float, toward: float
) -> None:
    """The path on from the end of any first arc, by brute force, is no shorter than the whole path states."""
    if math.hypot(north, east) < 0.1:
        return
    goal = Pose((north, east, 0.0), toward)
    shortest = dubins(Pose((0.0, 0.0, 0.0), heading), goal, 1.0).length
    assert shortest >= math.hypot(north, east) - 1e-9
    for heading_rate in (-1.0, 0.0, 1.0):
        for length in (0.3, 1.0, 2.5):
            on = (
                circle((0.0, 0.0, 0.0), 1.0)
                .pieces[0]
                ._replace(start=(0.0, 0.0, 0.0), heading=heading, heading_rate=heading_rate, length=length)
                .at(length)
            )
            if math.dist(on.position[:2], (north, east)) > 1e-3:
                assert shortest <= length + dubins(Pose(on.position, on.heading), goal, 1.0).length + 1e-6


@pytest.mark.parametrize(
    ("curve", "speed", "limits", "message"),
    [
        (CURVES["circle"], 3.0, WIDE, "not between 0 and the vehicle's 2 m/s"),
        (CURVES["circle"], 1.0, WIDE._replace(yaw_rate=0.3), r"go at 0\.9 m/s"),  # 0.3 rad/s x 3 m
        (CURVES["circle"], 1.0, WIDE._replace(lateral_acceleration=0.12), r"go at 0\.6 m/s"),  # root of 0.12 x 3
        (polyline([(0.0, 0.0, 0.0), (3.0, 0.0, 4.0)]), 1.0, WIDE._replace(vertical_speed=0.4), r"go at 0\.5 m/s"),
        (CURVES["helix"], 0.5, WIDE._replace(deepest=7.0), r"0 to 7 m; move the path"),
        (CURVES["straight"], 0.5, WIDE._replace(shallowest=3.5), r"3\.0 m deep.*3\.5 to 11000 m"),
        (polyline([(0.0, 0.0, 0.0), (3.0, 0.0, 4.0)]), 0.1, WIDE._replace(climb_angle=0.5), r"53\.1 deg.*28\.6 deg"),
        (polyline([(0.0, 0.0, 4.0), (3.0, 0.0, 0.0)]), 0.1, WIDE._replace(climb_angle=0.5), r"53\.1 deg.*longer"),
        (CURVES["circle"], 0.1, WIDE._replace(turn_radius=3.5), r"radius of 3\.00 m.*needs 3\.5 m"),
        (CURVES["helix"], 0.1, WIDE._replace(turn_radius=3.01), r"radius of 3\.00 m"),
        (CURVES["spline"], 0.1, WIDE._replace(turn_radius=30.0), r"bends with a radius"),
        (CURVES["polyline"], 0.1, WIDE._replace(turn_radius=1.0), r"10\.2 m along.*a corner.*spline or Dubins"),
    ],
)
def test_trajectories_beyond_a_limit_are_refused_with_the_remedy(
    curve: Curve, speed: float, limits: Limits, message: str
) -> None:
    with pytest.raises(MissionError, match=message):
        Trajectory(curve, speed, limits)


@pytest.mark.parametrize(
    "make", [lambda: polyline([(0.0, 0.0, 1.0)]), lambda: Spline([(0.0, 0.0, 1.0)]), lambda: Chain([])]
)
def test_degenerate_curves_are_refused(make: Any) -> None:
    with pytest.raises(MissionError, match="at least"):
        make()
    with pytest.raises(MissionError, match="neither may be 0"):
        circle((0.0, 0.0, 0.0), 1.0, 0.0)
    with pytest.raises(MissionError, match="turning radius above 0 m"):
        dubins(Pose((0.0, 0.0, 0.0), 0.0), Pose((9.0, 0.0, 0.0), 0.0), 0.0)


@pytest.mark.parametrize("name", ["spline", "helix", "polyline", "dubins"])
def test_a_vehicle_that_follows_the_commands_stays_on_the_curve(name: str) -> None:
    """A vehicle with a lag of 0.3 s starts 1 m beside and 0.5 rad off; it closes in and arrives."""
    limits = WIDE._replace(speed=1.0, yaw_rate=1.0)
    run, step = Trajectory(CURVES[name], 0.5, limits), 0.05
    (north, east, down), heading = run.at(0.0).position, run.at(0.0).heading + 0.5
    north, errors = north + 1.0, []
    surge = sway = heave = yaw_rate = 0.0
    for number in range(int((run.duration + 10.0) / step)):
        command = track_setpoint(run.at(number * step), (north, east, down), heading, limits, gain=0.8)
        assert math.hypot(command.surge, command.sway) <= 1.0 + 1e-9
        assert abs(command.yaw_rate) <= 1.0
        surge += (command.surge - surge) * step / 0.3
        sway += (command.sway - sway) * step / 0.3
        heave += (command.heave - heave) * step / 0.3
        yaw_rate += (command.yaw_rate - yaw_rate) * step / 0.3
        heading += yaw_rate * step
        north += (surge * math.cos(heading) - sway * math.sin(heading)) * step
        east += (surge * math.sin(heading) + sway * math.cos(heading)) * step
        down += heave * step
        errors.append(math.dist((north, east, down), run.at((number + 1) * step).position))
    assert max(errors[int(10.0 / step) :]) < 0.35
    assert errors[-1] < 0.01


def test_the_tracking_command_has_the_value_worked_out_by_hand() -> None:
    """A vehicle bound north at 0.4 m/s, bow to the east, 1 m too far west, goes half ahead, half to port."""
    wanted = Setpoint((5.0, 5.0, 3.0), (0.4, 0.0, 0.1), 0.0, 0.2)
    command = track_setpoint(wanted, (5.0, 4.0, 3.5), math.pi / 2.0, Limits(), 0.5)
    assert (command.surge, command.sway, command.heave) == pytest.approx((0.5, -0.4, -0.15))
    assert command.yaw_rate == pytest.approx(-0.5)  # 0.2 - 0.5 x 1.57, held at the limit


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_vehicle_far_from_its_setpoint_keeps_to_the_limits_in_both_directions(side: float) -> None:
    wanted, limits = Setpoint((0.0, 0.0, 50.0 + side * 40.0), (0.0, 0.0, 0.0), side * 2.0, 0.0), Limits()
    command = track_setpoint(wanted, (side * -90.0, 0.0, 50.0), 0.0, limits, 1.0)
    assert (command.surge, command.heave, command.yaw_rate) == pytest.approx(
        (side * limits.speed, side * limits.vertical_speed, side * limits.yaw_rate)
    )


@pytest.mark.parametrize("name", ["circle", "helix", "dubins", "straight"])
def test_curves_just_within_turn_radius_and_climb_angle_are_allowed(name: str) -> None:
    """A helix and a circle of 3 m and Dubins' 2 m are allowed, and 0.3 rad is steeper than any of them."""
    radius = 2.0 if name == "dubins" else 3.0
    trajectory = Trajectory(CURVES[name], 0.3, WIDE._replace(turn_radius=radius, climb_angle=0.3))
    assert trajectory.duration == Trajectory(CURVES[name], 0.3, WIDE).duration

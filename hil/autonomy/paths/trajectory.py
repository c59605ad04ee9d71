"""Trajectories: a curve traversed in time, checked against the vehicle's limits.

The speed profile is a trapezoid with constant acceleration: from rest to cruising speed, and to rest at the end and at
every corner. At a corner the vehicle turns on the spot, if it can. The world frame is NED: headings in rad from north,
clockwise seen from above; depth is down. Currents are not modelled: speeds are over ground.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import copysign, cos, degrees, inf, pi, sin, sqrt
from typing import Annotated, NamedTuple

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.autonomy.paths.curves import Curve, PathPoint, Position
from hil.common.errors import MissionError
from hil.common.schema import Range

# A curve is checked at this spacing (m), and at no fewer than this number of places.
_SPACING = 0.05
_MIN_CHECKS = 200
_BEFORE = 1e-9  # m; distance before a corner at which to evaluate the curve just before it
# Tolerance of limits, relative or absolute, for rounding.
_SLACK = 1e-6


class Limits(NamedTuple):
    """Limits of a vehicle's motion and of the depth: m/s, m/s², rad/s, m.

    `speed` is the maximum along the path, `vertical_speed` up or down, `yaw_rate` of turning, `acceleration` along the
    path, `lateral_acceleration` across it. At any speed, the path may not be steeper than `climb_angle` (rad, up or
    down) and not bend more sharply than `turn_radius` (m); 0 is for a vehicle that turns on the spot.
    """

    speed: Annotated[float, Range(1e-3, 20.0, "m/s")] = 1.0
    vertical_speed: Annotated[float, Range(1e-3, 10.0, "m/s")] = 0.4
    yaw_rate: Annotated[float, Range(1e-3, 10.0, "rad/s")] = 0.5
    acceleration: Annotated[float, Range(1e-3, 10.0)] = 0.2
    lateral_acceleration: Annotated[float, Range(1e-3, 10.0)] = 0.5
    shallowest: Annotated[float, Range(-1.0, 11_000.0, "m")] = 0.0
    deepest: Annotated[float, Range(0.0, 11_000.0, "m")] = 11_000.0
    climb_angle: Annotated[float, Range(0.01, pi / 2.0, "rad")] = pi / 2.0
    turn_radius: Annotated[float, Range(0.0, 1000.0, "m")] = 0.0


class Setpoint(NamedTuple):
    """Target state of a vehicle at one time: position m and velocity m/s, NED; heading rad; its rate rad/s."""

    position: Position
    velocity: tuple[float, float, float]
    heading: float
    yaw_rate: float


class _Leg(NamedTuple):
    """A run from rest to rest between two corners, then a turn on the spot; in m along the curve, s, m/s."""

    begin: float
    length: float
    speed: float
    ramp: float
    starts: float
    turns: float  # time when the run ends and the turn begins
    ends: float


class Trajectory:
    """Motion along `curve` at up to `speed` m/s, at rest at both ends and at corners. `duration` in s.

    Raises MissionError if it breaks one of the `limits`, with the place and a speed within the limits.
    """

    def __init__(self, curve: Curve, speed: float, limits: Limits) -> None:
        if not 0.0 < speed <= limits.speed * (1.0 + _SLACK):
            raise MissionError(f"a speed of {speed:g} m/s is not between 0 and the vehicle's {limits.speed:g} m/s")
        require_feasible(curve, speed, limits)
        self.curve = curve
        self._limits = limits
        self._legs: list[_Leg] = []
        self.duration = 0.0
        for begin, end in pairwise([0.0, *curve.corners(), curve.length]):
            self._legs.append(self._leg(begin, end, speed))
            self.duration = self._legs[-1].ends

    def at(self, time: float) -> Setpoint:
        """Return the setpoint `time` s after the start; before the start and after the end, that at rest there."""
        time = min(max(time, 0.0), self.duration)
        leg = next(leg for leg in self._legs if time <= leg.ends)
        if time > leg.turns:
            return self._turning(leg, time - leg.turns)
        along, speed = self._progress(leg, time - leg.starts)
        place = self.curve.at(min(leg.begin + along, leg.begin + leg.length - _BEFORE))
        level = speed * cos(place.slope)
        velocity = level * cos(place.heading), level * sin(place.heading), speed * sin(place.slope)
        return Setpoint(place.position, velocity, place.heading, speed * place.heading_rate)

    def _leg(self, begin: float, end: float, speed: float) -> _Leg:
        length, acceleration = end - begin, self._limits.acceleration
        speed = min(speed, sqrt(length * acceleration))  # a short leg does not reach the cruising speed
        ramp = speed / acceleration
        turns = self.duration + ramp + length / speed
        return _Leg(
            begin,
            length,
            speed,
            ramp,
            self.duration,
            turns,
            turns + abs(self._corner(end)) / self._limits.yaw_rate,
        )

    def _corner(self, along: float) -> float:
        """Return the jump of the heading (rad) at a corner; 0 at the end."""
        if along >= self.curve.length:
            return 0.0
        return wrap(self.curve.at(along).heading - self.curve.at(along - _BEFORE).heading)

    def _turning(self, leg: _Leg, time: float) -> Setpoint:
        end = leg.begin + leg.length
        rate = copysign(self._limits.yaw_rate, self._corner(end))
        place = self.curve.at(end - _BEFORE)
        return Setpoint(place.position, (0.0, 0.0, 0.0), place.heading + rate * time, rate)

    def _progress(self, leg: _Leg, time: float) -> tuple[float, float]:
        """Return the distance on the leg and the speed, `time` s after its start."""
        acceleration, left = self._limits.acceleration, leg.turns - leg.starts - time
        if time < leg.ramp:
            return 0.5 * acceleration * time * time, acceleration * time
        if left < leg.ramp:
            return leg.length - 0.5 * acceleration * left * left, acceleration * left
        return leg.speed * (time - 0.5 * leg.ramp), leg.speed


def require_feasible(curve: Curve, speed: float, limits: Limits) -> None:
    """Raise MissionError for the first place where traversing `curve` at `speed` m/s breaks a limit.

    The curve is checked every 5 cm and at 200 places or more, so the sharpest bend of a spline may be missed by less
    than that.
    """
    count = max(_MIN_CHECKS, int(curve.length / _SPACING))
    corners = curve.corners()
    if corners and limits.turn_radius > 0.0:
        raise MissionError(
            f"{_where(curve.at(corners[0]), corners[0])}: a corner, and the vehicle needs {limits.turn_radius:g} m to "
            "turn; lead it by a spline or Dubins paths"
        )
    for number in range(count + 1):
        along = curve.length * number / count
        place = curve.at(along)
        problem = _validate_point(place, speed, limits)
        if problem:
            raise MissionError(f"{_where(place, along)}: {problem}")


def _where(point: PathPoint, along: float) -> str:
    north, east, depth = point.position
    return f"{along:.1f} m along the path, at ({north:.1f} m north, {east:.1f} m east, {depth:.1f} m deep)"


def _validate_point(point: PathPoint, speed: float, limits: Limits) -> str | None:
    """Return which limit is broken at `point` at `speed` m/s, with the remedy; None if none is."""
    (_, _, depth), _, slope, heading_rate = point
    if not limits.shallowest - _SLACK <= depth <= limits.deepest + _SLACK:
        return f"outside of the depths allowed, {limits.shallowest:g} to {limits.deepest:g} m; move the path"
    if abs(slope) > limits.climb_angle + _SLACK:
        steep, limit = degrees(abs(slope)), degrees(limits.climb_angle)
        return f"{steep:.1f} deg steep, and the vehicle climbs at most {limit:.1f} deg; make the path longer"
    radius = cos(slope) / abs(heading_rate) if heading_rate else inf  # seen from above
    if radius < limits.turn_radius * (1.0 - _SLACK):
        return f"bends with a radius of {radius:.2f} m, and the vehicle needs {limits.turn_radius:g} m; widen it"
    limit = _fastest(slope, heading_rate, limits)
    if speed > limit * (1.0 + _SLACK):
        return f"too steep or sharp for {speed:g} m/s; go at {limit:.3g} m/s or widen it"
    return None


def _fastest(slope: float, heading_rate: float, limits: Limits) -> float:
    """Return the speed (m/s) within all limits on a path with this slope (rad) and turn (rad/m)."""
    speeds = [limits.speed]
    if slope:
        speeds.append(limits.vertical_speed / abs(sin(slope)))
    if heading_rate:
        speeds.append(limits.yaw_rate / abs(heading_rate))
        speeds.append(sqrt(limits.lateral_acceleration / abs(heading_rate) / cos(slope)))
    return min(speeds)


def track_setpoint(
    setpoint: Setpoint, position: Sequence[float], heading: float, limits: Limits, gain: float
) -> VelocityCommand:
    """Return the command that leads a vehicle at `position` (m, NED) and `heading` (rad) to its setpoint.

    It is the setpoint's velocity plus `gain` (1/s) times the position error, along the body's axes (roll and pitch are
    not modelled) and within the limits. A limited horizontal velocity keeps its direction.
    """
    north, east, down = (
        rate + gain * (wanted - here) for rate, wanted, here in zip(setpoint[1], setpoint[0], position, strict=True)
    )
    share = min(1.0, limits.speed / max(1e-12, sqrt(north * north + east * east)))
    yaw_rate = setpoint.yaw_rate + gain * wrap(setpoint.heading - heading)
    return VelocityCommand(
        surge=share * (north * cos(heading) + east * sin(heading)),
        sway=share * (east * cos(heading) - north * sin(heading)),
        heave=min(max(down, -limits.vertical_speed), limits.vertical_speed),
        yaw_rate=min(max(yaw_rate, -limits.yaw_rate), limits.yaw_rate),
    )

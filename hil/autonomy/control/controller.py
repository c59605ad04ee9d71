"""Cascaded controller of the vehicle: from a planner's velocity command to the wrench for the thrusters.

    depth ────P──> heave ──┐
    surge, sway ───────────┴─PI──> linear acceleration ── x inertia ──> X Y Z
    heading ──P──> turn rate ┐
    roll, pitch ──P──────────┴─> p q r ──PID──> angular acceleration ── x inertia ──> K M N

The structure is that of the reference platform ("Modular UUV Simulation Platform", Sensors 2022, 22(20), 8043):
position, velocity, attitude, angular rate; P, PI, PD or PID for each axis. The position loop is the planner's. All
loops output accelerations, so one set of gains serves vehicles of any size: the vehicle's own inertia, rigid-body plus
added mass, converts them to newtons. Weight, buoyancy, drag and Coriolis forces are not fed forward: the integrators
compensate them. The integrators of surge and sway are limited to the vehicle's possible drag, so that a vehicle stopped
by an obstacle does not keep pushing. Other control laws with the same interface: `hil.autonomy.control.families`.
"""

from collections.abc import Sequence
from itertools import zip_longest
from math import asin, atan2, cos, inf, pi, sin
from typing import Annotated, Any, NamedTuple

from hil.common.schema import Range, Reader, check_table, parse, reader_of
from hil.common.vectors import Quaternion, Vector3

Wrench = tuple[float, float, float, float, float, float]

NO_RESIDUAL: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
# m/s², rad/s²: a smaller residual is rounding, or the share that an undriven roll or pitch takes of another axis.
_ROUNDING = 1e-4
ABSURD = 1e6  # m/s or rad/s; a larger measurement or command is a fault
# Keys of [control] that are not gains of the cascade. They are read with the gains, so that their mistakes are reported
# together.
OTHERS: dict[str, Reader] = {
    "family": lambda family, _where: family,
    "options": check_table,
    "fins": reader_of("hil.autonomy.control.fin_control:FinGains"),
}
# Limit of the division by the share of heave in the vertical direction (1: upright), for strongly tilted vehicles.
_MIN_UPRIGHT = 0.5


class AxisGains(NamedTuple):
    """One velocity or angular-rate loop. Output: m/s² or rad/s², limited to ±`limit`.

    `p` in 1/s, `i` in 1/s², `d` without unit. `feedforward` in 1/s multiplies the commanded rate (a good value is
    linear damping over inertia). `filter` is the time constant of the derivative's low-pass, s. `slew` is the rate
    limit of the output, m/s³ or rad/s³. In surge and sway the integral is limited to the drag at the commanded speed
    plus an opposing `current` (m/s).
    """

    p: Annotated[float, Range(0.0, 100.0)]
    i: Annotated[float, Range(0.0, 100.0)] = 0.0
    d: Annotated[float, Range(0.0, 10.0)] = 0.0
    limit: Annotated[float, Range(1e-3, 1e3)] = 10.0
    feedforward: Annotated[float, Range(0.0, 100.0)] = 0.0
    filter: Annotated[float, Range(0.0, 1.0, "s")] = 0.02
    slew: Annotated[float, Range(0.01, inf)] = inf
    current: Annotated[float, Range(0.0, 10.0, "m/s")] = 1.0


class Drag(NamedTuple):
    """Drag of a vehicle along one axis: `linear` in N s/m, `quadratic` in N s²/m²."""

    linear: float
    quadratic: float

    def at(self, speed: float) -> float:
        """Return the drag (N) at a `speed` (m/s) of 0 or more."""
        return speed * (self.linear + self.quadratic * speed)


class HoldGains(NamedTuple):
    """Gains of an outer loop, which converts an error in m or rad to a rate: `p` in 1/s, `limit` in m/s or rad/s."""

    p: Annotated[float, Range(0.0, 20.0)]
    limit: Annotated[float, Range(1e-3, 10.0)]


class Gains(NamedTuple):
    """Gains of all loops of the cascade; the defaults suit a vehicle whose thrusters respond within about 0.1 s."""

    surge: AxisGains = AxisGains(p=4.0, i=6.0)
    sway: AxisGains = AxisGains(p=4.0, i=6.0)
    heave: AxisGains = AxisGains(p=4.0, i=6.0)
    roll_rate: AxisGains = AxisGains(p=6.0, i=4.0, limit=20.0)
    pitch_rate: AxisGains = AxisGains(p=6.0, i=4.0, limit=20.0)
    yaw_rate: AxisGains = AxisGains(p=6.0, i=4.0, limit=20.0)
    depth: HoldGains = HoldGains(p=0.8, limit=0.5)
    heading: HoldGains = HoldGains(p=1.0, limit=0.6)
    roll: HoldGains = HoldGains(p=2.0, limit=1.0)
    pitch: HoldGains = HoldGains(p=2.0, limit=1.0)


def gains_of(control: dict[str, Any], where: str) -> Gains:
    """Return the gains in the `[control]` table of a vehicle's file; `where` is for errors. Raises ConfigError."""
    return parse(control, Gains, where, OTHERS)


class VelocityCommand(NamedTuple):
    """Command of a planner to the vehicle. Roll and pitch setpoints are always zero.

    `surge`, `sway`, `heave` in m/s along FRD; `yaw_rate` in rad/s about the vertical, clockwise seen from above. With
    `depth` (m below the surface) `heave` is ignored; with `heading` (rad from north, clockwise) `yaw_rate` is only the
    feedforward of the heading loop.
    """

    surge: float = 0.0
    sway: float = 0.0
    heave: float = 0.0
    yaw_rate: float = 0.0
    depth: float | None = None
    heading: float | None = None


class Navigation(NamedTuple):
    """Navigation state of the vehicle, as the controller needs it.

    `orientation` (w, x, y, z) of FRD in NED; `angular_velocity` p q r in rad/s and `velocity` u v w over ground in m/s,
    both along FRD; `depth` in m.
    """

    orientation: Quaternion
    angular_velocity: Vector3
    velocity: Vector3
    depth: float


class CascadedController:
    """Cascade from a `VelocityCommand` to a wrench, one call in each control period.

    `inertia` is the diagonal of rigid-body plus added mass: kg for X Y Z, kg m² for K M N. `drags` of surge and sway
    limit the integrals of these loops; without them only the loop's own limit does. Coupling between the axes is not
    modelled. For a vehicle whose thrusters cannot roll or pitch it, these moments are computed all the same, and the
    allocator drops them.
    """

    def __init__(self, gains: Gains, inertia: Wrench, drags: Sequence[Drag] = ()) -> None:
        self._gains = gains
        self._inertia = inertia
        per_mass = [
            Drag(linear / mass, quadratic / mass) for (linear, quadratic), mass in zip(drags, inertia, strict=False)
        ]
        self._loops = [_Loop(axis, drag) for axis, drag in zip_longest(gains[:6], per_mass)]
        self._pitch = 0.0  # rad, setpoint

    @property
    def gains(self) -> Gains:
        """The present gains."""
        return self._gains

    def set_gains(self, gains: Gains) -> None:
        """Use other gains from the next call on; integrals do not change."""
        self._gains = gains
        for loop, axis in zip(self._loops, gains[:6], strict=True):
            loop.set_gains(axis)

    def reset(self) -> None:
        """Reset all integrals and derivatives, after a pause or a change of controller."""
        for loop in self._loops:
            loop.reset()

    def update(
        self, command: VelocityCommand, navigation: Navigation, dt: float, residual: Wrench = NO_RESIDUAL
    ) -> Wrench:
        """Return the wrench (X, Y, Z in N; K, M, N in N m; along FRD) for the next `dt` seconds, `dt` > 0.

        `residual` is what the allocator could not deliver of the last wrench (commanded minus delivered); an axis that
        lacks force does not integrate further in that direction. An axis whose measurement or command is nan or absurd
        holds its integral.
        """
        targets = velocity_targets(command, navigation, self._gains, self._pitch)
        measured = navigation.velocity + navigation.angular_velocity
        x, y, z, k, m, n = [
            inertia * loop.update(target, value, dt, axis_residual / inertia)
            for inertia, loop, target, value, axis_residual in zip(
                self._inertia, self._loops, targets, measured, residual, strict=True
            )
        ]
        return x, y, z, k, m, n


def velocity_targets(command: VelocityCommand, navigation: Navigation, gains: Gains, pitch: float = 0.0) -> Wrench:
    """Return the u, v, w (m/s) and p, q, r (rad/s) along FRD that the outer loops command.

    The hold gains lead depth and heading to their setpoints, roll to 0, and pitch to `pitch` rad.
    """
    heave = command.heave
    if command.depth is not None:
        heave = heave_for_depth(command.depth, navigation, gains.depth)
    return command.surge, command.sway, heave, *_rates(command, navigation.orientation, gains, pitch)


def _rates(command: VelocityCommand, orientation: Quaternion, gains: Gains, level: float) -> Vector3:
    """Return the p, q, r (rad/s) that lead roll to 0 and pitch to `level` rad, and turn about the vertical."""
    down = down_in_body(orientation)
    roll, pitch = atan2(down[1], down[2]), -asin(clamp(down[0], 1.0))
    roll_rate = clamp(-gains.roll.p * roll, gains.roll.limit)
    pitch_rate = clamp(gains.pitch.p * (level - pitch), gains.pitch.limit)
    yaw_rate = command.yaw_rate
    if command.heading is not None:
        error = wrap(command.heading - heading_of(orientation))
        yaw_rate = clamp(yaw_rate + gains.heading.p * error, gains.heading.limit)
    return (
        roll_rate + yaw_rate * down[0],
        pitch_rate * cos(roll) + yaw_rate * down[1],
        -pitch_rate * sin(roll) + yaw_rate * down[2],
    )


def heave_for_depth(depth: float, navigation: Navigation, hold: HoldGains) -> float:
    """Return the heave (m/s along FRD) that leads to `depth` (m) at the present attitude, surge and sway.

    A vehicle that is pitched by some degrees dives or climbs by its surge; this is compensated.
    """
    down = down_in_body(navigation.orientation)
    rate = clamp(hold.p * (depth - navigation.depth), hold.limit)
    u, v, _ = navigation.velocity
    heave = (rate - down[0] * u - down[1] * v) / max(down[2], _MIN_UPRIGHT)
    return clamp(heave, hold.limit / _MIN_UPRIGHT)


class _Loop:
    """PID loop with the derivative taken on the measurement and anti-windup."""

    __slots__ = ("_behind", "_drag", "_gains", "_integral", "_last", "_output", "_slope")

    def __init__(self, gains: AxisGains, drag: Drag | None) -> None:
        self._drag = drag if drag and any(drag) else None  # over inertia; all zero means unknown
        self.set_gains(gains)
        self.reset()

    def set_gains(self, gains: AxisGains) -> None:
        self._gains = tuple(gains)  # a plain tuple unpacks faster than a NamedTuple

    def reset(self) -> None:
        self._integral = 0.0
        self._slope = 0.0
        self._output = self._behind = 0.0  # last output, and the part that the rate limit withheld
        self._last: float | None = None

    def update(self, target: float, measured: float, dt: float, residual: float) -> float:
        p, i, d, limit, feedforward, time_constant, slew, current = self._gains
        if not (abs(measured) < ABSURD and abs(target) < ABSURD):  # without a valid measurement the integral holds
            return self._slewed(self._integral, dt)
        error = target - measured
        without_integral = p * error + feedforward * target
        if d:  # zero in most loops
            without_integral -= d * self._damped(measured, dt, time_constant)
        integral = self._integral + i * error * dt
        output = without_integral + integral
        if not (  # anti-windup: at the limit of the loop, of the thrusters or of the rate
            (abs(output) > limit and output * error > 0.0)
            or (abs(residual) > _ROUNDING and residual * error > 0.0)
            or self._behind * error > 0.0
        ):
            self._integral = clamp(integral, limit)
        if self._drag:
            self._integral = clamp(self._integral, self._drag.at(abs(target) + current))
        output = clamp(without_integral + self._integral, limit)
        return output if slew == inf else self._slewed(output, dt)

    def _damped(self, measured: float, dt: float, time_constant: float) -> float:
        """Return the low-pass filtered derivative of the measurement."""
        if self._last is not None:
            self._slope += ((measured - self._last) / dt - self._slope) * dt / (time_constant + dt)
        self._last = measured
        return self._slope

    def _slewed(self, output: float, dt: float) -> float:
        most = self._gains[6] * dt
        self._output, before = min(max(output, self._output - most), self._output + most), output
        self._behind = before - self._output
        return self._output


def wrap(angle: float) -> float:
    """Return `angle` (rad) wrapped into [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


def heading_of(orientation: Quaternion) -> float:
    """Return the heading (rad from north, clockwise, -pi to pi) of a body with this orientation (FRD in NED)."""
    w, x, y, z = orientation
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def down_in_body(orientation: Quaternion) -> Vector3:
    """Return the unit vector down, along FRD: the last row of the rotation matrix."""
    w, x, y, z = orientation
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


def clamp(value: float, limit: float) -> float:
    """Return `value` limited to ±`limit`."""
    if value > limit:
        return limit
    return -limit if value < -limit else value  # nan stays nan

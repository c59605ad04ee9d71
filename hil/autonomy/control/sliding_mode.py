"""Sliding mode control law with a boundary layer, based on a model of the vehicle.

For each axis with the velocity error e = nu - target and its integral E, the surface is s = e + slide E, and

    acceleration = -slide e - strength sat(s / layer),    wrench = inertia x acceleration + drag, weight, Coriolis

(Slotine & Li 1991, "Applied Nonlinear Control", chapter 7; Yoerger & Slotine, IEEE Journal of Oceanic Engineering
10(4), 1985, for underwater vehicles). It overcomes any disturbance and model error below `strength`: s stays in the
boundary layer, in which the law is smooth and does not chatter. E is integrated only inside the layer (the conditional
integrator of Seshagiri & Khalil, Automatica 41(1), 2005), so it removes the steady error and never winds up. The outer
loops, for depth, heading, roll and pitch, are those of the cascade.
"""

from math import inf
from typing import Annotated, ClassVar, NamedTuple

from hil.autonomy.control.controller import (
    ABSURD,
    NO_RESIDUAL,
    Gains,
    Navigation,
    VelocityCommand,
    Wrench,
    clamp,
    velocity_targets,
)
from hil.autonomy.control.model import Plant
from hil.common.schema import Range

_ROUNDING = 1e-6  # N, N m


class Surface(NamedTuple):
    """Sliding surface of one axis: `strength` in m/s² (rad/s²), `layer` in m/s (rad/s), `slide` in 1/s.

    Inside the layer it is a PI law with gain strength / layer + slide, which thruster lag limits. `limit` (m/s²,
    rad/s²) is the limit of the wrench over the inertia. `slew` (m/s³, rad/s³) is the rate limit of the acceleration
    that is added to the model's load.
    """

    strength: Annotated[float, Range(0.0, 100.0)]
    layer: Annotated[float, Range(1e-3, 10.0)]
    slide: Annotated[float, Range(0.0, 20.0)] = 1.0
    limit: Annotated[float, Range(1e-3, 1e3)] = 10.0
    slew: Annotated[float, Range(0.01, inf)] = inf


class SlidingSettings(NamedTuple):
    """`[control.sliding_mode]`; the defaults suit a vehicle whose thrusters respond within about 0.1 s."""

    surge: Surface = Surface(strength=1.5, layer=0.3)
    sway: Surface = Surface(strength=1.5, layer=0.3)
    heave: Surface = Surface(strength=1.5, layer=0.3)
    roll_rate: Surface = Surface(strength=4.0, layer=0.7)
    pitch_rate: Surface = Surface(strength=4.0, layer=0.7)
    yaw_rate: Surface = Surface(strength=4.0, layer=0.7)


class SlidingMode:
    """A `Controller` (hil/autonomy/control/families.py) for a vehicle like `plant`, with `settings`.

    `gains` are those of the outer loops. Not modelled: thruster lag, currents, coupling of the axes by mass.
    """

    Settings: ClassVar = SlidingSettings

    def __init__(self, plant: Plant, gains: Gains, settings: SlidingSettings = SlidingSettings()) -> None:
        self._plant = plant
        self._gains = gains
        self._settings = settings
        self._axes = [_Axis(surface) for surface in settings]

    def reset(self) -> None:
        """Reset all integrals, after a pause or a change of controller."""
        for axis in self._axes:
            axis.reset()

    def update(
        self, command: VelocityCommand, navigation: Navigation, dt: float, residual: Wrench = NO_RESIDUAL
    ) -> Wrench:
        """Return the wrench (X, Y, Z in N; K, M, N in N m; along FRD) for the next `dt` seconds, `dt` > 0.

        `residual` is what the allocator could not deliver of the last wrench (commanded minus delivered).
        """
        targets = velocity_targets(command, navigation, self._gains)
        measured = navigation.velocity + navigation.angular_velocity
        pushes = [
            axis.update(value - target, dt, axis_residual)
            for axis, value, target, axis_residual in zip(self._axes, measured, targets, residual, strict=True)
        ]
        u, v, w, p, q, r = (axis.reference(target) for axis, target in zip(self._axes, targets, strict=True))
        load = self._plant.load(navigation, (u, v, w, p, q, r))
        x, y, z, k, m, n = (
            clamp(inertia * push + held, inertia * surface.limit)
            for inertia, push, held, surface in zip(self._plant.inertia, pushes, load, self._settings, strict=True)
        )
        return x, y, z, k, m, n


class _Axis:
    """Control law of one axis; accelerations in m/s² or rad/s²."""

    __slots__ = ("_acceleration", "_integral", "_surface")

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self.reset()

    def reset(self) -> None:
        self._integral = 0.0  # integral of the error, m or rad
        self._acceleration = 0.0

    def reference(self, target: float) -> float:
        """Return the velocity that the surface leads to."""
        return target - self._surface.slide * self._integral

    def update(self, error: float, dt: float, residual: float) -> float:
        strength, layer, slide, limit, slew = self._surface
        if not abs(error) < ABSURD:  # without a valid measurement the integral holds
            return self._acceleration
        side = (error + slide * self._integral) / layer
        is_saturated = abs(residual) > _ROUNDING and residual * error < 0.0
        if abs(side) < 1.0 and not is_saturated:
            self._integral += error * dt
        target = clamp(-slide * error - strength * clamp(side, 1.0), limit)
        self._acceleration = min(max(target, self._acceleration - slew * dt), self._acceleration + slew * dt)
        return self._acceleration

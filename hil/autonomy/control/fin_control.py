"""Controller of a vehicle that steers by fins, such as a torpedo, which can be steered only while it moves.

    surge ───────────────────────────────PI──> X        for the propeller
    heave ───────> pitch ──P──> q ───────PI──> M  ┐
    yaw rate, heading ────────> r ───────PI──> N  ├──> the part that the thrusters do not deliver, to the fins
    level ─────────────────P──> p ───────PI──> K  ┘

The loops are those of hil/autonomy/control/controller.py. The vehicle dives by its pitch: a commanded heave or depth is
converted to the pitch at which forward motion gives this rate of descent, so any planner can steer it. The depth loop
is at most a quarter as fast as the pitch loop. The force of a fin grows with the square of the speed, and deflections
are computed for the present speed; below `least_speed` for that speed, as no angle would be large enough.
"""

from collections.abc import Sequence
from math import asin, copysign
from typing import Annotated, NamedTuple

from hil.autonomy.control.allocation import Allocator
from hil.autonomy.control.controller import (
    ABSURD,
    NO_RESIDUAL,
    CascadedController,
    Gains,
    Navigation,
    VelocityCommand,
    Wrench,
    clamp,
    down_in_body,
)
from hil.common.schema import Range

# Forces come with the moments and cannot be chosen; of the moments, roll matters least.
_AXIS_WEIGHTS = (1e-6, 1e-6, 1e-6, 0.1, 1.0, 1.0)
# A residual below this share of the command is rounding, and must not stop an integrator.
_ROUNDING = 1e-6
# The gain of the pitch hold is at least so many times that of the depth hold, which it serves.
DIVE_BY_PITCH = 4.0


class FinGains(NamedTuple):
    """`[control.fins]` of a vehicle's file.

    `pitch_limit`: the steepest dive or climb. `climb` in 1/s: bandwidth of the filter that finds the trim pitch, from
    the angle between the bow and the path. `least_speed`: the slowest speed at which the fins are effective; while
    commanded to turn, dive or move at all, the vehicle goes at least this fast.
    """

    pitch_limit: Annotated[float, Range(0.02, 1.2, "rad")] = 0.35
    climb: Annotated[float, Range(0.0, 5.0)] = 0.1
    least_speed: Annotated[float, Range(0.05, 5.0, "m/s")] = 0.5


class FinController(CascadedController):
    """Cascade from a `VelocityCommand` to a wrench without sway and heave force, one call in each control period.

    `inertia` as for a CascadedController. Sway commands are ignored. The vehicle can go astern: fins then act in the
    opposite direction, which `FinAllocator` takes into account.
    """

    def __init__(self, gains: Gains, fins: FinGains, inertia: Wrench) -> None:
        super().__init__(gains, inertia)
        self._fins = fins
        self._trim = self._pitch = 0.0

    def reset(self) -> None:
        """Reset all integrals, after a pause or a change of controller."""
        super().reset()
        self._trim = self._pitch = 0.0

    def update(
        self, command: VelocityCommand, navigation: Navigation, dt: float, residual: Wrench = NO_RESIDUAL
    ) -> Wrench:
        """Return the wrench (X in N; K, M, N in N m; along FRD; Y and Z 0) for the next `dt` seconds, `dt` > 0.

        `residual` is the part of the last wrench that thrusters and fins could not deliver.
        """
        surge = self._surge(command)
        self._pitch = self._pitch_for(command, navigation, dt)
        led = command._replace(surge=surge, sway=0.0, heave=0.0, depth=None)
        x, _, _, k, m, n = super().update(led, navigation, dt, residual)
        return x, 0.0, 0.0, k, m, n

    def _surge(self, command: VelocityCommand) -> float:
        least = self._fins.least_speed
        moves = any((command.surge, command.heave, command.yaw_rate)) or command[4:] != (None, None)
        return least if moves and -least < command.surge < least else command.surge

    def _pitch_for(self, command: VelocityCommand, navigation: Navigation, dt: float) -> float:
        """Return the pitch (rad) at which forward motion gives the commanded rate of descent."""
        limit, climb, least = self._fins
        rate, hold = command.heave, self._gains.depth
        if command.depth is not None:
            p = min(hold.p, self._gains.pitch.p / DIVE_BY_PITCH)
            rate = clamp(p * (command.depth - navigation.depth), hold.limit)
        down = down_in_body(navigation.orientation)
        u, v, w = navigation.velocity
        speed = max(abs(u), least)
        drift = (down[1] * v + down[2] * w) / speed  # the path's slope down beyond that of the bow
        if abs(drift) < ABSURD and abs(u) > 0.5 * least:
            self._trim += min(1.0, climb * dt) * (clamp(drift, limit) - self._trim)
        steep = asin(clamp(rate / speed, 1.0)) - self._trim
        return clamp(copysign(1.0, u) * -steep, limit)


class FinAllocator:
    """Distribute moments over n fins.

    `matrix` has 6 rows (X Y Z K M N along FRD) and n columns: the wrench of 1 rad of each fin at 1 m/s, in N and N m.
    `limits` are the n largest deflections in rad. Below `least_speed` m/s deflections are those for that speed. If a
    fin would exceed its limit, all moments are scaled down. Raises ConfigError as `Allocator` does.
    """

    def __init__(self, matrix: Sequence[Sequence[float]], limits: Sequence[float], least_speed: float) -> None:
        self._allocator = Allocator(matrix, limits, limits, _AXIS_WEIGHTS)
        self._least = least_speed * least_speed

    def allocate(self, wrench: Wrench, speed: float) -> tuple[list[float], Wrench]:
        """Return the n deflections (rad) for the moments of `wrench` at `speed` m/s ahead, and the residual moments.

        The fins' side force and heave force are not part of the residual.
        """
        pressure = copysign(max(speed * speed, self._least), speed)
        x, _, _, *moments = wrench
        coefficients = [moment / pressure for moment in moments]
        angles, residual = self._allocator.allocate((0.0, 0.0, 0.0, *coefficients))
        left = [
            pressure * b if abs(b) > _ROUNDING * abs(a) else 0.0
            for a, b in zip(coefficients, residual[3:], strict=True)
        ]
        return angles, (x, 0.0, 0.0, left[0], left[1], left[2])

"""Thrust allocation for azimuth thrusters: a servo turns each, so it pushes along two axes.

Each turning thruster counts as two, along its direction at rest and a quarter clockwise of it (the extended thrust
representation: Fossen 2021, section 11.2.3). The two forces give its angle and its thrust. Beyond the greatest angle it
pushes astern, or as much as it can of what is wanted at that angle. The servo's rate is not considered.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, sin

from hil.autonomy.control.allocation import Allocator, Wrench
from hil.autonomy.control.controller import clamp

_IDLE = 1e-3  # of the greatest thrust: below it the angle stays


class AzimuthAllocator:
    """Distribute a wrench over n thrusters, some of which turn.

    `matrix` and `sideways` have 6 rows (X Y Z K M N along FRD) and n columns: the wrench of 1 N of each at rest, and
    turned clockwise by a quarter. `angles` are the n greatest angles (rad), 0 for one that does not turn. Raises
    ConfigError as `Allocator` does.
    """

    def __init__(
        self,
        matrix: Sequence[Sequence[float]],
        sideways: Sequence[Sequence[float]],
        max_forward: Sequence[float],
        max_reverse: Sequence[float],
        angles: Sequence[float],
    ) -> None:
        self._turning = [i for i, angle in enumerate(angles) if angle]
        self._limits, self._forward, self._reverse = angles, max_forward, max_reverse
        rows = [[*row, *[side[i] for i in self._turning]] for row, side in zip(matrix, sideways, strict=True)]
        across = [max_forward[i] for i in self._turning]
        self._allocator = self._whole = Allocator(rows, [*max_forward, *across], [*max_reverse, *across])
        self._columns = list(zip(*rows, strict=True))
        self._angles = [0.0] * len(self._turning)

    def leave_out(self, failed: Sequence[bool]) -> None:
        """Use the `failed` ones of the n thrusters no more."""
        self._allocator = self._whole.without([*failed, *[failed[i] for i in self._turning]])

    def allocate(self, wrench: Wrench) -> tuple[list[float], list[float], Wrench]:
        """Return the n thrusts (N), the angles (rad) of those that turn, and the residual wrench."""
        forces, _ = self._allocator.allocate(wrench)
        count = len(self._limits)
        thrusts = forces[:count]
        for number, i in enumerate(self._turning):
            ahead, aside = forces[i], forces[count + number]
            if hypot(ahead, aside) > _IDLE * self._forward[i]:
                self._angles[number] = self._angle(ahead, aside, self._limits[i])
            angle = self._angles[number]
            thrust = max(-self._reverse[i], min(self._forward[i], ahead * cos(angle) + aside * sin(angle)))
            thrusts[i], forces[i], forces[count + number] = thrust, thrust * cos(angle), thrust * sin(angle)
        residual = list(wrench)
        for force, column in zip(forces, self._columns, strict=True):
            residual = [left - share * force for left, share in zip(residual, column, strict=True)]
        x, y, z, k, m, n = residual
        return thrusts, list(self._angles), (x, y, z, k, m, n)

    @staticmethod
    def _angle(ahead: float, aside: float, limit: float) -> float:
        """Return the angle for a force: ahead where that is within `limit`, else astern, else the nearer limit."""
        angle, astern = atan2(aside, ahead), atan2(-aside, -ahead)
        if abs(angle) <= limit:
            return angle
        return astern if abs(astern) <= limit else clamp(angle if abs(angle) < abs(astern) else astern, limit)

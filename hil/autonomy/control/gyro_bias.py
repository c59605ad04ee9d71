"""Estimate the bias of the gyros from the attitude, which does not drift; a bias would be a standing error of heading.

The heading loop turns the vehicle until the measured rate is 0, so with a bias b it stops at an error of b over its
gain. Over a long time the mean rate of the gyros must be the turn of the attitude; the difference, smoothed, is the
bias. It is no integral of the control error, so it cannot wind up.
"""

from collections.abc import Sequence
from math import copysign

from hil.autonomy.control.controller import clamp
from hil.common.vectors import Quaternion, Vector3

_SHORTEST_S, _LONGEST_S = 2.0, 20.0  # memory of the filter: it grows with the time since the start
_GAP_S = 0.5  # after a longer gap the turn between two attitudes is not compared
_MOST = 0.05  # rad/s; a greater difference is a fault of another kind


class GyroBias:
    """Filter of the bias of three gyros: `correct` is called with each sample."""

    def __init__(self) -> None:
        self.bias: Vector3 = (0.0, 0.0, 0.0)
        self._attitude: Quaternion | None = None
        self._rates: Sequence[float] = self.bias
        self._time_ns = 0
        self._elapsed = 0.0

    def correct(self, time_ns: int, attitude: Quaternion, rates: Vector3) -> Vector3:
        """Return `rates` (p, q, r in rad/s) less their bias, measured at `time_ns` with `attitude` (body to world)."""
        dt = (time_ns - self._time_ns) * 1e-9
        if self._attitude and 0.0 < dt < _GAP_S:
            self._elapsed += dt
            share = dt / min(max(self._elapsed, _SHORTEST_S), _LONGEST_S)
            (a, b, c, d), (w, x, y, z) = self._attitude, attitude
            turn = a * x - b * w - c * z + d * y, a * y + b * z - c * w - d * x, a * z - b * y + c * x - d * w
            scale = copysign(2.0, a * w + b * x + c * y + d * z) / dt  # of a small turn
            p, q, r = (
                clamp(bias + share * (0.5 * (now + before) - scale * angle - bias), _MOST)
                for bias, now, before, angle in zip(self.bias, rates, self._rates, turn, strict=True)
            )
            self.bias = p, q, r
        self._attitude, self._rates, self._time_ns = attitude, rates, time_ns
        p, q, r = (rate - bias for rate, bias in zip(rates, self.bias, strict=True))
        return p, q, r

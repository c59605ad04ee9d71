"""From pulse widths to thrust, and from the thrust of all thrusters to one wrench on the vehicle."""

from collections.abc import Sequence
from math import exp, sqrt

from hil.errors import ConfigError
from sim.matrices import Matrix
from sim.vehicle import Thruster, Vehicle

# A pulse outside is no pulse: the motor controller stops the motor. 0 stands for "output off".
PULSE_MIN_US, PULSE_MAX_US = 800, 2200


def steady_thrust(thruster: Thruster, pwm_us: int) -> float:
    """The thrust in N that a pulse of `pwm_us` microseconds settles at; negative is reverse.

    Beyond the dead band the deflection x runs from 0 to 1 at the end of the pulse range, and thrust is
    (k x + (1 - k) x²) of the maximum, k = `linear_share`. Pulses beyond the range count as its end;
    outside 800..2200 us there is no thrust.
    """
    if not PULSE_MIN_US <= pwm_us <= PULSE_MAX_US:
        return 0.0
    offset = pwm_us - thruster.pwm_neutral_us
    beyond = abs(offset) - thruster.dead_band_us
    if beyond <= 0.0:
        return 0.0
    span, limit, sign = _side(thruster, forward=offset > 0)
    x = min(1.0, beyond / span)
    share = thruster.linear_share
    return sign * limit * x * (share + (1.0 - share) * x)


def pwm_for(thruster: Thruster, thrust: float) -> int:
    """The pulse in microseconds whose steady thrust is nearest `thrust` N; neutral for 0, clamped to the range.

    Any other thrust gets a pulse at or beyond the edge of the dead band, so that none of the pulse range is
    spent where nothing moves.
    """
    if thrust == 0.0:
        return thruster.pwm_neutral_us
    span, limit, sign = _side(thruster, forward=thrust > 0.0)
    y = min(1.0, abs(thrust) / limit)
    share = thruster.linear_share
    x = 2.0 * y / (share + sqrt(share * share + 4.0 * (1.0 - share) * y))  # the root that stays exact for share 1
    return round(thruster.pwm_neutral_us + sign * (thruster.dead_band_us + x * span))


def _side(thruster: Thruster, forward: bool) -> tuple[float, float, float]:
    """Width of the driven pulse range in us, greatest thrust in N, and sign of one side."""
    if forward:
        return thruster.pwm_max_us - thruster.pwm_neutral_us - thruster.dead_band_us, thruster.max_forward, 1.0
    return thruster.pwm_neutral_us - thruster.pwm_min_us - thruster.dead_band_us, thruster.max_reverse, -1.0


def wrench_matrix(vehicle: Vehicle) -> Matrix:
    """The 6 x n matrix whose column i is the wrench of 1 N of thruster i.

    Rows: X Y Z (N) and K M N (N m) about the body origin along the body axes. Always from the poses.
    """
    columns = []
    for thruster in vehicle.thrusters:
        x, y, z = thruster.position
        a, b, c = thruster.unit_direction
        columns.append((a, b, c, y * c - z * b, z * a - x * c, x * b - y * a))
    return [list(row) for row in zip(*columns, strict=True)]


class ThrusterSet:
    """All thrusters of a vehicle: each follows its steady thrust with its time constant.

    The lag is first order in thrust and solved exactly for a pulse that holds during the step, so it does
    not depend on the step's length. `thrusts` holds the present thrust of each in N.
    """

    def __init__(self, vehicle: Vehicle, dt: float) -> None:
        self._thrusters = vehicle.thrusters
        self._columns = list(zip(*wrench_matrix(vehicle), strict=True))
        self._gains = [1.0 - exp(-dt / t.time_constant) if t.time_constant else 1.0 for t in vehicle.thrusters]
        self._pwm_us: tuple[int, ...] = ()
        self._targets = [0.0] * len(self._thrusters)
        self.thrusts = [0.0] * len(self._thrusters)

    def step(self, pwm_us: Sequence[int]) -> tuple[float, float, float, float, float, float]:
        """One step of `dt` with these pulses (us, one a thruster): the wrench X Y Z (N) K M N (N m) at its end.

        Raises ConfigError if there is not one pulse a thruster.
        """
        pulses = tuple(pwm_us)
        if pulses != self._pwm_us:
            self._command(pulses)
        rows = zip(self.thrusts, self._targets, self._gains, strict=True)
        self.thrusts = [thrust + gain * (target - thrust) for thrust, target, gain in rows]
        x = y = z = k = m = n = 0.0
        for thrust, (cx, cy, cz, ck, cm, cn) in zip(self.thrusts, self._columns, strict=True):
            x += cx * thrust
            y += cy * thrust
            z += cz * thrust
            k += ck * thrust
            m += cm * thrust
            n += cn * thrust
        return x, y, z, k, m, n

    def _command(self, pwm_us: tuple[int, ...]) -> None:
        if len(pwm_us) != len(self._thrusters):
            raise ConfigError(
                f"{len(pwm_us)} pulses for a vehicle of {len(self._thrusters)} thrusters: give one a thruster"
            )
        self._targets = [
            steady_thrust(thruster, pulse) for thruster, pulse in zip(self._thrusters, pwm_us, strict=True)
        ]
        self._pwm_us = pwm_us

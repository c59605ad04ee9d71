"""Compute the energy that a run takes from the battery.

With a battery and a battery monitor the energy follows from measured voltage and current. Otherwise it is computed from
the pulse widths of the thrusters, without electronics:

- A thruster with known current (the T200's table) takes that current times its supply voltage.
- Other thrusters are assumed to take the power of a T200 at 16 V at the same thrust. Above the T200's greatest thrust,
  power is proportional to thrust to the power 3/2, as for an ideal propeller (momentum theory).
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from sim.interpolation import interpolate
from sim.vehicle.thrusters.bank import steady_thrust
from sim.vehicle.thrusters.curves import T200
from sim.vehicle.thrusters.model import Thruster
from sim.vehicle.thrusters.t200 import performance
from sim.vehicle.vehicle import Vehicle

REFERENCE_V = 16.0
_LONGEST_STEP_S = 2.0  # a longer gap between two calls of `add` counts as this long: reports were missing


class EnergyMeter:
    """Integrator of the energy of one vehicle; `joules`: the sum so far."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._thrusters = vehicle.thrusters
        self._last: float | None = None
        self.joules = 0.0

    def add(self, time: float, pwm_us: Sequence[int], battery: Any = None) -> None:
        """Add the energy since the last call (`time` in s), from pulse widths (us) or a BatterySample."""
        step = 0.0 if self._last is None else min(time - self._last, _LONGEST_STEP_S)
        self._last = time
        watts = battery.voltage * battery.current if battery else power(self._thrusters, pwm_us)
        self.joules += watts * step


def power(thrusters: Sequence[Thruster], pwm_us: Sequence[int]) -> float:
    """Return the power (W) of these thrusters at these pulse widths (us); further channels are not counted."""
    return sum(_power(thruster, pulse) for thruster, pulse in zip(thrusters, pwm_us, strict=False))


@lru_cache(maxsize=4096)
def _power(thruster: Thruster, pulse: int) -> float:
    if isinstance(thruster.curve, T200):
        return performance(pulse, thruster.curve.supply).power
    return power_of_thrust(steady_thrust(thruster, pulse))


def power_of_thrust(thrust: float) -> float:
    """Return the power (W) of a T200 at 16 V for a thrust (N; negative in reverse)."""
    thrusts, watts = _table(thrust < 0.0)
    size = abs(thrust)
    if size > thrusts[-1]:
        return float(watts[-1] * (size / thrusts[-1]) ** 1.5)
    return interpolate(thrusts, watts, size)


@lru_cache(maxsize=2)
def _table(reverse: bool) -> tuple[list[float], list[float]]:
    """Return increasing thrusts (N) and their powers (W)."""
    thrusts, watts = [0.0], [0.0]
    for offset in range(5, 405, 5):
        point = performance(1500 - offset if reverse else 1500 + offset, REFERENCE_V)
        if abs(point.thrust) > thrusts[-1]:
            thrusts.append(abs(point.thrust))
            watts.append(point.power)
    return thrusts, watts

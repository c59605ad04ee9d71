"""Compute the energy that a run takes from the battery.

From the battery's own voltage and current where the vehicle has a battery and a monitor of it. Else from the pulses at
the thrusters: a thruster whose current is known (the T200's table) takes that times its supply; any other one is
assumed to take what a T200 at 16 V takes for the same thrust, and beyond the T200's reach in proportion to the
thrust to the power 3/2, as an ideal propeller does (momentum theory). Electronics are not counted in that case.
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
_LONGEST_STEP_S = 2.0  # a longer gap is a pause in the report, not in the flight


class EnergyMeter:
    """Adds up the energy of one vehicle. `joules` so far."""

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
    """Return what these thrusters take in W at these pulses; channels behind them are none of theirs."""
    return sum(_power(thruster, pulse) for thruster, pulse in zip(thrusters, pwm_us, strict=False))


@lru_cache(maxsize=4096)
def _power(thruster: Thruster, pulse: int) -> float:
    if isinstance(thruster.curve, T200):
        return performance(pulse, thruster.curve.supply).power
    return power_of_thrust(steady_thrust(thruster, pulse))


def power_of_thrust(thrust: float) -> float:
    """Return what a T200 at 16 V takes in W for a thrust in N, negative in reverse."""
    thrusts, watts = _table(thrust < 0.0)
    size = abs(thrust)
    if size > thrusts[-1]:
        return float(watts[-1] * (size / thrusts[-1]) ** 1.5)
    return interpolate(thrusts, watts, size)


@lru_cache(maxsize=2)
def _table(reverse: bool) -> tuple[list[float], list[float]]:
    """Return growing thrusts (N) and what they take (W)."""
    thrusts, watts = [0.0], [0.0]
    for offset in range(5, 405, 5):
        point = performance(1500 - offset if reverse else 1500 + offset, REFERENCE_V)
        if abs(point.thrust) > thrusts[-1]:
            thrusts.append(abs(point.thrust))
            watts.append(point.power)
    return thrusts, watts

"""Curves from pulse to steady thrust besides the built-in one, selected by `curve = { kind = ... }`.

Each is a record with `thrust(thruster, pwm_us)` and its inverse `pulse(thruster, thrust)`. The caller handles pulses
outside 800..2200 us and limits the thrust.
"""

from math import copysign, pi, sqrt
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.common.schema import Range, parse_kind
from sim.interpolation import interpolate, nearest_pulse
from sim.vehicle.thrusters.model import Pulse, Thruster

if TYPE_CHECKING:
    from sim.vehicle.thrusters.t200 import Rows


class Table(NamedTuple):
    """A table of measured thrusts with linear interpolation, constant before its first and after its last pulse.

    `pwm_us` is strictly increasing; `thrust_n` (N) never decreases and goes from reverse to forward.
    """

    pwm_us: tuple[Pulse, ...]
    thrust_n: tuple[Annotated[float, Range(-1e5, 1e5, "N")], ...]

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if len(self.pwm_us) != len(self.thrust_n) or len(self.pwm_us) < 2:
            return f"{len(self.pwm_us)} pwm_us and {len(self.thrust_n)} thrust_n: give as many of each, at least two"
        if any(b <= a for a, b in zip(self.pwm_us, self.pwm_us[1:], strict=False)):
            return "pwm_us: each must be greater than the one before"
        if any(b < a for a, b in zip(self.thrust_n, self.thrust_n[1:], strict=False)):
            return "thrust_n: each must be at least the one before, or one thrust would have two pulses"
        if not self.thrust_n[0] < 0.0 < self.thrust_n[-1]:
            return "thrust_n: begins with full reverse, below 0, and ends with full forward, above 0"
        return None

    def thrust(self, thruster: Thruster, pwm_us: int) -> float:
        """Return the steady thrust in N."""
        return interpolate(self.pwm_us, self.thrust_n, pwm_us)

    def pulse(self, thruster: Thruster, thrust: float) -> int:
        """Return the pulse in us nearest a thrust in N."""
        return nearest_pulse(self.pwm_us, self.thrust_n, thrust)


class Advance(NamedTuple):
    """A propeller whose thrust falls with the speed of the water through it (Fossen 2021, section 9.1).

    T = rho D^4 n|n| KT, KT = kt0 - alpha J, J = (1 - wake_fraction) v / (n D). n (rev/s) is proportional to the
    deflection, with `full_speed` at the end of the pulse range. v (m/s) is the vehicle's speed through the water at the
    thruster, along its direction; D is `diameter` (m), rho `density` (kg/m³). `kt0_reverse` is KT at J = 0 in reverse,
    `kt0` if it is 0. The loss by v is proportional to |n|, so it is subtracted after the lag.
    """

    diameter: Annotated[float, Range(0.01, 5.0, "m")]
    full_speed: Annotated[float, Range(0.1, 500.0, "Hz")]
    kt0: Annotated[float, Range(0.001, 2.0)]
    alpha: Annotated[float, Range(0.0, 5.0)]
    kt0_reverse: Annotated[float, Range(0.0, 2.0)] = 0.0
    wake_fraction: Annotated[float, Range(0.0, 0.9)] = 0.0
    density: Annotated[float, Range(900.0, 1200.0, "kg/m³")] = 1025.0

    def thrust(self, thruster: Thruster, pwm_us: int) -> float:
        """Return the steady thrust in N in water at rest."""
        x = thruster.deflection(pwm_us)
        return self.full_thrust(reverse=x < 0.0) * x * abs(x)

    def pulse(self, thruster: Thruster, thrust: float) -> int:
        """Return the pulse in us nearest a thrust in N in water at rest."""
        x = sqrt(abs(thrust) / self.full_thrust(reverse=thrust < 0.0))
        return thruster.pulse_at(x if thrust > 0.0 else -x)

    def full_thrust(self, reverse: bool) -> float:
        """Return the magnitude of the thrust in N at `full_speed` in water at rest."""
        kt = self.kt0_reverse if reverse and self.kt0_reverse else self.kt0
        return self.density * self.diameter**4 * kt * self.full_speed**2

    def loss(self, static_thrust: float, speed: float) -> float:
        """Return how much thrust (N) is lost at `speed` (m/s) by a propeller with `static_thrust` (N) at rest."""
        n = self.full_speed * sqrt(abs(static_thrust) / self.full_thrust(reverse=static_thrust < 0.0))
        return self.density * self.diameter**3 * self.alpha * n * (1.0 - self.wake_fraction) * speed

    def numbers(self) -> list[float]:
        """Return all numbers that `loss` uses, as one flat list, for the C twin."""
        loss, inflow_share = self.density * self.diameter**3 * self.alpha, 1.0 - self.wake_fraction
        return [self.full_speed, self.full_thrust(reverse=False), self.full_thrust(reverse=True), loss, inflow_share]


class T200(NamedTuple):
    """The Blue Robotics T200 by its manufacturer's table for 10 to 20 V (sim/vehicle/thrusters/t200.py).

    `supply` is the voltage at the thruster if the vehicle has no battery; the vehicle's controller always assumes it.
    Pulses are those of the table; `dead_band_us` and the other pulse keys are ignored.
    """

    supply: Annotated[float, Range(6.0, 20.0, "V")] = 16.0

    def thrust(self, thruster: Thruster, pwm_us: int) -> float:
        """Return the steady thrust in N."""
        from sim.vehicle.thrusters.t200 import performance

        return performance(pwm_us, self.supply).thrust

    def pulse(self, thruster: Thruster, thrust: float) -> int:
        """Return the pulse in us nearest a thrust in N."""
        from sim.vehicle.thrusters.t200 import pulse_for

        return pulse_for(thrust, self.supply)

    def motor(self, pwm_us: int, volts: float) -> tuple[float, float]:
        """Return speed (rad/s, with the sign of the thrust) and current (A) at this pulse and voltage."""
        from sim.vehicle.thrusters.t200 import performance

        point = performance(pwm_us, volts)
        return copysign(point.rpm * 2.0 * pi / 60.0, point.thrust), point.current

    def rows(self, pwm_us: int) -> "Rows":
        """Return thrust and current at this pulse over the voltages of the table."""
        from sim.vehicle.thrusters.t200 import rows

        return rows(pwm_us)


CURVES = {"table": Table, "advance": Advance, "t200": T200}


def read_curve(table: Any, where: str) -> Any:
    """Return the record of a thruster's table `curve`. Raises ConfigError."""
    return parse_kind(table, CURVES, where)

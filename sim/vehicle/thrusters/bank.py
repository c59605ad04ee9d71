"""The thrusters of a vehicle: from pulse widths to thrusts, and from thrusts to one wrench on the vehicle."""

from collections.abc import Callable, Iterable, Sequence
from math import exp, nan, sqrt
from typing import TYPE_CHECKING, Any

from hil.common.errors import ConfigError
from sim.matrices import Matrix
from sim.vehicle.thrusters.model import Thruster, check_pulses, is_pulse
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.vehicle.battery import BatteryState
    from sim.vehicle.failures import Failure, Failures

AT_REST = (0.0,) * 6


def steady_thrust(thruster: Thruster, pwm_us: int) -> float:
    """Return the steady thrust in N at a pulse of `pwm_us` microseconds; negative is reverse.

    For a thruster without a `curve`: the deflection x is 0 at the edge of the dead band and 1 at the end of the pulse
    range, and thrust is (k x + (1 - k) x²) of the maximum, k = `linear_share`. Pulses beyond the range count as its
    end; outside 800..2200 us there is no thrust.
    """
    if not is_pulse(pwm_us):
        return 0.0
    if thruster.curve is not None:
        return thruster.clamp(thruster.curve.thrust(thruster, pwm_us))
    x = thruster.deflection(pwm_us)
    share = thruster.linear_share
    return (thruster.max_forward if x > 0.0 else thruster.max_reverse) * x * (share + (1.0 - share) * abs(x))


def pulse_finder(thruster: Thruster) -> Callable[[float], int]:
    """Return a function that returns the pulse (us) whose steady thrust is nearest to a thrust (N).

    The pulse is neutral for 0 N and clamped to the range. Any other thrust gets a pulse at or beyond the edge of the
    dead band, where the thruster turns. Constants are computed here, once.
    """
    neutral, curve = thruster.pwm_neutral_us, thruster.curve
    if curve is not None:
        return lambda thrust: curve.pulse(thruster, thruster.clamp(thrust)) if thrust else neutral
    share = thruster.linear_share
    squared, bend = share * share, 4.0 * (1.0 - share)
    ahead = thruster.max_forward, thruster.span(1.0), thruster.dead_band_us
    astern = -thruster.max_reverse, -thruster.span(-1.0), -thruster.dead_band_us

    def find(thrust: float) -> int:
        limit, span, dead_band = ahead if thrust > 0.0 else astern
        y = thrust / limit
        if y == 0.0:  # also for a thrust so small that the quotient underflows
            return neutral
        if not y < 1.0:
            y = 1.0
        x = 2.0 * y / (share + sqrt(squared + bend * y))  # the root that stays exact for share 1
        return round(neutral + (x * span + dead_band))

    return find


def wrench_matrix(vehicle: Vehicle, torque: bool = True) -> Matrix:
    """Return the 6 x n matrix whose column i is the wrench of 1 N of thruster i, with or without propeller torque.

    Rows: X Y Z (N) and K M N (N m) about the body origin along the body axes. Without torque, the transposed matrix
    converts the velocity of the vehicle to the speed along each thruster.
    """
    columns = []
    for thruster in vehicle.thrusters:
        x, y, z = thruster.position
        a, b, c = thruster.unit_direction
        t = thruster.torque if torque else 0.0
        columns.append((a, b, c, y * c - z * b + t * a, z * a - x * c + t * b, x * b - y * a + t * c))
    return [list(row) for row in zip(*columns, strict=True)]


class SteadyThrusts(dict[int, float]):
    """The steady thrust (N) of one thruster by pulse (us), computed once for each pulse."""

    def __init__(self, thruster: Thruster) -> None:
        self._thruster = thruster

    def __missing__(self, pwm_us: int) -> float:
        thrust = self[pwm_us] = steady_thrust(self._thruster, pwm_us)
        return thrust


class ThrusterSet:
    """All thrusters of a vehicle: each follows its steady thrust with its time constant, and may fail.

    The lag is of first order in thrust and solved exactly for a pulse that is constant during the step, so it does not
    depend on the step's length. `sim.assembly.make_thrusters` returns the thrusters with the models of a vehicle.
    The thrust at the end of a step acts during the whole step, so it comes half a step early: a vehicle that starts
    from rest is ahead by its speed times dt / 2, 1.2 mm at 1 m/s with steps of 2.5 ms.
    """

    def __init__(self, vehicle: Vehicle, dt: float, seed: int = 0) -> None:
        self._thrusters = vehicle.thrusters
        self._wrench_columns = list(zip(*wrench_matrix(vehicle), strict=True))
        # A speed column converts a velocity of the vehicle to the speed along its thruster.
        self._speed_columns = list(zip(*wrench_matrix(vehicle, torque=False), strict=True))
        # Curves of propellers that lose thrust with the speed of their inflow (Advance in thrusters/curves.py).
        self._advances: list[Any] = [t.curve if hasattr(t.curve, "loss") else None for t in vehicle.thrusters]
        # True if `step` needs the speed through the water.
        self.needs_inflow = any(self._advances)
        self._dt = dt
        self._seed = seed
        self._gains = [1.0 - exp(-dt / t.time_constant) if t.time_constant else 1.0 for t in vehicle.thrusters]
        self._steady = [SteadyThrusts(thruster) for thruster in vehicle.thrusters]
        self._pwm_us: tuple[int, ...] = ()
        self._targets = [0.0] * len(self._thrusters)
        self._lagged = self._thrusts = [0.0] * len(self._thrusters)
        self._failures: Failures | None = None
        self._shares: Sequence[float] | None = None  # of the thrust that remain near the surface
        self._steps = 0

    @property
    def thrusts(self) -> list[float]:
        """The present thrust of each in N."""
        return self._thrusts

    @property
    def reports(self) -> list[float]:
        """The thrust (N) that speed and current of each motor stand for, deep in water at rest; nan without telemetry.

        It includes failures: of a motor that stands still, and of a propeller that is lost.
        """
        factors = self._failures.factors if self._failures else [1.0] * len(self._thrusters)
        rows = zip(self._static_thrusts, factors, self._thrusters, strict=True)
        return [thrust * factor if thruster.telemetry else nan for thrust, factor, thruster in rows]

    @property
    def _static_thrusts(self) -> list[float]:
        return self._lagged

    @property
    def battery(self) -> "BatteryState | None":
        """The battery's state; None if there is none."""
        return None

    def motors(self, pwm_us: Sequence[int]) -> list[tuple[float, float]]:
        """Return speed (rad/s, with the sign of the thrust) and current (A) of each at these pulses (us).

        Both are nan if the thruster's model does not include them. Those of a T200 are the steady values at its pulse
        and the voltage of its supply; a failure changes the pulse.
        """
        pulses = self._pwm_us if self._failures is not None and self._pwm_us else pwm_us
        curves: list[Any] = [thruster.curve for thruster in self._thrusters]
        return [
            curve.motor(pulse, self._supply(curve)) if hasattr(curve, "motor") else (nan, nan)
            for curve, pulse in zip(curves, pulses, strict=False)
        ]

    def _supply(self, curve: Any) -> float:
        """Return the supply voltage (V) of a thruster whose `curve` depends on it."""
        return float(curve.supply)

    def fail(self, failures: "Iterable[Failure]") -> None:
        """Plan these failures, by their time since the first step. Raises ConfigError for an unknown thruster."""
        if self._failures is None:
            from sim.vehicle.failures import Failures

            names = [thruster.name for thruster in self._thrusters]
            self._failures = Failures(names, self._dt, self._seed, self._steps, self._pwm_us)
        self._failures.add(failures)

    def scale_thrusts(self, shares: Sequence[float] | None) -> None:
        """Set the share of its thrust that each thruster makes from now on, as near the surface; None: all of it."""
        self._shares = shares

    def failures(self, name: str) -> "tuple[Failure, ...]":
        """Return the present faults of the thruster `name`."""
        return self._failures.present(name) if self._failures else ()

    def step(
        self, pwm_us: Sequence[int], nu_r: Sequence[float] = AT_REST
    ) -> tuple[float, float, float, float, float, float]:
        """Advance by one step under these pulses (us, one a thruster); return the wrench X Y Z (N) K M N (N m).

        `nu_r` is the velocity through the water u v w (m/s) p q r (rad/s) along the body axes; it is used only if
        `needs_inflow`. Raises ConfigError if there is not one pulse a thruster.
        """
        pulses = tuple(pwm_us)
        self._steps += 1
        failures = self._failures
        if failures is not None:
            pulses = failures.pulses(pulses)
        if pulses != self._pwm_us or not pulses:
            self.command(pulses)
        return self._advance(nu_r)

    def _advance(self, nu_r: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        """Advance all thrusts by one step towards their targets; return the wrench at its end."""
        self._lagged = self._thrusts = self._step_lags()
        if self.needs_inflow:
            self._thrusts = self._subtract_losses(nu_r)
        if self._failures is not None:
            self._thrusts = self._failures.thrusts(self._thrusts)
        if self._shares is not None:
            self._thrusts = [thrust * share for thrust, share in zip(self._thrusts, self._shares, strict=True)]
        x = y = z = k = m = n = 0.0
        for thrust, (cx, cy, cz, ck, cm, cn) in zip(self._thrusts, self._wrench_columns, strict=True):
            x += cx * thrust
            y += cy * thrust
            z += cz * thrust
            k += ck * thrust
            m += cm * thrust
            n += cn * thrust
        return x, y, z, k, m, n

    def numbers(self) -> list[float]:
        """Return all constants of a step without failures, as one flat list, for the C twin."""
        rows = zip(self._gains, self._wrench_columns, self._speed_columns, self._advances, strict=True)
        no_loss = [0.0] * 5
        lists = [
            (gain, *wrench_column, *speed_column, *(curve.numbers() if curve else no_loss))
            for gain, wrench_column, speed_column, curve in rows
        ]
        return [x for numbers in lists for x in numbers]

    def _step_lags(self) -> list[float]:
        """Return the thrusts (N) at the end of the step in water at rest, before failures."""
        rows = zip(self._lagged, self._targets, self._gains, strict=True)
        return [thrust + gain * (target - thrust) for thrust, target, gain in rows]

    def _subtract_losses(self, nu_r: Sequence[float]) -> list[float]:
        """Return the thrusts (N) that remain at the velocity `nu_r` (m/s, rad/s) through the water."""
        u, v, w, p, q, r = nu_r
        thrusts = list(self._lagged)
        for i, (curve, (a, b, c, d, e, f)) in enumerate(zip(self._advances, self._speed_columns, strict=True)):
            if curve is not None:
                thrusts[i] -= curve.loss(thrusts[i], a * u + b * v + c * w + d * p + e * q + f * r)
        return thrusts

    def command(self, pwm_us: tuple[int, ...]) -> None:
        """Set the target thrusts of all following steps by these pulses (us, one a thruster). Raises ConfigError."""
        if len(pwm_us) != len(self._thrusters):
            raise ConfigError(
                f"{len(pwm_us)} pulses for a vehicle of {len(self._thrusters)} thrusters: give one a thruster"
            )
        check_pulses(pwm_us)
        self._targets = [steady[pulse] for steady, pulse in zip(self._steady, pwm_us, strict=True)]
        self._pwm_us = pwm_us

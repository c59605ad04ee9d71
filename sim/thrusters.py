"""From pulse widths to thrust, and from the thrust of all thrusters to one wrench on the vehicle."""

from collections.abc import Callable, Iterable, Sequence
from math import exp, sqrt
from typing import TYPE_CHECKING

from hil.errors import ConfigError
from sim.matrices import Matrix
from sim.thruster_model import Thruster
from sim.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.battery import BatteryState
    from sim.failures import Failure, Failures

# A pulse outside is no pulse: the motor controller stops the motor. 0 stands for "output off".
PULSE_MIN_US, PULSE_MAX_US = 800, 2200

AT_REST = (0.0,) * 6


def steady_thrust(thruster: Thruster, pwm_us: int) -> float:
    """The thrust in N that a pulse of `pwm_us` microseconds settles at; negative is reverse.

    Without a curve of its own: beyond the dead band the deflection x runs from 0 to 1 at the end of the pulse
    range, and thrust is (k x + (1 - k) x²) of the maximum, k = `linear_share`. Pulses beyond the range count as
    its end; outside 800..2200 us there is no thrust.
    """
    if not PULSE_MIN_US <= pwm_us <= PULSE_MAX_US:
        return 0.0
    if thruster.curve is not None:
        return thruster.clamp(thruster.curve.thrust(thruster, pwm_us))
    x = thruster.deflection(pwm_us)
    share = thruster.linear_share
    return (thruster.max_forward if x > 0.0 else thruster.max_reverse) * x * (share + (1.0 - share) * abs(x))


def pwm_for(thruster: Thruster, thrust: float) -> int:
    """The pulse in microseconds whose steady thrust is nearest `thrust` N; neutral for 0, clamped to the range.

    Any other thrust gets a pulse at or beyond the edge of the dead band, so that none of the pulse range is
    spent where nothing moves.
    """
    return pulse_finder(thruster)(thrust)


def pulse_finder(thruster: Thruster) -> Callable[[float], int]:
    """`pwm_for` of one thruster, for many thrusts: what does not change is reckoned here, once."""
    neutral, curve = thruster.pwm_neutral_us, thruster.curve
    if curve is not None:
        return lambda thrust: curve.pulse(thruster, thruster.clamp(thrust)) if thrust else neutral
    _, share, squared, bend, *sides = curve_numbers(thruster)
    ahead, astern = sides[:3], sides[3:]

    def find(thrust: float) -> int:
        most, span, dead_band = ahead if thrust > 0.0 else astern
        y = thrust / most
        if y == 0.0:  # as well for a thrust too small to be divided
            return neutral
        if not y < 1.0:
            y = 1.0
        x = 2.0 * y / (share + sqrt(squared + bend * y))  # the root that stays exact for share 1
        return round(neutral + (x * span + dead_band))

    return find


def curve_numbers(thruster: Thruster) -> list[float]:
    """All that `pulse_finder` uses of a thruster without a curve of its own, in a row: what the C twin is made of."""
    share = thruster.linear_share
    ahead = thruster.max_forward, thruster.span(1.0), thruster.dead_band_us
    astern = -thruster.max_reverse, -thruster.span(-1.0), -thruster.dead_band_us
    return [thruster.pwm_neutral_us, share, share * share, 4.0 * (1.0 - share), *ahead, *astern]


def wrench_matrix(vehicle: Vehicle, torque: bool = True) -> Matrix:
    """The 6 x n matrix whose column i is the wrench of 1 N of thruster i, with or without its propeller's torque.

    Rows: X Y Z (N) and K M N (N m) about the body origin along the body axes. Always from the poses. Without torque
    it also turns velocities of the vehicle into speeds along the thrusters: its columns are what a thruster sees.
    """
    columns = []
    for thruster in vehicle.thrusters:
        x, y, z = thruster.position
        a, b, c = thruster.unit_direction
        t = thruster.torque if torque else 0.0
        columns.append((a, b, c, y * c - z * b + t * a, z * a - x * c + t * b, x * b - y * a + t * c))
    return [list(row) for row in zip(*columns, strict=True)]


class _Steady(dict[int, float]):
    """The steady thrust (N) of one thruster by pulse (us), reckoned once for each."""

    def __init__(self, thruster: Thruster) -> None:
        self._thruster = thruster

    def __missing__(self, pwm_us: int) -> float:
        thrust = self[pwm_us] = steady_thrust(self._thruster, pwm_us)
        return thrust


class ThrusterSet:
    """All thrusters of a vehicle: each follows its steady thrust with its time constant, and may fail.

    The lag is first order in thrust and solved exactly for a pulse that holds during the step, so it does
    not depend on the step's length. `make_thrusters` gives one that knows the models of the vehicle.
    """

    feels_water = False  # True if `step` needs the speed through the water

    def __init__(self, vehicle: Vehicle, dt: float, seed: int = 0) -> None:
        self._thrusters = vehicle.thrusters
        self._columns = list(zip(*wrench_matrix(vehicle), strict=True))
        self._dt = dt
        self._seed = seed
        self._gains = [1.0 - exp(-dt / t.time_constant) if t.time_constant else 1.0 for t in vehicle.thrusters]
        self._steady = [_Steady(thruster) for thruster in vehicle.thrusters]
        self._pwm_us: tuple[int, ...] = ()
        self._targets = [0.0] * len(self._thrusters)
        self._lagged = self._thrusts = [0.0] * len(self._thrusters)
        self._failures: Failures | None = None
        self._steps = 0

    @property
    def thrusts(self) -> list[float]:
        """The present thrust of each in N."""
        return self._thrusts

    @property
    def battery(self) -> "BatteryState | None":
        """The battery's state; None if there is none."""
        return None

    def fail(self, failures: "Iterable[Failure]") -> None:
        """Plan these failures, by their time since the first step. Raises ConfigError for an unknown thruster."""
        if self._failures is None:
            from sim.failures import Failures

            names = [thruster.name for thruster in self._thrusters]
            self._failures = Failures(names, self._dt, self._seed, self._steps, self._pwm_us)
        self._failures.add(failures)

    def failures(self, name: str) -> "tuple[Failure, ...]":
        """What is wrong with the thruster `name` now."""
        return self._failures.of(name) if self._failures else ()

    def step(
        self, pwm_us: Sequence[int], nu_r: Sequence[float] = AT_REST
    ) -> tuple[float, float, float, float, float, float]:
        """One step of `dt` with these pulses (us, one a thruster): the wrench X Y Z (N) K M N (N m) at its end.

        `nu_r` is the velocity through the water u v w (m/s) p q r (rad/s) along the body axes; only a set that
        `feels_water` looks at it. Raises ConfigError if there is not one pulse a thruster.
        """
        pulses = tuple(pwm_us)
        self._steps += 1
        failures = self._failures
        if failures is not None:
            pulses = failures.pulses(pulses)
        if pulses != self._pwm_us:
            self._command(pulses)
        return self._advance(nu_r)

    def _advance(self, nu_r: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        """One step of all thrusts towards their targets; the wrench at its end."""
        self._lagged = self._thrusts = self._follow(nu_r)
        if self._failures is not None:
            self._thrusts = self._failures.thrusts(self._lagged)
        x = y = z = k = m = n = 0.0
        for thrust, (cx, cy, cz, ck, cm, cn) in zip(self._thrusts, self._columns, strict=True):
            x += cx * thrust
            y += cy * thrust
            z += cz * thrust
            k += ck * thrust
            m += cm * thrust
            n += cn * thrust
        return x, y, z, k, m, n

    def numbers(self) -> list[float]:
        """All that a step without failures uses but the state, in a row: what the C twin is made of."""
        return [x for gain, column in zip(self._gains, self._columns, strict=True) for x in (gain, *column)]

    def _follow(self, nu_r: Sequence[float]) -> list[float]:
        """The thrusts (N) at the end of the step, before failures."""
        rows = zip(self._lagged, self._targets, self._gains, strict=True)
        return [thrust + gain * (target - thrust) for thrust, target, gain in rows]

    def _command(self, pwm_us: tuple[int, ...]) -> None:
        if len(pwm_us) != len(self._thrusters):
            raise ConfigError(
                f"{len(pwm_us)} pulses for a vehicle of {len(self._thrusters)} thrusters: give one a thruster"
            )
        self._targets = [steady[pulse] for steady, pulse in zip(self._steady, pwm_us, strict=True)]
        self._pwm_us = pwm_us


def make_thrusters(vehicle: Vehicle, dt: float, failures: "Iterable[Failure]" = (), seed: int = 0) -> ThrusterSet:
    """The thrusters of `vehicle`, stepped every `dt` s, with these failures planned. Raises ConfigError.

    Models beyond a lagged quadratic curve are loaded only for a vehicle that has one.
    """
    from sim.native import make_thruster_set  # it builds on this module

    if vehicle.battery or any(t.curve or t.dynamics for t in vehicle.thrusters):
        from sim.propulsion import Propulsion

        thrusters: ThrusterSet = Propulsion(vehicle, dt, seed)
    else:
        thrusters = make_thruster_set(vehicle, dt, seed)
    planned = tuple(failures)
    if planned:
        thrusters.fail(planned)
    return thrusters

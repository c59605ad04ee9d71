"""The record of one thruster: position, direction, and the model from pulse to thrust."""

from collections.abc import Sequence
from math import hypot, inf, pi
from typing import Annotated, Any, NamedTuple, Protocol

from hil.common.errors import ConfigError
from hil.common.schema import Range

Metres = Annotated[float, Range(-50.0, 50.0, "m")]
Point = tuple[Metres, Metres, Metres]
Component = Annotated[float, Range(-1e6, 1e6)]
Direction = tuple[Component, Component, Component]  # of any length from SHORTEST on
SHORTEST = 1e-6
Pulse = Annotated[int, Range(800, 2200, "us")]

# A pulse outside of this range is not valid: the motor controller stops the motor. 0 means "output off".
PULSE_MIN_US, PULSE_MAX_US = 800, 2200


def is_pulse(pwm_us: float) -> bool:
    """True if a motor controller or servo accepts this pulse as valid."""
    return PULSE_MIN_US <= pwm_us <= PULSE_MAX_US


def check_pulses(pwm_us: Sequence[float]) -> None:
    """Raise ConfigError for a pulse that is no finite number.

    Too short and too long pulses are allowed, because a disarmed autopilot sends them: they make no thrust.
    """
    for channel, pulse in enumerate(pwm_us):
        if not hasattr(pulse, "__float__") or not abs(pulse) < inf:
            raise ConfigError(f"pulse {channel} is {pulse!s:.40}: give microseconds, such as 1500")


class Curve(Protocol):
    """A curve from pulse to steady thrust (sim/vehicle/thrusters/curves.py)."""

    def thrust(self, thruster: "Thruster", pwm_us: int) -> float:
        """Return the steady thrust in N at a pulse of `pwm_us` microseconds in water at rest."""

    def pulse(self, thruster: "Thruster", thrust: float) -> int:
        """Return the pulse in microseconds whose steady thrust is nearest to `thrust` N (not 0)."""


def pulses_problem(keys: Any) -> str | None:
    """Return what is wrong with the pulses of a servo, whose keys are a Fin or an Azimuth, or None."""
    if not keys.pwm_min_us < keys.pwm_neutral_us < keys.pwm_max_us:
        return "pulses must grow from pwm_min_us over pwm_neutral_us to pwm_max_us"
    return None


class Azimuth(NamedTuple):
    """The servo of a thruster; a positive angle turns its direction clockwise seen from above.

    The angle is proportional to the pulse, with `max_deflection` at both ends of the pulse range. The servo follows
    with a first-order lag, no faster than `rate` (0: no limit). Without a valid pulse (800..2200 us) it stops.
    """

    max_deflection: Annotated[float, Range(0.01, pi, "rad")]
    time_constant: Annotated[float, Range(0.0, 10.0, "s")] = 0.1
    rate: Annotated[float, Range(0.0, 100.0, "rad/s")] = 1.0
    pwm_neutral_us: Pulse = 1500
    pwm_min_us: Pulse = 1100
    pwm_max_us: Pulse = 1900

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return pulses_problem(self)


class Thruster(NamedTuple):
    """One thruster.

    `direction` is that of positive thrust, of any length; `unit_direction` has length 1. Without a `curve` thrust grows
    from the edge of the dead band (`dead_band_us` on each side of neutral) to `max_forward` at `pwm_max_us` and
    `max_reverse` (both positive) at `pwm_min_us`: the share `linear_share` of it in proportion to the pulse, the rest
    with its square. Another `curve` is a table with a `kind` (sim/vehicle/thrusters/curves.py); `max_forward` and
    `max_reverse` limit it, too.

    Thrust follows the curve immediately if `time_constant` is 0, else with this first-order lag. The propeller turns
    the vehicle by `torque` N m for each N of thrust, right-handed about `direction`. How much thrust it loses near the
    surface depends on the `diameter` of its propeller (m; sim/vehicle/ventilation.py). If left out it is that of the
    curve, or one with the same thrust per area as a Blue Robotics T200: 51.5 N with 76 mm at 16 V. With `telemetry` its
    motor controller reports speed and current, by which the vehicle's controller notices a failure. `azimuth` is the
    servo that turns it about the vertical (sim/vehicle/thrusters/azimuth.py). Not modelled: torque that is not
    proportional to thrust.
    """

    name: str
    position: Point
    direction: Direction
    max_forward: Annotated[float, Range(1e-3, 1e5, "N")]
    max_reverse: Annotated[float, Range(1e-3, 1e5, "N")]
    dead_band_us: Annotated[float, Range(0.0, 300.0, "us")] = 0.0
    linear_share: Annotated[float, Range(0.0, 1.0)] = 0.0
    time_constant: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    pwm_neutral_us: Pulse = 1500
    pwm_min_us: Pulse = 1100
    pwm_max_us: Pulse = 1900
    curve: "Curve | None" = None
    torque: Annotated[float, Range(-10.0, 10.0, "m")] = 0.0
    diameter: Annotated[float, Range(0.005, 5.0, "m")] | None = None
    telemetry: bool = True
    azimuth: Azimuth | None = None

    @property
    def unit_direction(self) -> tuple[float, float, float]:
        """The direction of positive thrust with length 1."""
        x, y, z = self.direction
        length = (x * x + y * y + z * z) ** 0.5
        return x / length, y / length, z / length

    @property
    def propeller_diameter(self) -> float:
        """The diameter of its propeller in m: given, that of its curve, or estimated from its thrust."""
        known = self.diameter or getattr(self.curve, "diameter", None)
        return known or 0.076 * (max(self.max_forward, self.max_reverse) / 51.5) ** 0.5

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if hypot(*self.direction) < SHORTEST:
            length = "zero" if not any(self.direction) else f"shorter than {SHORTEST:g}: make its length 1"
            return f"thruster {self.name!r}: direction is {length}"
        low, high = self.pwm_min_us + self.dead_band_us, self.pwm_max_us - self.dead_band_us
        if not low < self.pwm_neutral_us < high:
            return f"thruster {self.name!r}: neutral and dead band leave no pulse to drive it both ways"
        return None

    def deflection(self, pwm_us: float) -> float:
        """Return the command of a pulse, clamped to -1 to 1: 0 in the dead band, -1 and 1 at the ends of the range."""
        offset = pwm_us - self.pwm_neutral_us
        beyond = abs(offset) - self.dead_band_us
        if beyond <= 0.0:
            return 0.0
        return min(1.0, beyond / self.span(offset)) if offset > 0 else -min(1.0, beyond / self.span(offset))

    def pulse_at(self, deflection: float) -> int:
        """Return the pulse (us) of a deflection, which is clamped to -1 to 1; neutral for 0."""
        if deflection == 0.0:
            return self.pwm_neutral_us
        neutral, dead_band = self.pwm_neutral_us, self.dead_band_us
        if deflection > 0.0:
            return round(neutral + (min(1.0, deflection) * (self.pwm_max_us - neutral - dead_band) + dead_band))
        return round(neutral + (max(-1.0, deflection) * (neutral - self.pwm_min_us - dead_band) - dead_band))

    def clamp(self, thrust: float) -> float:
        """Return `thrust` (N) within the limits of the thruster."""
        return max(-self.max_reverse, min(self.max_forward, thrust))

    def span(self, side: float) -> float:
        """Return the microseconds from the dead band to the end of the pulse range, ahead or (`side` < 0) astern."""
        end = self.pwm_max_us - self.pwm_neutral_us if side > 0 else self.pwm_neutral_us - self.pwm_min_us
        return end - self.dead_band_us

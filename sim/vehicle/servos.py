"""Actuators with a lag and a limited rate: servos of fins and azimuth thrusters, the pump of a buoyancy engine."""

from collections.abc import Sequence
from math import exp, inf
from typing import Any

from sim.vehicle.thrusters.model import is_pulse


def deflection(keys: Any, pwm_us: float) -> float:
    """Return the angle (rad) that a pulse commands; `keys` are a Fin or an Azimuth."""
    offset: float = pwm_us - keys.pwm_neutral_us
    end = keys.pwm_max_us - keys.pwm_neutral_us if offset > 0 else keys.pwm_neutral_us - keys.pwm_min_us
    return float(keys.max_deflection * max(-1.0, min(1.0, offset / end)))


def pulse(keys: Any, angle: float) -> int:
    """Return the pulse (us) that commands `angle` rad, or the nearest possible angle."""
    share = max(-1.0, min(1.0, angle / keys.max_deflection)) if keys.max_deflection else 0.0
    end = keys.pwm_max_us - keys.pwm_neutral_us if share > 0 else keys.pwm_neutral_us - keys.pwm_min_us
    return round(float(keys.pwm_neutral_us + share * end))


class Servos:
    """Several servos that start at `values`, in any unit.

    In a step each moves by its gain times its distance from the target, limited to its entry in `limits`.
    """

    def __init__(self, values: Sequence[float], gains: Sequence[float], limits: Sequence[float]) -> None:
        self.values = [float(value) for value in values]
        self._targets = list(self.values)
        self._gains = list(gains)
        self._limits = list(limits)

    def set_targets(self, targets: Sequence[float]) -> None:
        """Set the targets of all following steps."""
        self._targets = list(targets)

    def step(self) -> None:
        """Move all servos by one step."""
        rows = zip(self.values, self._targets, self._gains, self._limits, strict=True)
        self.values = [value + max(-limit, min(limit, gain * (target - value))) for value, target, gain, limit in rows]

    def numbers(self) -> list[float]:
        """Return all numbers that `step` uses, servo after servo, as one flat list, for the C twin."""
        rows = zip(self.values, self._targets, self._gains, self._limits, strict=True)
        return [x for row in rows for x in row]


class ServoSet:
    """Servos that pulses command; they start at 0 rad and step every `dt` s. `servos` holds them, in C as in Python."""

    def __init__(self, keys: Sequence[Any], dt: float) -> None:
        self._keys = tuple(keys)
        gains = [1.0 - exp(-dt / one.time_constant) if one.time_constant else 1.0 for one in keys]
        self.servos = Servos([0.0] * len(self._keys), gains, [one.rate * dt or inf for one in keys])
        self._pwm_us: tuple[int, ...] | None = None

    @property
    def angles(self) -> list[float]:
        """The present angles in rad."""
        return self.servos.values

    def step(self, pwm_us: Sequence[int]) -> None:
        """Move the servos by one step under these pulses (us, one a servo)."""
        self.command(tuple(pwm_us))
        self.servos.step()

    def command(self, pwm_us: tuple[int, ...]) -> None:
        """Set the servos' targets by these pulses (us, one a servo); a servo without a valid pulse stops."""
        if pwm_us != self._pwm_us:
            rows = zip(self._keys, pwm_us, self.servos.values, strict=True)
            self.servos.set_targets([deflection(one, us) if is_pulse(us) else angle for one, us, angle in rows])
            self._pwm_us = pwm_us

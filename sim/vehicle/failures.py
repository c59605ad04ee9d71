"""Thruster failures at a set time or on command. The same failures and seed give the same numbers."""

from collections import deque
from collections.abc import Iterable, Sequence
from math import exp, sqrt
from random import Random
from typing import Annotated, Literal, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, nearest

NOISE_TIME_CONSTANT = 0.05  # s

Kind = Literal["off", "efficiency", "stuck", "delayed", "noisy", "repaired"]
# The key that holds the amount of each kind of failure that has one.
VALUES = {"efficiency": "efficiency", "stuck": "pwm_us", "delayed": "delay", "noisy": "noise"}


class Failure(NamedTuple):
    """Failure of the thruster named `thruster` at `time` s of simulated time.

    off: no output. efficiency: thrust times `efficiency`. stuck: runs at `pwm_us`, or, if that is 0, at its present
    pulse. delayed: pulses take effect `delay` later. noisy: thrust times 1 + noise of standard deviation `noise`, with
    a correlation time of 50 ms for any step. repaired: all failures of this thruster end. Failures of different kinds
    act together; a second one of a kind replaces the first. If several change the pulse, off has priority over stuck,
    and stuck over delayed.
    """

    thruster: str
    kind: Kind
    time: Annotated[float, Range(0.0, 1e7, "s")] = 0.0
    efficiency: Annotated[float, Range(0.0, 1.0)] = 1.0
    pwm_us: Annotated[int, Range(0, 2200, "us")] = 0
    delay: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    noise: Annotated[float, Range(0.0, 2.0)] = 0.0

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        for kind, key in VALUES.items():
            given = getattr(self, key) != self._field_defaults[key]
            if kind == self.kind and not given and kind != "stuck":
                return f"kind {kind!r} of {self.thruster!r} does nothing without {key}"
            if kind != self.kind and given:
                return f"{key} belongs to kind {kind!r}, not {self.kind!r}"
        return None


class _Faults:
    """Present faults of one thruster."""

    __slots__ = ("delayed", "efficiency", "noise", "off", "offset", "present", "random", "stuck_us")

    def __init__(self, random: Random) -> None:
        self.random = random
        self.repair()

    def repair(self) -> None:
        """Remove all faults."""
        self.present: dict[Kind, Failure] = {}
        self.off = False
        self.efficiency = 1.0
        self.stuck_us: int | None = None
        self.delayed: deque[int] | None = None  # pulses that have not taken effect yet, the oldest first
        self.noise = self.offset = 0.0

    def pulse(self, pwm_us: int) -> int:
        """Return the pulse that takes effect when `pwm_us` is commanded."""
        if self.delayed is not None:
            self.delayed.append(pwm_us)
            pwm_us = self.delayed.popleft()
        if self.stuck_us is not None:
            pwm_us = self.stuck_us
        return 0 if self.off else pwm_us

    def factor(self, decay: float) -> float:
        """Return the factor on the thrust; `decay` is the share of the noise that remains after a step."""
        if self.noise:
            deviation = self.noise * sqrt(1.0 - decay * decay)
            self.offset = decay * self.offset + self.random.gauss(0.0, deviation)
        return self.efficiency * (1.0 + self.offset)


class Failures:
    """The failures of the thrusters `names` of a vehicle, stepped every `dt` s.

    `step` is the number of steps already made, `pwm_us` the pulses of the last one.
    """

    def __init__(self, names: Sequence[str], dt: float, seed: int, step: int, pwm_us: tuple[int, ...]) -> None:
        self._names = list(names)
        self._dt = dt
        self._decay = exp(-dt / NOISE_TIME_CONSTANT)
        self._faults = [_Faults(Random(f"{seed}:failure:{name}")) for name in names]
        self._planned: list[tuple[int, int, Failure]] = []  # step, order of arrival, failure; the next one is last
        self._count = 0
        self._step = step
        self._last = pwm_us or (0,) * len(self._names)
        self.factors = [1.0] * len(self._names)  # on the thrusts in the last step

    def add(self, failures: Iterable[Failure]) -> None:
        """Plan failures; one whose time has passed begins with the next step. Raises ConfigError."""
        for failure in failures:
            self._index(failure.thruster)
            # The step that ends after `time`; the small addend compensates rounding of the quotient.
            self._planned.append((int(failure.time / self._dt + 1e-6), self._count, failure))
            self._count += 1
        self._planned.sort(key=lambda planned: planned[:2], reverse=True)
        self._begin_due()

    def present(self, name: str) -> tuple[Failure, ...]:
        """Return the present failures of the thruster `name`, as they were given. Raises ConfigError."""
        return tuple(self._faults[self._index(name)].present.values())

    def pulses(self, pwm_us: tuple[int, ...]) -> tuple[int, ...]:
        """Return the pulses that take effect in this step when `pwm_us` are commanded."""
        self._begin_due()
        self._step += 1
        if len(pwm_us) != len(self._names):
            return pwm_us  # a wrong number of pulses: the thrusters raise the error
        self._last = tuple([faults.pulse(us) for faults, us in zip(self._faults, pwm_us, strict=True)])
        return self._last

    def thrusts(self, thrusts: Sequence[float]) -> list[float]:
        """Return these thrusts (N) as the failures of this step change them."""
        self.factors = [faults.factor(self._decay) for faults in self._faults]
        return [thrust * factor for thrust, factor in zip(thrusts, self.factors, strict=True)]

    def _begin_due(self) -> None:
        """Begin the failures that are due with the next step."""
        while self._planned and self._planned[-1][0] <= self._step:
            self._begin(self._planned.pop()[2])

    def _begin(self, failure: Failure) -> None:
        index = self._index(failure.thruster)
        faults = self._faults[index]
        if failure.kind == "off":
            faults.off = True
        elif failure.kind == "efficiency":
            faults.efficiency = failure.efficiency
        elif failure.kind == "stuck":
            faults.stuck_us = failure.pwm_us or self._last[index]
        elif failure.kind == "delayed":
            faults.delayed = deque([self._last[index]] * round(failure.delay / self._dt))
        elif failure.kind == "noisy":
            faults.noise = failure.noise
        else:
            faults.repair()
            return
        faults.present[failure.kind] = failure

    def _index(self, name: str) -> int:
        if name in self._names:
            return self._names.index(name)
        hint = nearest(name, self._names)
        raise ConfigError(f"failure: no thruster {name!r}{hint}; there are: {', '.join(self._names)}")

"""The error model that all sensors share.

    measured = true * (1 + scale) + offset + turn-on + bias(t) + noise, then rounded and limited

The bias is an Ornstein-Uhlenbeck (first-order Gauss-Markov) process, b' = -b / tau + noise, in its exact
discrete form (Gillespie 1996, Phys. Rev. E 54:2084): its size does not depend on the sampling rate.
"""

from collections.abc import Iterable, Sequence
from math import exp, sqrt
from random import Random
from typing import Annotated, NamedTuple

from hil.common.schema import Range

Size = Annotated[float, Range(0.0, 1e6)]


class ErrorModel(NamedTuple):
    """The errors of one measured quantity, in its own SI unit; a standard deviation (sd) is 1 sigma.

    `offset`: a constant that is known; `turn_on`: sd of a constant drawn when the run starts; `bias`: sd
    of the wandering bias and `bias_time` its time constant; `noise`: sd of white noise on each sample;
    `noise_density`: white noise per square root of Hz, as data sheets give it, which grows with the
    sampling rate; `scale`: sd of the scale factor's error, drawn when the run starts; `resolution`: the
    step of the digital output, and `limit` its largest magnitude (0: none of either).
    """

    offset: Annotated[float, Range(-1e6, 1e6)] = 0.0
    turn_on: Size = 0.0
    bias: Size = 0.0
    bias_time: Annotated[float, Range(1e-3, 1e6, "s")] = 300.0
    noise: Size = 0.0
    noise_density: Size = 0.0
    scale: Annotated[float, Range(0.0, 1.0)] = 0.0
    resolution: Size = 0.0
    limit: Size = 0.0


class ErrorProcess:
    """The errors of one quantity over time, sampled every `period` s with random numbers of `random`."""

    def __init__(self, model: ErrorModel, period: float, random: Random) -> None:
        self._gauss = random.gauss
        self._gain = 1.0 + self._draw(model.scale)
        self._constant = model.offset + self._draw(model.turn_on)
        self._bias = self._draw(model.bias)  # stationary: this is its standard deviation at any time
        self._decay = exp(-period / model.bias_time)
        self._bias_noise = model.bias * sqrt(1.0 - self._decay * self._decay)
        self._noise = sqrt(model.noise**2 + model.noise_density**2 / period)
        self._resolution = model.resolution
        self._limit = model.limit

    def measure(self, true: float) -> float:
        """Return one measurement of `true`; advance the bias by one period."""
        self._bias = self._decay * self._bias + self._draw(self._bias_noise)
        value = self._gain * true + self._constant + self._bias + self._draw(self._noise)
        if self._resolution:
            value = round(value / self._resolution) * self._resolution
        if self._limit:
            value = min(self._limit, max(-self._limit, value))
        return value

    def numbers(self) -> list[float]:
        """Return all numbers that `measure` uses, except random ones, as one flat list, for the C twin."""
        random = [self._gain, self._constant, self._bias, self._decay, self._bias_noise, self._noise]
        return [*random, self._resolution, self._limit]

    def _draw(self, sd: float) -> float:
        return self._gauss(0.0, sd) if sd else 0.0


class ErrorBank:
    """The errors of all quantities of one sensor, which measures them together, every `period` s.

    `sim.twins.make_error_bank` makes one in C if that is compiled.
    """

    def __init__(self, models: Iterable[ErrorModel], period: float, random: Random) -> None:
        self._processes = [ErrorProcess(model, period, random) for model in models]

    def measure(self, true: Sequence[float]) -> list[float]:
        """Return one measurement of each of the `true` values, one for each model; advance time by one period."""
        return [process.measure(value) for process, value in zip(self._processes, true, strict=True)]


def sensor_random(seed: int, sensor: str) -> Random:
    """Return the random numbers of one sensor: the same for one seed and name, whatever other sensors there are."""
    return Random(f"{seed}/{sensor}")  # a text seed is hashed with SHA-512, the same in every process


def variance(model: ErrorModel, period: float) -> float:
    """Return the variance of the errors without that of the scale, as a device may report it."""
    return model.turn_on**2 + model.bias**2 + model.noise**2 + model.noise_density**2 / period

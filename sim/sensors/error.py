"""The error model that all sensors share.

    measured = true * (1 + scale) + offset + turn-on + bias(t) + warm-up(t) + noise, then rounded and limited

The bias is an Ornstein-Uhlenbeck (first-order Gauss-Markov) process, b' = -b / tau + noise, in its exact
discrete form (Gillespie 1996, Phys. Rev. E 54:2084): its size does not depend on the sampling rate. Flicker noise, the
bias instability of data sheets, is the sum of three such processes, a decade apart: together they have the spectrum
1 / f and a flat Allan deviation from 10 to 1000 s.
"""

from collections.abc import Iterable, Sequence
from math import exp, log, sqrt
from random import Random
from typing import Annotated, NamedTuple

from hil.common.schema import Range

Size = Annotated[float, Range(0.0, 1e7)]
Share = Annotated[float, Range(0.0, 1.0)]
Seconds = Annotated[float, Range(1e-3, 1e6, "s")]

_FLICKER_TIMES = 10.0, 100.0, 1000.0
# Standard deviation of each of these processes over the Allan deviation of them all, where that is flat. A ladder of
# processes with the variance s² each, a decade apart, has the one-sided spectrum s² / (f ln 10), and 1 / f has the
# Allan variance 2 ln 2 (IEEE Std 952).
_FLICKER_SIZE = sqrt(log(10.0) / (2.0 * log(2.0)))


class ErrorModel(NamedTuple):
    """The errors of one measured quantity, in its own SI unit; a standard deviation (sd) is 1 sigma.

    `offset`: a constant that is known; `turn_on`: sd of a constant drawn when the run starts; `bias`: sd
    of the wandering bias and `bias_time` its time constant; `noise`: sd of white noise on each sample;
    `noise_density`: white noise per square root of Hz, as data sheets give it, which grows with the
    sampling rate; `scale`: sd of the scale factor's error, drawn when the run starts; `resolution`: the
    step of the digital output, and `limit` its largest magnitude (0: none of either).

    `flicker`: the bias instability, which is the lowest Allan deviation without the white noise; `noise_share`: sd of
    white noise as a share of the value; `warm_up`: sd of an error that is drawn when the run starts and decays with the
    time constant `warm_up_time`, as those of temperature do; `outliers`: the share of samples with a further error,
    whose sd is `outlier`.
    """

    offset: Annotated[float, Range(-1e6, 1e6)] = 0.0
    turn_on: Size = 0.0
    bias: Size = 0.0
    bias_time: Seconds = 300.0
    noise: Size = 0.0
    noise_density: Size = 0.0
    scale: Share = 0.0
    resolution: Size = 0.0
    limit: Size = 0.0
    flicker: Size = 0.0
    noise_share: Share = 0.0
    warm_up: Size = 0.0
    warm_up_time: Seconds = 300.0
    outliers: Share = 0.0
    outlier: Size = 0.0


class ErrorProcess:
    """The errors of one quantity over time, sampled every `period` s with random numbers of `random`."""

    def __init__(self, model: ErrorModel, period: float, random: Random) -> None:
        self._gauss, self._uniform = random.gauss, random.random
        self._gain = 1.0 + self._draw(model.scale)
        self._constant = model.offset + self._draw(model.turn_on)
        sizes = [model.bias] + [model.flicker * _FLICKER_SIZE] * len(_FLICKER_TIMES)
        self._biases = [self._draw(size) for size in sizes]  # stationary: the standard deviations at any time
        self._decays = [exp(-period / time) for time in (model.bias_time, *_FLICKER_TIMES)]
        self._bias_noises = [size * sqrt(1.0 - decay * decay) for size, decay in zip(sizes, self._decays, strict=True)]
        self._warm_up, self._cooling = self._draw(model.warm_up), exp(-period / model.warm_up_time)
        self._noise = sqrt(model.noise**2 + model.noise_density**2 / period)
        self._noise_share = model.noise_share
        self._outliers, self._outlier = model.outliers, model.outlier
        self._resolution = model.resolution
        self._limit = model.limit

    def measure(self, true: float) -> float:
        """Return one measurement of `true`; advance the biases by one period."""
        value = self._gain * true + self._constant
        for i, (decay, noise) in enumerate(zip(self._decays, self._bias_noises, strict=True)):
            self._biases[i] = bias = decay * self._biases[i] + self._draw(noise)
            value += bias
        self._warm_up *= self._cooling
        of_value = self._noise_share * true
        value += self._warm_up + self._draw(sqrt(self._noise * self._noise + of_value * of_value))
        if self._outliers and self._uniform() < self._outliers:
            value += self._draw(self._outlier)
        if self._resolution:
            value = round(value / self._resolution) * self._resolution
        if self._limit:
            value = min(self._limit, max(-self._limit, value))
        return value

    def numbers(self) -> list[float]:
        """Return all numbers that `measure` uses, except random ones, as one flat list, for the C twin."""
        biases = [*self._biases, *self._decays, *self._bias_noises, self._warm_up, self._cooling]
        noise = [self._noise, self._noise_share, self._outliers, self._outlier]
        return [self._gain, self._constant, *biases, *noise, self._resolution, self._limit]

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


def variance(model: ErrorModel, period: float, value: float = 0.0) -> float:
    """Return the variance of the errors at a measured `value`, as a device may report it; outliers are left out."""
    return constant_variance(model) + noise_variance(model, period, value) + (model.scale * value) ** 2


def constant_variance(model: ErrorModel) -> float:
    """Return the variance of the errors that are correlated in time: constants and biases, without the scale."""
    flicker = len(_FLICKER_TIMES) * (model.flicker * _FLICKER_SIZE) ** 2
    return model.turn_on**2 + model.bias**2 + model.warm_up**2 + flicker


def noise_variance(model: ErrorModel, period: float, value: float = 0.0) -> float:
    """Return the variance of the white noise on each sample of a `value`."""
    return model.noise**2 + model.noise_density**2 / period + (model.noise_share * value) ** 2

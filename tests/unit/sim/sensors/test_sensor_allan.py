"""The error model's Allan deviation, computed by an independent library, against theory (IEEE Std 952)."""

from math import exp, sqrt
from random import Random

import pytest

from sim.sensors.error import ErrorModel, ErrorProcess
from tests.support.lazy import import_lazily

allantools = import_lazily("allantools")

RATE = 50.0
SECONDS = 8000.0


def allan_deviation(model: ErrorModel, tau: float) -> float:
    """Return the overlapping Allan deviation of a sensor at rest."""
    process = ErrorProcess(model, 1.0 / RATE, Random(11))
    values = [process.measure(0.0) for _ in range(round(SECONDS * RATE))]
    _, deviations, _, _ = allantools.oadev(values, rate=RATE, data_type="freq", taus=[tau])
    return float(deviations[0])


@pytest.mark.parametrize("tau", [0.1, 1.0, 10.0])
def test_white_noise_falls_with_the_root_of_time(tau: float) -> None:
    """The deviation of a random walk N, of angle or velocity, is N / sqrt(tau), whatever the sampling rate."""
    density = 3.394e-4
    found = allan_deviation(ErrorModel(noise_density=density), tau)
    assert found == pytest.approx(density / sqrt(tau), rel=0.06)


@pytest.mark.parametrize("tau", [0.5, 2.0, 5.0, 20.0, 60.0])
def test_a_wandering_bias_has_the_deviation_of_a_gauss_markov_process(tau: float) -> None:
    size, time = 0.0735, 10.0
    found = allan_deviation(ErrorModel(bias=size, bias_time=time), tau)
    shape = 1.0 - time / (2.0 * tau) * (3.0 - 4.0 * exp(-tau / time) + exp(-2.0 * tau / time))
    assert found == pytest.approx(size * sqrt(2.0 * time / tau * shape), rel=0.12)


def test_constant_errors_do_not_appear() -> None:
    assert allan_deviation(ErrorModel(turn_on=1.0, offset=2.0), 1.0) == pytest.approx(0.0, abs=1e-12)

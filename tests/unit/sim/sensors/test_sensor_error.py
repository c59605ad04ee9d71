"""The error model of sensors: bias, noise, scale, resolution and limits, against other simulators' formulas."""

from itertools import pairwise
from math import exp, log, sqrt
from random import Random
from statistics import fmean, pstdev

import pytest

from sim.sensors.error import ErrorModel, ErrorProcess, variance

RATES = [10.0, 100.0, 1000.0]
TAU, SD = 0.5, 2.0


def series(model: ErrorModel, rate: float, seconds: float, true: float = 0.0) -> list[float]:
    process = ErrorProcess(model, 1.0 / rate, Random(7))
    return [process.measure(true) for _ in range(round(seconds * rate))]


@pytest.mark.parametrize("rate", RATES)
def test_a_bias_wanders_equally_fast_at_every_rate(rate: float) -> None:
    """The change over 0.1 s has the variance 2 sd² (1 - exp(-0.1 / tau))."""
    values = series(ErrorModel(bias=SD, bias_time=TAU), rate, 100.0)[:: round(0.1 * rate)]
    changes = [b - a for a, b in pairwise(values)]
    assert pstdev(changes) == pytest.approx(SD * sqrt(2.0 * (1.0 - exp(-0.1 / TAU))), rel=0.06)


def test_a_bias_has_its_size_from_the_start() -> None:
    random = Random(3)
    first = [ErrorProcess(ErrorModel(bias=SD, bias_time=1e6), 0.01, random).measure(0.0) for _ in range(4000)]
    assert pstdev(first) == pytest.approx(SD, rel=0.05)
    assert fmean(first) == pytest.approx(0.0, abs=0.1)


def test_constant_errors_have_their_stated_size() -> None:
    assert series(ErrorModel(), 10.0, 1.0, true=5.0) == [5.0] * 10
    assert series(ErrorModel(offset=0.25), 10.0, 1.0, true=5.0) == [5.25] * 10
    random = Random(5)
    constant = [ErrorProcess(ErrorModel(turn_on=0.2), 0.1, random) for _ in range(2000)]
    assert constant[0].measure(1.0) == constant[0].measure(1.0)
    assert pstdev([process.measure(1.0) for process in constant]) == pytest.approx(0.2, rel=0.06)
    scaled = [ErrorProcess(ErrorModel(scale=0.01), 0.1, random).measure(100.0) for _ in range(2000)]
    assert pstdev(scaled) == pytest.approx(1.0, rel=0.06)


def test_resolution_rounds_to_steps() -> None:
    process = ErrorProcess(ErrorModel(resolution=0.25), 0.01, Random(1))
    assert [process.measure(true) for true in (0.0, 0.1, 0.13, -0.9, 10.12)] == [0.0, 0.0, 0.25, -1.0, 10.0]


def test_values_are_clipped_at_the_devices_limit() -> None:
    process = ErrorProcess(ErrorModel(noise=1.0, limit=5.0), 0.01, Random(1))
    values = [process.measure(true) for true in (100.0, -100.0)]
    assert values == [5.0, -5.0]
    held = [process.measure(4.9) for _ in range(200)]
    assert max(held) == 5.0
    assert min(held) < 4.0


def test_a_warm_up_error_has_its_size_at_the_start_and_decays() -> None:
    model, random = ErrorModel(warm_up=2.0, warm_up_time=10.0), Random(5)
    values = series(model, 10.0, 20.0)
    assert values[100] / values[0] == pytest.approx(exp(-1.0))
    first = [ErrorProcess(model, 0.1, random).measure(0.0) for _ in range(3000)]
    assert pstdev(first) == pytest.approx(2.0 * exp(-0.01), rel=0.05)


@pytest.mark.parametrize(
    ("model", "true", "expected"),
    [(ErrorModel(noise_share=0.1), 5.0, 0.5), (ErrorModel(noise_share=0.1, noise=0.5), -5.0, sqrt(0.5)),
     (ErrorModel(noise_density=0.2), 5.0, 2.0), (ErrorModel(outliers=0.1, outlier=3.0), 5.0, sqrt(0.9))],
)  # fmt: skip
def test_noise_by_share_density_and_outliers_has_its_size(model: ErrorModel, true: float, expected: float) -> None:
    values = series(model, 100.0, 300.0, true)
    assert pstdev(values) == pytest.approx(expected, rel=0.04)
    assert (values.count(true) > 26_000) == (model.outliers > 0.0), "most samples are no outliers"
    assert variance(model._replace(outliers=0.0), 0.01, true) == pytest.approx(0.0 if model.outliers else expected**2)


def test_flicker_is_three_processes_whose_variances_add() -> None:
    model, random = ErrorModel(flicker=1.0), Random(5)
    size = 3.0 * log(10.0) / (2.0 * log(2.0))
    first = [ErrorProcess(model, 0.1, random).measure(0.0) for _ in range(4000)]
    assert pstdev(first) ** 2 == pytest.approx(size, rel=0.06)
    assert variance(model, 0.1) == pytest.approx(size)
    whole = model._replace(turn_on=2.0, bias=3.0, warm_up=4.0, noise=0.5, noise_density=0.3, scale=0.1)
    assert variance(whole, 0.1, 5.0) == pytest.approx(size + 4.0 + 9.0 + 16.0 + 0.25 + 0.9 + 0.25)

"""The error model's Allan deviation, computed by an independent library, against theory (IEEE Std 952)."""

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


def test_constant_errors_do_not_appear() -> None:
    assert allan_deviation(ErrorModel(turn_on=1.0, offset=2.0), 1.0) == pytest.approx(0.0, abs=1e-12)

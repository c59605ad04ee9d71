"""Absorption of sound, and pressure over depth."""

import pytest

from sim.environment.seawater.absorption import francois_garrison
from sim.environment.seawater.pressure import depth_of, pressure_at


@pytest.mark.parametrize(
    ("arguments", "absorption"),
    [
        ((1e4,), 9.61402e-4), ((1e5,), 0.0335841), ((5e5,), 0.124574), ((1e5, 20.0), 0.0380052),
        ((1e5, 25.0, 38.0, 500.0), 0.0369211), ((5e4, 4.0, 35.0, 3000.0, 7.7), 9.70485e-3),
        ((3e5, 10.0, 0.0), 0.0279613),
    ],
)  # fmt: skip
def test_absorption_depends_on_frequency_temperature_salinity_depth_and_acidity(
    arguments: tuple[float, ...], absorption: float
) -> None:
    assert francois_garrison(*arguments) == pytest.approx(absorption, rel=6e-6)
    assert francois_garrison(1e5, 20.0001) == pytest.approx(francois_garrison(1e5, 20.0), rel=1e-3)


@pytest.mark.parametrize("depth", [-5.0, 0.0, 1.0, 100.0, 10_000.0])
def test_pressure_is_the_inverse_of_depth_and_none_in_air(depth: float) -> None:
    assert depth_of(pressure_at(depth)) == pytest.approx(max(0.0, depth), rel=1e-6)

"""Absorption, beam patterns, speckle, and how echoes are shared between range bins."""

from math import exp, pi, radians, sqrt
from typing import Any

import numpy as np
import pytest

from hil.common.errors import ConfigError
from sim.environment.seawater.absorption import francois_garrison
from sim.sensors.imaging.echoes import Bins, Echoes, add_speckle, array_pattern, beam_pattern, count_bins, first_null


def echoes_of(near: Any, far: Any, energy: Any) -> Echoes:
    """Return echoes, beams x rays."""
    beam = np.repeat(np.arange(len(near)), near.shape[1])
    return Echoes(near.ravel(), near.ravel(), far.ravel(), energy.ravel(), beam, np.zeros(near.size, np.int32))


def ainslie_mccolm(f: float, t: float, s: float, z: float) -> float:
    """Return dB/km at f kHz, pH 8, z km by another formula (Ainslie & McColm 1998, J. Acoust. Soc. Am. 103(3):1671)."""
    f1, f2 = 0.78 * sqrt(s / 35.0) * exp(t / 26.0), 42.0 * exp(t / 17.0)
    boric = 0.106 * f1 * f * f / (f1 * f1 + f * f)
    magnesium = 0.52 * (1.0 + t / 43.0) * s / 35.0 * f2 * f * f / (f2 * f2 + f * f) * exp(-z / 6.0)
    return boric + magnesium + 0.00049 * f * f * exp(-(t / 27.0 + z / 17.0))


@pytest.mark.parametrize("frequency", [10.0, 30.0, 100.0, 450.0, 750.0, 1200.0])
@pytest.mark.parametrize("temperature", [2.0, 10.0, 19.0, 21.0])
def test_absorption_agrees_with_ainslie_and_mccolm(frequency: float, temperature: float) -> None:
    found = francois_garrison(frequency * 1e3, temperature, 35.0, 50.0)
    assert found == pytest.approx(ainslie_mccolm(frequency, temperature, 35.0, 0.05) * 1e-3, rel=0.12)


def test_absorption_in_fresh_water_is_that_of_pure_water() -> None:
    """The absorption is 25e-15 f² Np/m at 20 deg C (Pinkerton 1949), f in Hz."""
    assert francois_garrison(1e6, 20.0, 0.0, 0.0) == pytest.approx(25e-15 * 1e12 * 20.0 / np.log(10.0), rel=0.03)


def test_the_beam_pattern_has_its_half_power_width_and_nulls() -> None:
    width = radians(20.0)
    found = beam_pattern(np.array([0.0, 0.5 * width, -0.5 * width, first_null(width) + 1e-9, 0.5 * pi]), width)
    assert found == pytest.approx([1.0, 0.5, 0.5, 0.0, 0.0], abs=1e-6)
    assert first_null(radians(140.0)) == pytest.approx(0.5 * pi)


def test_side_lobes_have_the_keyed_level_and_decrease() -> None:
    angles = np.linspace(0.0, 0.5 * pi, 200_001)
    gains = array_pattern(angles, radians(1.0), 25.0)
    main = angles < first_null(radians(1.0))
    assert (gains[main] == beam_pattern(angles[main], radians(1.0))).all()
    assert 10.0 * np.log10(gains[~main].max()) == pytest.approx(-25.0, abs=0.1)
    assert gains[~main].argmax() * 2.0e-6 < radians(1.0)
    far = angles > radians(30.0)
    assert 10.0 * np.log10(gains[far].max()) < -45.0


def test_an_echo_is_shared_between_bins_like_that_of_a_plane() -> None:
    """The shares follow the fifth power of the range, and absorption; what is before or beyond all bins is lost."""
    near, far = np.array([[10.3, 40.5, 19.0, 5.0]]), np.array([[30.7, 40.5, 80.0, 11.0]])
    energy = np.array([[9.0, 0.5, 3.0, 2.0]])
    by_bin = Bins(10.0, 0.1, 500, 0.2).distribute(echoes_of(near, far, energy), 1)[0]

    def energy_share(low: float, high: float, first: float, last: float) -> float:
        def integral(a: float, b: float) -> float:
            r = np.linspace(a, b, 2001)
            return float(np.trapezoid(r**-5 * 10.0 ** (-0.04 * r), r))

        return integral(low, high) / integral(first, last)

    assert by_bin[:60].sum() == pytest.approx(
        9.0 * energy_share(10.3, 16.0, 10.3, 30.7) + 2.0 * energy_share(10.0, 11.0, 5.0, 11.0), rel=1e-3
    )
    assert by_bin[60:90].sum() == pytest.approx(9.0 * energy_share(16.0, 19.0, 10.3, 30.7), rel=1e-3)
    assert by_bin[250:310].sum() == pytest.approx(0.5 + 3.0 * energy_share(35.0, 41.0, 19.0, 80.0), rel=1e-3)
    assert by_bin[305] - by_bin[304] == pytest.approx(0.5, rel=1e-3)
    assert by_bin[310:].sum() == pytest.approx(3.0 * energy_share(41.0, 60.0, 19.0, 80.0), rel=1e-3)


def test_an_echo_without_length_is_in_one_bin() -> None:
    at = np.array([[0.3], [4.7], [5.7]])
    found = Bins(0.0, 0.5, 11, 0.1).distribute(echoes_of(at, at, np.array([[2.0], [3.0], [1.0]])), 3)
    assert found.sum(axis=1) == pytest.approx([2.0, 3.0, 0.0])
    assert [int(row.argmax()) for row in found] == [0, 9, 0]


def test_a_sonar_has_one_to_20000_bins() -> None:
    assert (count_bins(0.3, 0.5, 0.2), count_bins(0.0, 2000.0, 0.1)) == (1, 20_000)
    for last in (0.09, 2000.1):
        with pytest.raises(ConfigError, match="range_step"):
            count_bins(0.0, last, 0.1)


def test_speckle_is_rayleigh_distributed() -> None:
    """Intensity is exponential: as much deviation as mean; amplitude has sqrt(pi / (4 - pi)) times its deviation."""
    intensities = add_speckle(np.full(400_000, 3.0, np.float32), 1.0, np.random.default_rng(1))
    assert intensities.mean() == pytest.approx(3.0, rel=0.01)
    assert intensities.std() == pytest.approx(3.0, rel=0.01)
    assert (intensities > 9.0).mean() == pytest.approx(exp(-3.0), rel=0.03)
    amplitude = np.sqrt(intensities)
    assert amplitude.mean() / amplitude.std() == pytest.approx(sqrt(pi / (4.0 - pi)), rel=0.01)
    many = add_speckle(np.full(400_000, 3.0, np.float32), 4.0, np.random.default_rng(1))
    assert (many.mean(), many.std()) == pytest.approx((3.0, 1.5), rel=0.01)
    assert (add_speckle(intensities, 0.0, np.random.default_rng(1)) == intensities).all()

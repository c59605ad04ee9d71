"""The beam former of a forward sonar against the patterns and statistics that it models."""

from math import asin, log, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest

from sim.sensors.imaging.beam_former import BeamFormer
from sim.sensors.imaging.echoes import array_pattern, first_null

SPACING, WIDTH = radians(0.25), radians(1.0)
MIDDLE = 100


def generator(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def former(side_lobes: float = 20.0, floor: float = 0.0, seed: int = 1, beams: int = 201) -> BeamFormer:
    return BeamFormer(beams, SPACING, WIDTH, side_lobes, floor, generator(seed))


def lone(direction: int, bins: int, beams: int = 201) -> Any:
    """Return the echoes of one direction, the same in all bins."""
    echoes = np.zeros((beams, bins), np.float32)
    echoes[direction] = 1.0
    return echoes


@pytest.mark.parametrize("side_lobes", [13.26, 20.0])
def test_a_beam_receives_by_its_pattern(side_lobes: float) -> None:
    found = former(side_lobes).receive(lone(MIDDLE, 1))[:, 0]
    angles = (np.arange(201) - MIDDLE) * SPACING
    assert found == pytest.approx(array_pattern(angles, WIDTH, side_lobes), abs=1e-6)
    null = first_null(WIDTH)
    first = found[(np.abs(angles) > null) & (np.abs(angles) < 2.0 * null)].max()
    assert 10.0 * np.log10(first) == pytest.approx(-side_lobes, abs=0.6)  # beams stand beside its peak


def test_element_errors_give_a_constant_side_lobe_floor() -> None:
    """A line of 102 elements at half a wavelength, off by 1 dB and 10 deg, is (p² + a²) / N: 33 dB down."""
    elements, phase, strength = 102, radians(10.0), 10.0 ** (1.0 / 20.0) - 1.0
    assert -10.0 * np.log10((phase**2 + strength**2) / elements) == pytest.approx(33.5, abs=0.1)
    half = sin(0.5 * 2.0 * asin(0.4429464 * 2.0 / elements))  # of such a line, at half power
    assert 2.0 * asin(half) == pytest.approx(radians(1.0), rel=0.01)
    floors = []
    for seed in range(40):
        powers = former(100.0, 33.0, seed).receive(lone(MIDDLE, 1))[:, 0]
        floors.append([powers[:40].mean(), powers[40:80].mean(), powers[160:].mean()])
    levels = 10.0 * np.log10(np.mean(floors, axis=0))
    assert levels == pytest.approx([-33.0] * 3, abs=0.7)
    one, again = (former(100.0, 33.0, 3).receive(lone(MIDDLE, 1)) for _ in range(2))
    assert (one == again).all(), "they are the array's own"
    assert former(0.0, 33.0).receive(lone(MIDDLE, 1))[0, 0] == 0.0, "none without side lobes"


def test_a_side_lobe_arc_fluctuates_with_its_target() -> None:
    """All beams at its range share one amplitude, so arcs are unbroken lines; other ranges have others."""
    found = former(20.0, 33.0).receive_speckled(lone(MIDDLE, 4000), 0.0, 1.0, generator())
    bright = found.mean(axis=1) > 1e-6
    assert bright.sum() > 180
    alike = np.corrcoef(found[bright])[0]
    assert alike.min() > 0.999
    assert abs(np.corrcoef(found[MIDDLE, :-1], found[MIDDLE, 1:])[0, 1]) < 0.05
    mean = former(20.0, 33.0).receive(lone(MIDDLE, 1))[:, 0]
    assert found.mean(axis=1)[bright] == pytest.approx(mean[bright], rel=0.05)


@pytest.mark.parametrize("looks", [1.0, 3.0])
def test_overlapping_beams_have_correlated_speckle(looks: float) -> None:
    """Intensities are gamma distributed; they are as alike as sinc² of their distance in nulls, the patterns' overlap.

    The pattern is that of a line of even strength, over a seabed that is the same in all directions.
    """
    even = former(13.2615)
    found = even.receive_speckled(np.ones((201, 20_000), np.float32), 0.0, looks, generator())[20:-20]
    mean = even.receive(np.ones((201, 1), np.float32))[20:-20]
    found /= mean
    assert found.mean() == pytest.approx(1.0, rel=0.01)
    assert found.var(axis=1) == pytest.approx(1.0 / looks, rel=0.12)
    assert np.quantile(found, 0.99) == pytest.approx({1.0: log(100.0), 3.0: 2.802}[looks], rel=0.01)
    amplitude = np.sqrt(found)
    if looks == 1.0:
        assert amplitude.mean() / amplitude.std() == pytest.approx(sqrt(pi / (4.0 - pi)), rel=0.01)
    null = first_null(WIDTH) / SPACING
    for apart in (1, 2, 4, 9):
        alike = np.mean([np.corrcoef(found[k], found[k + apart])[0, 1] for k in range(0, 140, 20)])
        assert alike == pytest.approx(np.sinc(apart / null) ** 2, abs=0.05)


@pytest.mark.parametrize("beams", [1, 2, 201])
def test_every_beam_has_the_same_noise(beams: int) -> None:
    """Beams at the edge of the fan have as much as those in the middle."""
    found = former(20.0, 33.0, beams=beams).receive_speckled(
        np.zeros((beams, 20_000), np.float32), 3.0, 1.0, generator()
    )
    assert found.mean(axis=1) == pytest.approx(3.0, rel=0.08)


def test_side_lobes_fill_a_shadow() -> None:
    """A shadow of 30 deg in an even seabed is as dark as the pattern's side lobes and floor add up to."""
    echoes = np.ones((512, 1), np.float32)
    echoes[196:316] = 0.0
    wide = former(20.0, 33.0, beams=512)
    found = wide.receive(echoes)[:, 0]
    away = np.abs(np.arange(512) - 256) >= 60
    pattern = array_pattern((np.arange(512) - 256) * SPACING, WIDTH, 20.0)
    wanted = (pattern + 10.0**-3.3)[away].sum() / pattern.sum()
    level = found[246:266].mean() / found[80:160].mean()
    assert 10.0 * np.log10(level) == pytest.approx(10.0 * np.log10(wanted), abs=2.0)
    assert -16.0 < 10.0 * np.log10(level) < -9.0

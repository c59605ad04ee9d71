"""The beam former of a forward sonar against the patterns that it models; objects smaller than its rays are apart."""

from math import asin, cos, log, pi, radians, sin, sqrt
from random import Random
from typing import Any

import numpy as np
import pytest

from sim.dynamics import State
from sim.environment.world import World
from sim.rays import solids
from sim.rotations import from_euler
from sim.sensors.imaging.beam_former import BeamFormer
from sim.sensors.imaging.echoes import array_pattern, first_null
from sim.sensors.imaging.forward_sonar import ForwardSonarModel
from tests.support.fitted import DEEP, image
from tests.unit.sim.sensors.test_forward_sonar import AHEAD, TRUE, facing_wall, forward

SPACING, WIDTH = radians(0.25), radians(1.0)
MIDDLE = 100


def generator(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def make_former(side_lobes: float = 20.0, floor: float = 0.0, seed: int = 1, beams: int = 201) -> BeamFormer:
    return BeamFormer(beams, SPACING, WIDTH, side_lobes, floor, generator(seed))


def lone(direction: int, bins: int, beams: int = 201) -> Any:
    """Return the echoes of one direction, the same in all bins."""
    echoes = np.zeros((beams, bins), np.float32)
    echoes[direction] = 1.0
    return echoes


@pytest.mark.parametrize("side_lobes", [13.26, 20.0])
def test_a_beam_receives_by_its_pattern(side_lobes: float) -> None:
    levels = make_former(side_lobes).receive(lone(MIDDLE, 1))[:, 0]
    angles = (np.arange(201) - MIDDLE) * SPACING
    assert levels == pytest.approx(array_pattern(angles, WIDTH, side_lobes), abs=1e-6)
    null = first_null(WIDTH)
    first = levels[(np.abs(angles) > null) & (np.abs(angles) < 2.0 * null)].max()
    assert 10.0 * np.log10(first) == pytest.approx(-side_lobes, abs=0.6)  # beams stand beside its peak


def test_element_errors_give_a_constant_side_lobe_floor() -> None:
    """A line of 102 elements at half a wavelength, off by 1 dB and 10 deg, is (p² + a²) / N: 33 dB down."""
    elements, phase, strength = 102, radians(10.0), 10.0 ** (1.0 / 20.0) - 1.0
    assert -10.0 * np.log10((phase**2 + strength**2) / elements) == pytest.approx(33.5, abs=0.1)
    half = sin(0.5 * 2.0 * asin(0.4429464 * 2.0 / elements))  # of such a line, at half power
    assert 2.0 * asin(half) == pytest.approx(radians(1.0), rel=0.01)
    floors = []
    for seed in range(40):
        powers = make_former(100.0, 33.0, seed).receive(lone(MIDDLE, 1))[:, 0]
        floors.append([powers[:40].mean(), powers[40:80].mean(), powers[160:].mean()])
    levels = 10.0 * np.log10(np.mean(floors, axis=0))
    assert levels == pytest.approx([-33.0] * 3, abs=0.7)
    one, again = (make_former(100.0, 33.0, 3).receive(lone(MIDDLE, 1)) for _ in range(2))
    assert (one == again).all(), "they are the array's own"
    assert make_former(0.0, 33.0).receive(lone(MIDDLE, 1))[0, 0] == 0.0, "none without side lobes"


def test_a_side_lobe_arc_fluctuates_with_its_target() -> None:
    """All beams at its range share one amplitude, so arcs are unbroken lines; other ranges have others."""
    intensities = make_former(20.0, 33.0).receive_speckled(lone(MIDDLE, 4000), 0.0, 1.0, generator())
    bright = intensities.mean(axis=1) > 1e-6
    assert bright.sum() > 180
    alike = np.corrcoef(intensities[bright])[0]
    assert alike.min() > 0.999
    assert abs(np.corrcoef(intensities[MIDDLE, :-1], intensities[MIDDLE, 1:])[0, 1]) < 0.05
    mean = make_former(20.0, 33.0).receive(lone(MIDDLE, 1))[:, 0]
    assert intensities.mean(axis=1)[bright] == pytest.approx(mean[bright], rel=0.05)


@pytest.mark.parametrize("looks", [1.0, 3.0])
def test_overlapping_beams_have_correlated_speckle(looks: float) -> None:
    """Intensities are gamma distributed; they are as alike as sinc² of their distance in nulls, the patterns' overlap.

    The pattern is that of a line of even strength, over a seabed that is the same in all directions.
    """
    even = make_former(13.2615)
    intensities = even.receive_speckled(np.ones((201, 20_000), np.float32), 0.0, looks, generator())[20:-20]
    mean = even.receive(np.ones((201, 1), np.float32))[20:-20]
    intensities /= mean
    assert intensities.mean() == pytest.approx(1.0, rel=0.01)
    assert intensities.var(axis=1) == pytest.approx(1.0 / looks, rel=0.12)
    assert np.quantile(intensities, 0.99) == pytest.approx({1.0: log(100.0), 3.0: 2.802}[looks], rel=0.01)
    amplitude = np.sqrt(intensities)
    if looks == 1.0:
        assert amplitude.mean() / amplitude.std() == pytest.approx(sqrt(pi / (4.0 - pi)), rel=0.01)
    null = first_null(WIDTH) / SPACING
    for apart in (1, 2, 4, 9):
        alike = np.mean([np.corrcoef(intensities[k], intensities[k + apart])[0, 1] for k in range(0, 140, 20)])
        assert alike == pytest.approx(np.sinc(apart / null) ** 2, abs=0.05)


@pytest.mark.parametrize("beams", [1, 2, 201])
def test_every_beam_has_the_same_noise(beams: int) -> None:
    """Beams at the edge of the fan have as much as those in the middle."""
    intensities = make_former(20.0, 33.0, beams=beams).receive_speckled(
        np.zeros((beams, 20_000), np.float32), 3.0, 1.0, generator()
    )
    assert intensities.mean(axis=1) == pytest.approx(3.0, rel=0.08)


def test_side_lobes_fill_a_shadow() -> None:
    """A shadow of 30 deg in an even seabed is as dark as the pattern's side lobes and floor add up to."""
    echoes = np.ones((512, 1), np.float32)
    echoes[196:316] = 0.0
    wide = make_former(20.0, 33.0, beams=512)
    levels = wide.receive(echoes)[:, 0]
    away = np.abs(np.arange(512) - 256) >= 60
    pattern = array_pattern((np.arange(512) - 256) * SPACING, WIDTH, 20.0)
    wanted = (pattern + 10.0**-3.3)[away].sum() / pattern.sum()
    level = levels[246:266].mean() / levels[80:160].mean()
    assert 10.0 * np.log10(level) == pytest.approx(10.0 * np.log10(wanted), abs=2.0)


# --- objects smaller than the distance between rays


def echoes_of_ball(radius: float, seed: int, model: ForwardSonarModel, floor: World = DEEP) -> tuple[float, float]:
    """Return the echoes of a ball about 20 m away, somewhere in the fan, and those before it."""
    chance = Random(seed)
    across, down, distance = radians(chance.uniform(-28, 28)), radians(chance.uniform(-8, 8)), chance.uniform(19, 21)
    sonar = forward(floor, model)
    empty = image(sonar.sample(0, AHEAD))
    place = distance * cos(down) * cos(across), distance * cos(down) * sin(across), 10.0 + distance * sin(down)
    sonar.add(solids.sphere((0.0, 0.0, 0.0), radius), State(place))
    more = image(sonar.sample(0, AHEAD)) - empty
    first = int((distance - radius) / 0.1)
    return float(more[first : first + 5].clip(0.0).sum()), float(more[: first - 1].clip(0.0).sum())


@pytest.mark.parametrize("radius", [0.15, 0.075])
def test_a_ball_between_rays_is_always_detected(radius: float) -> None:
    """Every ping of the usual fan of 32 rays a beam shows it, about as bright, and nothing comes before it."""
    model = TRUE._replace(rays=32, beams=256)
    measured = [echoes_of_ball(radius, seed, model) for seed in range(25)]
    echoes = np.array(measured)[:, 0]
    assert echoes.min() > 0.25 * np.median(echoes)
    assert max(before for _, before in measured) < 1e-6 * np.median(echoes)


@pytest.mark.parametrize("radius", [0.12, 0.5])
def test_nothing_comes_from_behind_a_ball(radius: float) -> None:
    """Rays that touch a ball go sqrt(d² - r²); no echo is farther than that by more than the ball is deep."""
    sonar = forward(DEEP, TRUE._replace(range_step=0.01, max_range=4.0))
    sonar.add(solids.sphere((0.0, 0.0, 0.0), radius), State((0.9, 0.0, 10.0)))
    sums = image(sonar.sample(0, AHEAD)).sum(axis=1)
    touching = sqrt(0.9**2 - radius**2)
    behind = touching + touching - (0.9 - radius)
    assert sums[int(behind / 0.01) + 1 :].max() < 1e-9 * sums.max()
    assert sums[int((0.9 - radius) / 0.01) : int(touching / 0.01)].sum() > 0.99 * sums.sum()


def test_a_split_cell_is_counted_once() -> None:
    """A ball takes from a wall behind it what it hides, no more; beams beside it receive the wall as before."""
    sonar = forward(facing_wall(25.0), TRUE._replace(rays=32))
    ball_only = image(sonar.sample(0, AHEAD))
    sonar.add(solids.sphere((0.0, 0.0, 0.0), 0.2), State((15.0, 0.0, 10.0)))
    with_wall = image(sonar.sample(0, AHEAD))
    wall = slice(245, 400)
    assert with_wall[wall].sum() < ball_only[wall].sum()
    assert with_wall[wall].sum() == pytest.approx(ball_only[wall].sum(), rel=0.01)
    assert with_wall[wall, :20] == pytest.approx(ball_only[wall, :20], rel=1e-5)
    hidden = ball_only[wall, 32].sum() - with_wall[wall, 32].sum()
    assert 0.0 < hidden < 0.2 * ball_only[wall, 32].sum()


def test_a_thin_rope_is_detected_in_every_beam_that_crosses_it() -> None:
    """The rope is 5 cm thick, level, 1.5 m below the sonar and 15 m ahead."""
    sonar = forward(DEEP, TRUE._replace(rays=24, beams=128, beam_width=radians(0.5)))
    across = from_euler(radians(90.0), 0.0, 0.0)
    sonar.add(solids.cylinder((0.0, 0.0, 0.0), 0.025, 6.0), State((15.0, 0.0, 11.5), across))
    picture = image(sonar.sample(0, AHEAD))
    beams = np.array(sonar.sample(0, AHEAD).beams)
    crossing = np.abs(np.tan(beams)) < 5.8 / 15.0
    assert crossing.sum() > 80
    assert picture[:, crossing].sum(axis=0).min() > 0.0

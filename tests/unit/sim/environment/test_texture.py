"""Texture of a seabed below its grid: by position alone, of the keyed size, and none finer than the footprint."""

import numpy as np
import pytest

from sim.environment.bottom import PROPERTIES, Bottom
from sim.environment.relief import Fractal
from sim.environment.terrain import Terrain, covering
from sim.environment.texture import Texture, smooth_slopes
from sim.environment.world import load_world

NORTH, EAST = np.random.default_rng(1).uniform(-200.0, 200.0, (2, 20_000)).astype(np.float32)


def test_the_texture_of_a_point_does_not_depend_on_the_viewpoint() -> None:
    one, other = Texture(Bottom()), Texture(Bottom())
    all_slopes, part = one.sample(NORTH, EAST, 0.1), other.sample(NORTH[5:9], EAST[5:9], 0.1)
    assert (all_slopes[0][5:9] == part[0]).all()
    assert (all_slopes[1][5:9] == part[1]).all()
    assert (Texture(Bottom(seed=2)).sample(NORTH, EAST, 0.1)[0] != all_slopes[0]).mean() > 0.9


def test_slopes_are_the_derivative_of_a_relief_of_the_keyed_roughness() -> None:
    """The integral of the slope along a line is the relief: its deviation is that of the keys."""
    north = np.arange(0.0, 20.48, 0.04) + 0.02
    heights = []
    for east in np.arange(0.02, 20.0, 0.8):
        slope, *_ = Texture(Bottom(roughness=0.05)).sample(north, np.full_like(north, east), 0.01)
        height = np.cumsum(slope) * 0.04
        heights.append(height - height.mean())
    assert np.std(heights) == pytest.approx(0.05, rel=0.25)


def test_texture_finer_than_the_footprint_is_omitted() -> None:
    texture = Texture(Bottom(ripple_height=0.05, ripple_length=0.4))
    fine, coarse = (texture.sample(NORTH, EAST, footprint)[0].std() for footprint in (0.04, 1.5))
    assert coarse < 0.3 * fine


def test_ripples_follow_their_heading() -> None:
    texture = Texture(Bottom(roughness=0.0, ripple_height=0.06, ripple_length=0.5))
    to_north, to_east, _ = texture.sample(NORTH, EAST, 0.01)
    assert to_north.max() == pytest.approx(0.03 * 2.0 * np.pi / 0.5, rel=0.01)
    assert not to_east.any()
    across = Texture(Bottom(roughness=0.0, ripple_height=0.06, ripple_length=0.5, ripple_heading=np.pi / 2))
    assert np.abs(across.sample(NORTH, EAST, 0.01)[0]).max() < 1e-6


@pytest.mark.parametrize("kind", list(PROPERTIES))
def test_kinds_have_their_stated_roughness_and_patchiness(kind: str) -> None:
    texture = Texture(Bottom(kind=kind))  # type: ignore[arg-type]
    assert texture.sample(NORTH, EAST, 0.01)[2].std() == pytest.approx(PROPERTIES[kind].patches, rel=0.1)  # type: ignore[index]
    assert texture.echo == PROPERTIES[kind].echo  # type: ignore[index]


def test_slopes_are_continuous_between_cells() -> None:
    grid = covering((0.0, 40.0, 0.0, 40.0), 2.0)
    terrain = Terrain(grid, Fractal(20.0, 2.0, resolution=2.0).depths(grid), 20.0)
    line = np.arange(2.0, 38.0, 0.01)
    smooth, _ = smooth_slopes(terrain, line, np.full_like(line, 11.3))
    facets = np.array([terrain.gradient(north, 11.3)[0] for north in line])
    assert np.abs(np.diff(smooth)).max() < 0.1 * np.abs(np.diff(facets)).max()
    assert smooth.mean() == pytest.approx(facets.mean(), abs=0.02)
    assert not any(slope.any() for slope in smooth_slopes(terrain, np.array([-5.0, 80.0]), np.array([3.0, 3.0])))


def test_a_world_file_names_its_bottom() -> None:
    assert load_world("fractal").bottom == Bottom("rock")
    assert load_world("pool").bottom is None

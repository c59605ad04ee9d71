"""The expected depth where soundings are uncertain and the chart sets limits."""

import numpy as np
import pytest

from hil.charts.build import build
from hil.charts.expected_depths import Limits, distance_to_borders, expected_depths
from hil.charts.sources.survey import DepthArea, Sheet, Survey


def test_the_mean_of_a_clipped_normal_distribution_equals_that_of_draws() -> None:
    """The mean equals that of draws: on a limit, beyond it (which counts as on it), between both, and with no limit."""
    draws = np.random.default_rng(1).standard_normal(400_000)
    for depth, low, high in ((10.0, 10.0, 50.0), (4.0, 10.0, 50.0), (12.0, 10.0, 13.0), (30.0, -np.inf, 31.0)):
        middle = min(max(depth, low), high)
        possible = middle + 2.0 * draws
        possible = possible[(possible > low) & (possible < high)]
        found = expected_depths(np.array([depth]), np.array([2.0]), Limits(np.array([low]), np.array([high])))
        assert found[0] == pytest.approx(possible.mean(), abs=0.02)


def test_unlimited_depths_stay_and_certain_depths_are_clipped() -> None:
    depths = np.array([5.0, 20.0, 7.0, np.nan])
    open_water = Limits(np.full(4, -np.inf), np.full(4, np.inf))
    assert expected_depths(depths, np.full(4, 3.0), open_water) == pytest.approx(depths, nan_ok=True)
    held = expected_depths(depths, np.zeros(4), Limits(np.full(4, 6.0), np.full(4, 6.5)))
    assert held == pytest.approx([6.0, 6.5, 6.5, np.nan], nan_ok=True)


def square(side: float) -> tuple[np.ndarray, ...]:
    return (np.array([(-side, -side), (side, -side), (side, side), (-side, side), (-side, -side)]),)


def test_a_basin_without_soundings_is_deeper_than_its_contour() -> None:
    """The bed from a contour of 10 m to an area of 10 to 30 m, with soundings that slope down, has no terrace.

    The bed leaves the contour by a slope, not a cliff, and keeps to its limits and soundings.
    """
    inner, outer = square(200.0), square(400.0)
    ring = np.linspace(-200.0, 200.0, 41)
    contour = [(n, e, 10.0) for k in ring for n, e in ((k, -200.0), (k, 200.0), (-200.0, k), (200.0, k))]
    ends = np.linspace(-390.0, 390.0, 14)
    soundings = [(n, e, 4.0) for k in ends for n, e in ((k, -390.0), (k, 390.0), (-390.0, k), (390.0, k))]
    inside = [(-50.0, -50.0, 11.0), (50.0, 50.0, 10.5)]
    sheet = Sheet("", outer, (DepthArea(outer, 2.0, 10.0), DepthArea(inner, 10.0, 30.0)), ())
    survey = Survey("", None, np.array([*soundings, *inside]), guides=np.array(contour), sheets=(sheet,))
    grid = build(survey, (-380.0, 380.0, -380.0, 380.0), 10.0).model.grid
    depths = grid.depths.astype(float)
    basin = depths[20:57, 20:57]
    assert basin.min() > 9.99
    assert (basin < 10.05).mean() < 0.25, "no terrace"
    assert basin.max() < 14.0
    assert max(np.abs(np.diff(depths, axis=axis)).max() for axis in (0, 1)) < 1.2, "no cliff"
    assert grid.at(np.array(inside)[:, :2]) == pytest.approx([11.0, 10.5], abs=0.01)
    away = distance_to_borders(survey, np.array([[0.0, 0.0], [150.0, 0.0], [300.0, 0.0]]))
    assert away == pytest.approx([200.0, 50.0, 100.0], abs=0.5)

"""The statistics of a bed, selected by soundings that are held out."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from hil.charts.expected_depths import Limits, expected_depths
from hil.charts.gridding import POWERS, Model, Surface
from hil.charts.held_out import _linear as linear_estimates
from hil.charts.held_out import choose_model
from hil.charts.sources.survey import first_in_cell
from tests.support.charts.known_bed import contoured, known_bed, sounded

Array = NDArray[np.float64]

COUNT = 400
POINTS: Array = np.random.default_rng(5).uniform(0.0, 1000.0, (COUNT, 2))
SMOOTH: Array = 20.0 + 5.0 * np.sin(POINTS[:, 0] / 150.0) * np.cos(POINTS[:, 1] / 200.0)
FAR = np.full(COUNT, np.inf)


def limits(low: float, high: float) -> Limits:
    return Limits(np.full(COUNT, low), np.full(COUNT, high))


def chosen(depths: Array, within: Limits) -> Model:
    return choose_model(Surface(POINTS, depths), depths, within, FAR)


def test_a_rough_bed_gets_a_lower_power_than_a_smooth_one() -> None:
    rough = SMOOTH + np.random.default_rng(5).normal(0.0, 0.5, COUNT)
    models = [chosen(depths, limits(-np.inf, np.inf)) for depths in (SMOOTH, rough)]
    assert [model.power for model in models] == [max(POWERS), min(POWERS)]


def test_soundings_just_below_the_limit_of_their_area_make_the_bed_shoaler() -> None:
    """Most are 0.1 m below a contour of 10 m, a few far below: held out in other folds, the bed is not too deep."""
    random = np.random.default_rng(6)
    depths = 10.0 + np.where(random.random(COUNT) < 0.05, random.uniform(0.0, 8.0, COUNT), 0.1)
    below = limits(10.0, 20.0)
    model = chosen(depths, below)
    assert model.shift < -0.05
    estimates, uncertainty = Surface(POINTS, depths, model=model).cross_validate(random.permutation(COUNT) % 10)
    deviation = uncertainty.deviation(FAR)
    errors = [(expected_depths(estimates, deviation, below, shift) - depths).mean() for shift in (0.0, model.shift)]
    assert errors[0] > 0.1
    assert abs(errors[1]) < 0.5 * errors[0]


def test_whole_areas_between_contours_on_their_deep_side_are_not_shoal() -> None:
    """Contours are drawn where the bed is 1.5 m deeper than they say. All soundings of an area are held out at once."""
    bed = known_bed()
    soundings, guides = sounded(bed, 500), contoured(bed, list(np.arange(6.5, 90.0, 5.0)))
    guides[:, 2] -= 1.5
    points = np.concatenate([soundings, guides[first_in_cell(guides, 40.0)]])
    low = 5.0 * np.floor((soundings[:, 2] - 1.5) / 5.0)
    within = Limits(low, low + 6.5)
    borders = KDTree(guides[:, :2]).query(soundings[:, :2])[0]
    surface = Surface(points[:, :2], points[:, 2], soundings=len(soundings))
    surface.model = choose_model(surface, soundings[:, 2], within, borders)
    assert surface.model.shift > 0.05
    quarters = 2 * (soundings[:, 0] > 640.0) + (soundings[:, 1] > 640.0)
    folds = (4 * np.round(low / 5.0) + quarters).astype(np.intp)
    estimates, uncertainty = surface.cross_validate(folds)
    deviation = uncertainty.deviation(borders)
    shifted, plain = (
        expected_depths(estimates, deviation, within, shift) - soundings[:, 2] for shift in (surface.model.shift, 0.0)
    )
    linear = within.clip(linear_estimates(points, folds)) - soundings[:, 2]
    reached = np.isfinite(linear)
    assert plain[reached].mean() < -0.3
    assert abs(shifted[reached].mean()) < 0.4 * abs(plain[reached].mean())
    assert (shifted[reached] ** 2).mean() < 0.95**2 * (linear[reached] ** 2).mean()


def test_a_shift_stays_within_the_limits_and_leaves_what_is_known() -> None:
    depths = expected_depths(np.full(COUNT, 12.0), np.linspace(0.0, 4.0, COUNT), limits(10.0, 20.0), -3.0)
    assert depths[0] == 12.0
    assert depths.min() == 10.0
    assert (np.diff(depths) <= 1e-9).all()


def test_statistics_of_few_soundings_are_not_estimated() -> None:
    three = np.array([[0.0, 0.0], [0.0, 9.0], [9.0, 0.0]])
    depths = np.array([1.0, 2.0, 3.0])
    assert choose_model(Surface(three, depths), depths, Limits(depths - 1.0, depths + 1.0), depths) == Model()

"""Interpolation of soundings to a grid, and its estimated error."""

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.charts.build import build
from hil.charts.gridding import BOX_POINTS, Model, Surface
from hil.charts.sources.survey import Survey
from hil.common.errors import ConfigError
from tests.support.charts.known_bed import SIDE, STEP, contoured, known_bed, sounded

Array = NDArray[np.float64]

AXIS: Array = np.asarray(STEP * np.arange(SIDE))
ALL = np.ones((SIDE, SIDE), bool)


def rms(errors: Array) -> float:
    return float(np.sqrt(np.nanmean(errors**2)))


def scattered(count: int) -> tuple[Array, Array]:
    random = np.random.default_rng(5)
    points = random.uniform(0.0, 100.0, (count, 2))
    return points, np.sin(points[:, 0] / 15.0) * 4.0 + np.cos(points[:, 1] / 20.0) * 3.0


@pytest.mark.parametrize("count", [3, 4, 40, 700])
def test_the_surface_passes_through_every_sounding(count: int) -> None:
    points, depths = scattered(count)
    surface = Surface(points, depths)
    order = np.argsort(points[:, 0])
    for index in order[:: max(1, count // 20)]:
        at = surface.evaluate(points[index : index + 1, 0], points[index : index + 1, 1], np.ones((1, 1), bool))
        assert at[0, 0] == pytest.approx(depths[index], abs=1e-5)


def test_planes_and_level_beds_are_reproduced() -> None:
    points, _ = scattered(400)
    axis = np.linspace(5.0, 95.0, 40)
    level = Surface(points, np.full(400, 7.0)).evaluate(axis, axis, np.ones((40, 40), bool))
    assert level == pytest.approx(np.full((40, 40), 7.0), abs=1e-6)
    sloped = Surface(points, 10.0 + 0.2 * points[:, 0] - 0.1 * points[:, 1])
    found = sloped.evaluate(axis, axis, np.ones((40, 40), bool))
    assert np.abs(found - (10.0 + 0.2 * axis[:, None] - 0.1 * axis)).max() < 0.35


def test_there_are_no_creases_between_patches() -> None:
    """A fine section through many patches has no step, and slopes that change little from one mm to the next."""
    points, depths = scattered(6 * BOX_POINTS)
    surface = Surface(points, depths)
    centres = 0.5 * np.linspace(20.0, 80.0, 9)
    for east in centres:
        fine = np.linspace(20.0, 80.0, 6001)  # 1 cm apart
        section = surface.evaluate(fine, np.array([east]), np.ones((6001, 1), bool))[:, 0]
        distances = (
            np.min(np.hypot(fine[:, None] - points[:, 0], east - points[:, 1]), axis=1) > 0.3
        )  # cones of the linear kernel
        bends = np.abs(np.diff(section, 2))[distances[1:-1]]
        assert np.abs(np.diff(section)).max() < 0.02
        assert bends.max() < 4e-4


def test_held_out_errors_equal_those_of_fits_without_the_points() -> None:
    """Held-out errors equal those of fits really made without the points, in one patch whose corners hold its frame."""
    points, depths = scattered(BOX_POINTS - 4)
    corners = np.array([[0.0, 0.0], [0.0, 100.0], [100.0, 0.0], [100.0, 100.0]])
    points, depths = np.vstack([points, corners]), np.append(depths, [1.0, 2.0, 3.0, 4.0])
    folds = np.append(np.arange(BOX_POINTS - 4) % 5, [-1] * 4)
    errors, uncertainty = Surface(points, depths).cross_validate(folds)
    assert np.isnan(errors[-4:]).all()
    for fold in range(5):
        base = Surface(points[folds != fold], depths[folds != fold])
        for index in np.flatnonzero(folds == fold):
            truth = base.evaluate(points[index : index + 1, 0], points[index : index + 1, 1], np.ones((1, 1), bool))
            assert errors[index] == pytest.approx(truth[0, 0], abs=1e-7)
            there = base.uncertainty(points[index : index + 1, 0], points[index : index + 1, 1], np.ones((1, 1), bool))
            assert uncertainty.variance[index] == pytest.approx(there.variance[0, 0], rel=1e-5)
            assert uncertainty.roughness[index] == pytest.approx(there.roughness[0, 0], rel=1e-5)


def test_the_estimated_deviation_agrees_with_the_actual_error() -> None:
    """Held-out errors divided by their deviations have a size of one, and the deviation is zero at the soundings."""
    bed = known_bed()
    soundings = sounded(bed, 300)
    surface = Surface(soundings[:, :2], soundings[:, 2])
    found, uncertainty = surface.cross_validate(np.arange(300) % 10)
    off = (found - soundings[:, 2]) / uncertainty.deviation(np.full(300, np.inf))
    assert 0.6 < rms(off) < 1.5
    north, east = soundings[:1, 0], soundings[:1, 1]
    assert surface.uncertainty(north, east, np.ones((1, 1), bool)).variance[0, 0] == pytest.approx(0.0, abs=1e-6)
    assert (uncertainty.deviation(np.zeros(300)) == 0.0).all()


def test_patches_are_smaller_where_points_are_dense(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand points in one corner are in far fewer patches than they would be, and all is blended."""
    random = np.random.default_rng(3)
    points = np.vstack([random.uniform(0.0, 100.0, (60, 2)), random.uniform(0.0, 10.0, (1000, 2))])
    surface = Surface(points, np.full(1060, 4.0))
    axis = np.linspace(0.0, 100.0, 50)
    assert surface.evaluate(axis, axis, np.ones((50, 50), bool)) == pytest.approx(np.full((50, 50), 4.0), abs=1e-4)
    assert np.isfinite(surface.uncertainty(axis, axis, np.ones((50, 50), bool)).variance).all()
    monkeypatch.setattr("hil.charts.gridding.MAX_PATCH_POINTS", 10_000)
    free = Surface(points, np.full(1060, 4.0))
    held, unheld = (sum(len(patch.inside) for patch in found._patches) for found in (surface, free))
    assert held < 0.9 * unheld


def test_collinear_points_are_gridded_and_two_points_refused() -> None:
    line = np.column_stack([np.linspace(0.0, 50.0, 30), np.zeros(30)])
    found = Surface(line, line[:, 0] / 10.0).evaluate(np.array([12.0]), np.array([0.0, 3.0]), np.ones((1, 2), bool))
    assert found[0] == pytest.approx([1.2, 1.2], abs=0.1)
    with pytest.raises(ConfigError, match="at least three depths, found 2"):
        Surface(line[:2], np.zeros(2))


def test_only_requested_nodes_are_evaluated() -> None:
    points, depths = scattered(300)
    axis = np.linspace(0.0, 100.0, 30)
    wanted = np.random.default_rng(2).random((30, 30)) < 0.3
    part, whole = (Surface(points, depths).evaluate(axis, axis, mask) for mask in (wanted, np.ones((30, 30), bool)))
    assert np.isnan(part[~wanted]).all()
    assert part[wanted] == pytest.approx(whole[wanted], abs=1e-9)


def test_a_known_bed_is_reproduced_better_than_by_triangles() -> None:
    """A bed from 300 soundings with contours each 10 m is far better than their linear interpolation."""
    from scipy.interpolate import LinearNDInterpolator

    bed = known_bed()
    soundings = sounded(bed, 300)
    nodes = np.column_stack([axis.ravel() for axis in np.meshgrid(AXIS, AXIS, indexing="ij")])
    linear = LinearNDInterpolator(soundings[:, :2], soundings[:, 2])(nodes).reshape(SIDE, SIDE)
    inside = np.isfinite(linear)
    reference = Surface(soundings[:, :2], soundings[:, 2]).evaluate(AXIS, AXIS, ALL)
    survey = Survey("known", None, soundings, guides=contoured(bed, [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]), reach=1e4)
    built = build(survey, (0.0, AXIS[-1], 0.0, AXIS[-1]), STEP)
    errors = [rms((found - bed)[inside]) for found in (linear, reference, built.model.grid.depths.astype(float))]
    assert errors[1] < 0.97 * errors[0]
    assert errors[2] < 0.7 * errors[0]
    assert built.report.rmse < 0.97 * built.report.linear_rmse, "which has the contours too"
    assert built.report.rmse == pytest.approx(errors[2], rel=0.2), "held-out errors agree with the true ones"


def test_several_divisions_into_folds_give_what_each_gives_alone() -> None:
    """The last points, for which no fold is given, are never left out."""
    points, depths = scattered(60)
    divisions = np.column_stack([np.arange(50) % 5, np.arange(50) // 10])
    surface = Surface(points, depths)
    errors, uncertainty = surface.cross_validate(divisions)
    for column, division in enumerate(divisions.T):
        alone, of_it = surface.cross_validate(np.append(division, [-1] * 10))
        assert errors[:, column] == pytest.approx(alone[:50], rel=1e-9)
        assert uncertainty.variance[:, column] == pytest.approx(of_it.variance[:50], rel=1e-9)


def test_a_wider_spread_is_a_larger_deviation_of_the_same_bed() -> None:
    points, depths = scattered(60)
    folds = np.arange(60) % 5
    (plain, narrow), (same, wide) = (Surface(points, depths, model=Model(1.5, k)).cross_validate(folds) for k in (1, 2))
    assert same == pytest.approx(plain)
    away = np.full(60, np.inf)
    assert wide.deviation(away) == pytest.approx(2.0 * narrow.deviation(away))


def test_soundings_beside_a_steep_shore_leave_a_level_bed_certain() -> None:
    """A wall through few soundings raises the deviation on the level bed beyond by less than its height."""
    random = np.random.default_rng(6)
    points = random.uniform(0.0, 100.0, (200, 2))
    level = 10.0 + random.normal(0.0, 0.1, 200)
    wall = np.where(points[:, 0] < 5.0, 0.0, level)
    at = np.array([80.0])
    deviations = [
        Surface(points, depths).uncertainty(at, at, np.ones((1, 1), bool)).deviation(np.full((1, 1), np.inf))[0, 0]
        for depths in (level, wall)
    ]
    assert deviations[1] < 2.0 * deviations[0] < 1.0


def test_a_stray_point_beside_dense_ones_needs_no_more_memory() -> None:
    """A damaged chart may have a point far outside; the patch from there to the others is large."""
    dense = np.random.default_rng(1).random((6000, 2)) * [1000.0, 1000.0]
    points = np.vstack([dense, [[500.0, 2500.0]]])
    surface = Surface(points, np.full(len(points), 5.0))
    assert max(len(patch.inside) for patch in surface._patches) < 1500
    assert surface.at(np.array([[500.0, 2000.0], [500.0, 990.0]])) == pytest.approx(5.0)

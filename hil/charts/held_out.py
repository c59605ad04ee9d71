"""Estimate the error of a bed by cross-validation, and compare it with linear interpolation of the same data.

The statistics of a bed are those that predict held-out soundings best.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Mask
from hil.charts.expected_depths import Limits, expected_depths
from hil.charts.gridding import POWERS, Indices, Model, Surface

Array = NDArray[np.float64]

FOLDS = 10
MANY = 20_000  # soundings, above which only one fold is held out instead of ten
SPREADS = (1.0, 1.4)  # multiples of a patch's robust deviation, which is too small where errors have long tails
SELECTION_FOLDS = 5
SELECTION_DIVISIONS = 3  # into folds: which soundings are left out together must not select the statistics
SELECTION_PATCHES = 600  # number of patches by which the statistics are selected, of more
EQUAL_ERROR = 1.005  # ratio of errors that are taken as equal


class HeldOut(NamedTuple):
    """Errors at soundings that were held out, m.

    `rmse` of the surface, `linear_rmse` of linear interpolation, and `bias`, the mean error of the surface (positive if
    too deep), over the `reached_count` soundings that linear interpolation reaches. `rmse_all`: of the surface, over
    all soundings that were held out.
    """

    rmse: float
    linear_rmse: float
    bias: float
    rmse_all: float
    reached_count: int


def choose_model(surface: Surface, depths: Array, limits: Limits, borders: Array) -> Model:
    """Return the statistics by which `surface` predicts soundings best, each from the others and the contours.

    `depths` (m), `limits` and `borders` (m, distances from the borders of areas) are those of the n soundings, (n,)
    each. Of powers that predict about equally well the greatest is taken, for the smoothest bed. The shift makes the
    mean error zero: a chart shows the shoal soundings of an area first, but draws contours on their deep side.
    """
    if len(depths) < SELECTION_FOLDS:
        return Model()
    random = np.random.default_rng(1)
    divisions = SELECTION_DIVISIONS if len(depths) <= MANY else 1
    folds = np.stack([random.permutation(len(depths)) % SELECTION_FOLDS for _ in range(divisions)], axis=1)
    limits, borders = Limits(*(part[:, None] for part in limits)), borders[:, None]
    trials: dict[Model, float] = {}
    for power in POWERS:
        estimates, uncertainty = surface.cross_validate(folds, Model(power), SELECTION_PATCHES)
        deviation = uncertainty.deviation(borders)
        for spread in SPREADS:
            errors = expected_depths(estimates, spread * deviation, limits) - depths[:, None]
            has_error = np.isfinite(errors)
            if not has_error.any():  # no sounding is in the patches that were used
                return Model()
            shift = -float(errors[has_error].mean() / max(spread * deviation[has_error].mean(), 1e-9))
            trials[Model(power, spread, shift)] = _rms(errors[has_error])
    least = EQUAL_ERROR * min(trials.values())
    power = max(model.power for model, error in trials.items() if error <= least)
    return min((model for model in trials if model.power == power), key=trials.__getitem__)


def hold_out(surface: Surface, points: Array, mask: Mask, limits: Limits, borders: Array) -> HeldOut:
    """Return the errors at soundings. Each is compared with a fit that leaves out its fold, a tenth of the soundings.

    The first n of `points` (m, 3) are soundings; `mask` (n,) selects those to hold out. Contours are never held out.
    Linear interpolation is over the triangulation of soundings and contours. Both are clipped to the `limits`, (n,)
    each, and the surface is moved off them as in the grid. `borders` (n,): distance (m) from the borders of areas.
    """
    count = len(mask)
    if not mask.any():
        return HeldOut(np.nan, np.nan, np.nan, np.nan, 0)
    folds = np.random.default_rng(0).permutation(count) % FOLDS
    if mask.sum() > MANY:
        folds = np.where(folds == 0, 0, -1)
    folds = np.where(mask, folds, -1)
    estimates, uncertainty = surface.cross_validate(folds)
    linear = limits.clip(_linear(points, folds))
    expected = expected_depths(estimates, uncertainty.deviation(borders), limits, surface.model.shift)
    errors = expected - points[:count, 2]
    linear_errors = linear - points[:count, 2]
    reached = np.isfinite(linear_errors)
    return HeldOut(
        _rms(errors[reached]),
        _rms(linear_errors[reached]),
        float(errors[reached].mean()) if reached.any() else float("nan"),
        _rms(errors[folds >= 0]),
        int(reached.sum()),
    )


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")


def _linear(points: Array, folds: Indices) -> Array:
    """Return the depths at soundings by triangulating the points of other folds; nan outside, or if not held out."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError

    estimates = np.full(len(folds), np.nan)
    for fold in np.unique(folds[folds >= 0]):
        out = np.flatnonzero(folds == fold)
        rest = np.delete(points, out, axis=0)
        try:
            estimates[out] = LinearNDInterpolator(rest[:, :2], rest[:, 2])(points[out, :2])
        except QhullError:  # all points are on one line
            continue
    return estimates

"""Estimate the error of a bed by cross-validation, and compare it with linear interpolation of the same data."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Mask
from hil.charts.expected_depths import Limits, expected_depths
from hil.charts.gridding import Indices, Surface

Array = NDArray[np.float64]

FOLDS = 10
MANY = 20_000  # soundings, above which only one fold is held out instead of ten


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


def hold_out(surface: Surface, points: Array, wanted: Mask, limits: Limits, borders: Array) -> HeldOut:
    """Return the errors at soundings. Each is compared with a fit that leaves out its fold, a tenth of the soundings.

    The first n of `points` (m, 3) are soundings; `wanted` (n,) selects those to hold out. Contours are never held out.
    Linear interpolation is over the triangulation of soundings and contours. Both are clipped to the `limits`, (n,)
    each, and the surface is moved off them as in the grid. `borders` (n,): distance (m) from the borders of areas.
    """
    count = len(wanted)
    folds = np.random.default_rng(0).permutation(count) % FOLDS
    if wanted.sum() > MANY:
        folds = np.where(folds == 0, 0, -1)
    folds = np.where(wanted, folds, -1)
    estimates, uncertainty = surface.cross_validate(np.concatenate([folds, np.full(len(points) - count, -1)]))
    deviation = uncertainty._replace(
        variance=uncertainty.variance[:count], roughness=uncertainty.roughness[:count]
    ).deviation(borders)
    linear = limits.clip(_linear(points, folds))
    errors = expected_depths(estimates[:count], deviation, limits) - points[:count, 2]
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

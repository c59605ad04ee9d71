"""Estimate the error of a bed by soundings that are held out, ours beside linear interpolation of the same data."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Mask
from hil.charts.expected import Limits, expected
from hil.charts.gridding import Indices, Surface

Array = NDArray[np.float64]

FOLDS = 10
MANY = 20_000  # soundings, from which on one fold is held out instead of ten


class HeldOut(NamedTuple):
    """RMSE in m of ours and of the linear where the latter reaches, and our mean error there, positive too deep.

    `rmse_all`: of ours everywhere; `held`: how many soundings the linear reaches.
    """

    rmse: float
    linear_rmse: float
    bias: float
    rmse_all: float
    held: int


def hold_out(surface: Surface, points: Array, wanted: Mask, limits: Limits, borders: Array) -> HeldOut:
    """Hold out the `wanted` (n,) of the soundings, which are the first n of `points` (m, 3), a tenth at a time.

    Contours are kept. Ours and the linear, which is the triangulation of soundings and contours, are both held between
    the areas' `limits` (n,) each, and ours is what is expected between them, as in the grid. `borders` (n,): how far in
    m the areas' borders are.
    """
    count = len(wanted)
    folds = np.random.default_rng(0).permutation(count) % FOLDS
    if wanted.sum() > MANY:
        folds = np.where(folds == 0, 0, -1)
    folds = np.where(wanted, folds, -1)
    found, doubt = surface.held_out(np.concatenate([folds, np.full(len(points) - count, -1)]))
    deviation = doubt._replace(variance=doubt.variance[:count], roughness=doubt.roughness[:count]).deviation(borders)
    linear = limits.hold(_linear(points, folds))
    errors = expected(found[:count], deviation, limits) - points[:count, 2]
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
    """Return soundings as triangles of the other points have them; nan outside, and where none is held out."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError

    estimates = np.full(len(folds), np.nan)
    for fold in np.unique(folds[folds >= 0]):
        out = np.flatnonzero(folds == fold)
        rest = np.delete(points, out, axis=0)
        try:
            estimates[out] = LinearNDInterpolator(rest[:, :2], rest[:, 2])(points[out, :2])
        except QhullError:  # all in one line
            continue
    return estimates

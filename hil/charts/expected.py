"""Move the bed off its limits to the depth that is expected between them.

Where a surface leaves the limits of its area, the bed lies somewhere between them. Set to the limit, it would be a
terrace with the depth of that limit. How far from the limit it is expected follows from how uncertain the surface is
there (hil.charts.gridding): not at all on contours and soundings.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Mask, contains
from hil.charts.bounds import Bounds, around
from hil.charts.grid import Depths, Grid
from hil.charts.gridding import Doubt, Surface
from hil.charts.sources.survey import Survey, resample

Array = NDArray[np.float64]

COARSE = 8.0  # distance of places where the uncertainty is asked for, in what a chart resolves
SQRT_2_PI = float(np.sqrt(2.0 * np.pi))


class Limits(NamedTuple):
    """Shoal and deep limits of depths, m."""

    low: Array
    high: Array

    def hold(self, depths: Array) -> Array:
        """Return the nearest to `depths` that the limits allow."""
        return np.asarray(np.maximum(np.minimum(depths, self.high), self.low))


def expected(depths: Array, deviation: Array, limits: Limits) -> Array:
    """Return the mean of the depths that are possible within limits of the same shape.

    A depth is normally distributed with `deviation` (m) about what the limits allow of `depths` (m).
    """
    from scipy.special import ndtr

    middle = limits.hold(depths)
    with np.errstate(divide="ignore", invalid="ignore"):  # no deviation; nan
        low, high = (limits.low - middle) / deviation, (limits.high - middle) / deviation
        share = ndtr(high) - ndtr(low)
        shift = deviation * (np.exp(-0.5 * low * low) - np.exp(-0.5 * high * high)) / (SQRT_2_PI * share)
    return limits.hold(middle + np.where((deviation > 0.0) & (share > 0.0), shift, 0.0))


def leave_limits(grid: Grid, limits: Limits, surface: Surface, known: Mask, detail: float) -> Depths:
    """Return the depths of `grid` (rows, columns) as they are expected within its limits; `known` nodes stay.

    The uncertainty of `surface` is asked for each few `detail` m only: it changes slowly but for what known nodes near
    by weight.
    """
    from scipy.ndimage import distance_transform_edt, maximum_filter

    if known.all():
        return grid.depths
    step = max(1, int(COARSE * detail / grid.resolution))
    rows, columns = (np.append(np.arange(0, count - 1, step), count - 1) for count in known.shape)
    north, east = grid.north[rows], grid.east[columns]
    wet = maximum_filter(~known, 2 * step + 1)[np.ix_(rows, columns)]
    coarse = Doubt(*map(np.nan_to_num, surface.doubt(north, east, wet)))
    across = [np.array([np.interp(grid.east, east, row) for row in part]) for part in coarse]
    away = grid.resolution * distance_transform_edt(~known) if known.any() else np.full(known.shape, np.inf)
    found = np.empty(grid.depths.shape, np.float32)
    for row, place in enumerate(grid.north):
        after = min(int(np.searchsorted(north, place, "right")), len(north) - 1)
        share = (place - north[after - 1]) / (north[after] - north[after - 1])
        doubt = Doubt(*((1.0 - share) * part[after - 1] + share * part[after] for part in across))
        here = Limits(limits.low[row], limits.high[row])
        found[row] = expected(grid.depths[row].astype(float), doubt.deviation(away[row]), here)
    return found


def known_nodes(bounds: Bounds, grid: Grid, points: Array) -> Mask:
    """Return which nodes are land or unknown, around one of `points`, or beside the border of an area."""
    from scipy.ndimage import maximum_filter, minimum_filter

    known = around(points, grid) | bounds.land | ~bounds.known
    for limit in (bounds.low, bounds.high):
        known |= maximum_filter(limit, 3, mode="nearest") != minimum_filter(limit, 3, mode="nearest")
    return known


def from_borders(survey: Survey, points: Array) -> Array:
    """Return how far in m `points` (n, 2) are from the borders of areas, which are contours, coasts and edges."""
    from scipy.spatial import KDTree

    places = np.empty((0, 2))
    for sheet in survey.sheets:
        lines = [resample(line, survey.detail) for area in sheet.areas for line in area.edges if len(line) > 1]
        places = np.concatenate([places[~contains(sheet.coverage, places)], *lines])
    return np.asarray(KDTree(places).query(points)[0]) if len(places) else np.full(len(points), np.inf)

"""Move the bed from the limits of its area to the depth that is expected between them.

Where the fitted surface is outside the limits of a depth area, the bed lies between them. Setting it to the limit would
make a flat terrace. The expected distance from the limit follows from the uncertainty of the surface
(hil.charts.gridding), which is 0 on contours and soundings.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Mask, contains
from hil.charts.bounds import Bounds, nodes_around
from hil.charts.grid import Depths, Grid
from hil.charts.gridding import Surface, Uncertainty
from hil.charts.sources.survey import Survey, resample

Array = NDArray[np.float64]

UNCERTAINTY_SPACING = 8.0  # spacing of the points where the uncertainty is computed, as a multiple of the detail
SQRT_2_PI = float(np.sqrt(2.0 * np.pi))


class Limits(NamedTuple):
    """Shoal and deep limits of depths, m."""

    low: Array
    high: Array

    def clip(self, depths: Array) -> Array:
        """Return `depths` clipped to the limits."""
        return np.asarray(np.maximum(np.minimum(depths, self.high), self.low))


def expected_depths(depths: Array, deviation: Array, limits: Limits, shift: float = 0.0) -> Array:
    """Return the expected depths within limits; all arrays have the same shape.

    Each depth is normally distributed about the clipped value of `depths` (m) with `deviation` (m), truncated at the
    limits, and then shifted by `shift` deviations (positive: deeper), also within the limits.
    """
    from scipy.special import ndtr

    middle = limits.clip(depths)
    with np.errstate(divide="ignore", invalid="ignore"):  # the deviation may be 0, and depths nan
        low, high = (limits.low - middle) / deviation, (limits.high - middle) / deviation
        share = ndtr(high) - ndtr(low)
        inward = deviation * (np.exp(-0.5 * low * low) - np.exp(-0.5 * high * high)) / (SQRT_2_PI * share)
    return limits.clip(middle + np.where((deviation > 0.0) & (share > 0.0), inward, 0.0) + shift * deviation)


def move_off_limits(grid: Grid, limits: Limits, surface: Surface, known: Mask, detail: float) -> Depths:
    """Return the expected depths of `grid` (rows, columns) within its limits; `known` nodes have no deviation.

    The uncertainty of `surface` is computed on a coarser grid (UNCERTAINTY_SPACING times `detail`, m) and interpolated.
    The distance to known nodes, which changes it faster, is taken into account at every node.
    """
    from scipy.interpolate import RegularGridInterpolator
    from scipy.ndimage import distance_transform_edt, maximum_filter

    if known.all():
        return grid.depths
    step = max(1, int(UNCERTAINTY_SPACING * detail / grid.resolution))
    rows, columns = (np.append(np.arange(0, count - 1, step), count - 1) for count in known.shape)
    north, east = grid.north[rows], grid.east[columns]
    wet = maximum_filter(~known, 2 * step + 1)[np.ix_(rows, columns)]
    coarse = surface.uncertainty(north, east, wet)
    across = RegularGridInterpolator((north, east), np.nan_to_num(np.stack(coarse[:2], axis=-1)))
    distance = grid.resolution * distance_transform_edt(~known) if known.any() else np.full(known.shape, np.inf)
    depths = np.empty(grid.depths.shape, np.float32)
    for row, place in enumerate(grid.north):
        variance, roughness = across(np.column_stack([np.full(len(grid.east), place), grid.east])).T
        deviation = Uncertainty(variance, roughness, surface.model.power).deviation(distance[row])
        here = Limits(limits.low[row], limits.high[row])
        depths[row] = expected_depths(grid.depths[row].astype(float), deviation, here, surface.model.shift)
    return depths


def known_nodes(bounds: Bounds, grid: Grid, points: Array) -> Mask:
    """Return the mask of the nodes on land, unknown, around one of `points`, or at the border of an area."""
    from scipy.ndimage import maximum_filter, minimum_filter

    known = nodes_around(points, grid) | bounds.land | ~bounds.known
    for limit in (bounds.low, bounds.high):
        known |= maximum_filter(limit, 3, mode="nearest") != minimum_filter(limit, 3, mode="nearest")
    return known


def distance_to_borders(survey: Survey, points: Array) -> Array:
    """Return the distance (m) of `points` (n, 2) from the borders of depth areas: contours, coasts and chart edges."""
    from scipy.spatial import KDTree

    positions = np.empty((0, 2))
    for sheet in survey.sheets:
        lines = [resample(line, survey.detail) for area in sheet.areas for line in area.edges if len(line) > 1]
        positions = np.concatenate([positions[~contains(sheet.coverage, positions)], *lines])
    return np.asarray(KDTree(positions).query(points)[0]) if len(positions) else np.full(len(points), np.inf)

"""Limits of depth at every node of a grid from a chart's areas: depth range, land, or unknown."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, Mask, contains, edge_distance, fill, segments
from hil.charts.grid import Depths, Grid
from hil.charts.sources.survey import Sheet, Survey

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

LAND_RISE = 2.0  # m above the water at a shore; the chart's beach where that is higher
LAND_SLOPE = 0.15  # the shape of land is not on a chart: it rises so, up to
LAND_TOP = 30.0  # m
# In cells: a narrower slope at an edge askew has teeth, as a grid's bed is bilinear between its nodes.
BANK = 1.5
BORDER = 2.0  # how far, in what a chart resolves, a border of depth areas may be off
SPREAD = 0.98
PASSES = 24


class Bounds(NamedTuple):
    """Limits of the depth at each node, (rows, columns): shoal and deep limit in m, masks of land and known nodes.

    `shore`: how far in cells it is to the edge of charted land, inf where that is far.
    """

    low: Array
    high: Array
    land: Mask
    known: Mask
    shore: Depths


def paint(survey: Survey, north: Array, east: Array) -> Bounds:
    """Return the bounds at the crossings of `north` and `east` (m), the finer chart over the coarser."""
    shape = len(north), len(east)
    bounds = Bounds(
        np.full(shape, -np.inf), np.full(shape, np.inf), np.zeros(shape, bool), np.zeros(shape, bool),
        np.full(shape, np.inf, np.float32),
    )  # fmt: skip
    if survey.reach > 0.0 and len(survey.soundings):
        bounds.known[:] = _near(survey.soundings, north, east, survey.reach)
        bounds.low[:], bounds.high[:] = survey.soundings[:, 2].min(), survey.soundings[:, 2].max()
    for sheet in survey.sheets:
        _paint_sheet(sheet, north, east, bounds)
    return bounds


def _paint_sheet(sheet: Sheet, north: Array, east: Array, bounds: Bounds) -> None:
    part, valid = fill(sheet.coverage, north, east)
    covered = np.zeros(bounds.known.shape, bool)
    covered[part] = valid
    bounds.low[covered], bounds.high[covered] = -np.inf, np.inf
    bounds.land[covered], bounds.known[covered], bounds.shore[covered] = False, True, np.inf
    for area in sheet.areas:
        part, inside = fill(area.edges, north, east)
        inside &= covered[part]
        bounds.low[part][inside], bounds.high[part][inside] = area.low, area.high
    for mask, value, many in ((bounds.land, True, sheet.land), (bounds.known, False, sheet.unsurveyed)):
        for edges in many:
            part, inside = fill(edges, north, east)
            mask[part][inside & covered[part]] = value
    part, away = edge_distance(*_outer(sheet.land), north, east)
    np.copyto(bounds.shore[part], away, where=covered[part])


def _outer(areas: tuple[Edges, ...]) -> tuple[Array, Array]:
    """Return the starts and ends of the straight pieces, (n, 2) each, that no two areas share."""
    start, end = segments(edge for edges in areas for edge in edges)
    swap = (start[:, 0] > end[:, 0]) | ((start[:, 0] == end[:, 0]) & (start[:, 1] > end[:, 1]))
    pieces = np.where(swap[:, None], np.hstack([end, start]), np.hstack([start, end]))
    pieces, counts = np.unique(pieces, axis=0, return_counts=True)
    return pieces[counts == 1, :2], pieces[counts == 1, 2:]


def _near(points: Array, north: Array, east: Array, reach: float) -> Mask:
    """Return which nodes have one of `points` within `reach` m."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points[:, :2])
    nodes = (np.column_stack([np.full(len(east), row), east]) for row in north)
    return np.array([np.isfinite(tree.query(row, distance_upper_bound=reach)[0]) for row in nodes])


def limits_at(survey: Survey, points: Array) -> tuple[Array, Array]:
    """Return shoal and deep limit in m at `points` (n, 2)."""
    low, high = np.full(len(points), -np.inf), np.full(len(points), np.inf)
    for sheet in survey.sheets:
        covered = contains(sheet.coverage, points)
        low[covered], high[covered] = -np.inf, np.inf
        for area in sheet.areas:
            inside = covered & contains(area.edges, points)
            low[inside], high[inside] = area.low, area.high
    return low, high


def relaxed(low: Array, detail: float, resolution: float) -> Array:
    """Return shoal limits that begin a little inside their areas: the least as near as a chart's lines are drawn.

    `low`: (rows, columns) m, inf where there is no water. Where a deep area borders on a shoal one, as a dredged
    channel does, the bed may rise to the border: a limit that ended at a node would make a cliff as jagged as the grid.

    """
    from scipy.ndimage import minimum_filter

    reach = int(BORDER * detail / resolution + 0.5)
    soft = minimum_filter(low, 2 * reach + 1, mode="nearest") if reach else low
    return np.where(np.isinf(low), low, soft)


def settle(grid: Grid, low: Array, high: Array, soundings: Array) -> Depths:
    """Return the depths of `grid` within their limits (rows, columns), without a cliff where one begins.

    How far a node has to go is spread to its neighbours, fading by SPREAD per cell, as far as their limits let them.
    Not so around a sounding, where the bed is known.
    """
    bed = grid.depths
    low, high = low.astype(np.float32), high.astype(np.float32)
    need = np.nan_to_num(np.clip(bed, low, high) - bed)
    if need.any():
        known, here = around(soundings, grid), need.copy()
        for _ in range(PASSES):
            edge = np.pad(need, 1, mode="edge")
            mean = np.float32(0.25 * SPREAD) * (edge[:-2, 1:-1] + edge[2:, 1:-1] + edge[1:-1, :-2] + edge[1:-1, 2:])
            need = np.nan_to_num(np.clip(bed + mean, low, high) - bed)
            need[known] = here[known]
    return np.asarray(np.clip(bed + need, low, high), np.float32)


def around(points: Array, grid: Grid) -> Mask:
    """Return which nodes are a corner of a cell with one of `points` (n, 2 or more) in it."""
    corners = np.zeros(grid.depths.shape, bool)
    last: Indices = np.array(corners.shape, np.intp) - 1
    scaled = (points[:, :2] - (grid.north_min, grid.east_min)) / grid.resolution
    scaled = scaled[((scaled >= 0.0) & (scaled <= last)).all(axis=1)]
    rows, columns = np.minimum(np.floor(scaled).astype(np.intp), last - 1).T
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        corners[rows + row, columns + column] = True
    return corners


def allowance(soundings: Array, limits: Array, north: Array, east: Array, reach: float) -> Array:
    """Return how far (m) the bed may lie below its deep limit: as far as a sounding there does, fading over `reach` m.

    `limits`: the deep limit at each sounding. Generalised charts have soundings deeper than the area they are in;
    a sounding is a measurement and the area's limit a drawing, so the sounding is kept.
    """
    extra = np.zeros((len(north), len(east)))
    for place_north, place_east, excess in np.column_stack([soundings[:, :2], soundings[:, 2] - limits]):
        if excess <= 0.0 or not np.isfinite(excess):
            continue
        rows, columns = (
            slice(*np.searchsorted(axis, (place - reach, place + reach)))
            for axis, place in ((north, place_north), (east, place_east))
        )
        away = np.hypot(*np.meshgrid(north[rows] - place_north, east[columns] - place_east, indexing="ij"))
        extra[rows, columns] = np.maximum(extra[rows, columns], excess * np.clip(1.5 - away / reach, 0.0, 1.0))
    return extra


def keep_shoals(grid: Grid, soundings: Array, shoalest: Array, low: Array, passes: int = 20) -> Grid:
    """Return the grid lifted where, between its nodes, it would be deeper than a sounding, but never above `low`.

    `shoalest`: the shoal limit of the area that each sounding is in. A shoal smaller than a cell has no node of its
    own: around its sounding that limit holds, not the one of the deeper area where the nodes are. Each pass
    spreads a sounding's shortfall over the four nodes around it in proportion to their weight there.
    """
    depths, low = grid.depths.copy(), low.copy()
    scaled = (soundings[:, :2] - (grid.north_min, grid.east_min)) / grid.resolution
    corners = np.floor(scaled).astype(np.intp)
    inside = ((corners >= 0) & (corners < np.array(depths.shape) - 1)).all(axis=1)
    for (i, j), limit in zip(corners[inside], shoalest[inside], strict=True):
        low[i : i + 2, j : j + 2] = np.minimum(low[i : i + 2, j : j + 2], limit)
    for _ in range(passes):
        excess = np.where(inside, grid._replace(depths=depths).at(soundings[:, :2]) - soundings[:, 2], 0.0)
        for index in np.flatnonzero(excess > 1e-3):  # nan, beside what is unknown, is not
            (i, j), (u, v) = corners[index], scaled[index] - corners[index]
            weights = np.outer((1 - u, u), (1 - v, v))
            depths[i : i + 2, j : j + 2] -= (excess[index] * weights / (weights * weights).sum()).astype(np.float32)
        np.maximum(depths, low, out=depths, where=np.isfinite(low))
    return grid._replace(depths=depths)


def banked(depths: NDArray[np.floating[Any]], tops: Array, inside: Array) -> Array:
    """Return `depths` (m) with what rises from them to `tops` (m) and has a slope as its edge; never deeper.

    `inside`: how far in cells each place is within that edge, negative outside. What comes out of the water has its
    water line there, what does not its full height.
    """
    rise = np.maximum(depths - tops, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):  # no rise
        at_edge = np.clip((depths - np.maximum(tops, 0.0)) / rise, 0.0, 1.0)
    return np.asarray(depths - np.nan_to_num(np.clip(at_edge + inside / BANK, 0.0, 1.0)) * rise)


def raise_land(depths: Depths, bounds: Bounds, resolution: float) -> Depths:
    """Return `depths` with a slope where there is land: up from its shore, or from the beach if that is higher."""
    from scipy.ndimage import distance_transform_edt

    land, water = bounds.land, bounds.known & ~bounds.land
    if not land.any():
        return depths
    distance, nearest = distance_transform_edt(~water, sampling=resolution, return_indices=True)
    shore = np.minimum(depths[tuple(nearest)], -LAND_RISE)
    slope = np.maximum(shore - LAND_SLOPE * distance, np.minimum(shore, -LAND_TOP))
    raised = np.where(land, slope, depths).astype(np.float32)
    # Not where land ends with its chart: there is no shore.
    edge = (bounds.shore < BANK) & (land | water) & (distance < (BANK + 1.0) * resolution)
    before = depths[tuple(part[edge] for part in nearest)]
    raised[edge] = banked(before, slope[edge], np.where(land[edge], 1.0, -1.0) * bounds.shore[edge])
    return raised

"""Limits of depth at every node of a grid from a chart's areas: depth range, land, or unknown."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, Mask, contains, edge_distance, fill, segments
from hil.charts.grid import Depths, Grid
from hil.charts.quays import (
    BESIDE,
    SAME_WIDTH,
    blocks_of,
    clear_behind,
    clear_single,
    find_coasts,
    find_walled,
    strips_of,
    wall_outline,
)
from hil.charts.sources.survey import Sheet, Survey

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

LAND_RISE = 2.0  # m above the water at a shore, or the height of the chart's beach where that is higher
# A chart does not give the shape of land: it rises with this slope, up to LAND_TOP.
LAND_SLOPE = 0.15
LAND_TOP = 30.0  # m
# Depths between nodes are linear, so along an oblique edge a bend makes ripples of an eighth of BEND. A bank at an edge
# therefore runs out over several cells, and its slope goes on into the land as far as a cell with water in it reaches.
BEND = 0.2  # m, change of the slope per cell, in m per cell
MIN_FOOT_CELLS = 1.5
FOOT_CELLS = 8.0  # greatest width of a bank outside of its edge
NARROW_FOOT_CELLS = 2.5  # the same near known depths, which a wide bank would bury, and of a raised area
SPREAD_CELLS = 12  # on either side, along which a known depth keeps a bank narrow
STRAIGHT_CELLS = 1.5  # inside of it; more than the diagonal of a cell
LEAST_SLOPE = 0.01  # of land and bed at a shore
SOUNDED = 20.0  # distance from a sounding up to which an unsurveyed bed counts as known: 1 cm on paper, in details
BORDER_ERROR = 2.0  # greatest error of the border of a depth area, as a multiple of the chart's detail
SPREAD_PER_CELL = 0.98  # factor by which a correction fades from one cell to the next
SPREAD_PASSES = 24
PLANE_CELLS = 4  # around a place of a shore, by which the slope of the bed is found there
STEP_WIDTH = 0.1  # cells, of the steps that are a bank where the grid has none
PLANE_SPREAD = 1.5  # cells, standard deviation of the weights of its nodes


class Bounds(NamedTuple):
    """Limits of the depth at each node, (rows, columns): shoal and deep limit in m, masks of land and known nodes.

    `shore`: distance in cells to the edge of charted land without quays, inf where it is far away. `walled`: mask of
    nodes with a wall between them and a natural coast behind it. `blocks`, `strips`: rings (5, 2) of what stands for
    narrow moles, and for the bank of a natural coast beside them (hil.charts.quays.blocks_of, strips_of). `opposite`:
    pieces (2, 2) of such coasts.
    """

    low: Array
    high: Array
    land: Mask
    known: Mask
    shore: Depths
    walled: Mask
    blocks: list[Array]
    strips: list[Array]
    opposite: list[Array]


def rasterise_bounds(survey: Survey, north: Array, east: Array) -> Bounds:
    """Return the bounds at the crossings of `north` and `east` (m); a finer chart replaces a coarser one."""
    shape = len(north), len(east)
    bounds = Bounds(
        np.full(shape, -np.inf), np.full(shape, np.inf), np.zeros(shape, bool), np.zeros(shape, bool),
        np.full(shape, np.inf, np.float32), np.zeros(shape, bool), [], [], [],
    )  # fmt: skip
    if survey.reach > 0.0 and len(survey.soundings):
        bounds.known[:] = _near(survey.soundings, north, east, survey.reach)
        bounds.low[:], bounds.high[:] = survey.soundings[:, 2].min(), survey.soundings[:, 2].max()
    walls = wall_outline(survey)
    for sheet in survey.sheets:
        _rasterise_sheet(sheet, north, east, bounds, walls)
    for edges in (edges for sheet in survey.sheets for edges in sheet.unsurveyed):
        track = survey.soundings[contains(edges, survey.soundings[:, :2])]
        if len(track):  # of a ship on passage
            bounds.known[_near(track, north, east, SOUNDED * survey.detail)] = True
    return bounds


def _rasterise_sheet(sheet: Sheet, north: Array, east: Array, bounds: Bounds, walls: Any) -> None:
    window, valid = fill(sheet.coverage, north, east)
    covered = np.zeros(bounds.known.shape, bool)
    covered[window] = valid
    bounds.low[covered], bounds.high[covered] = -np.inf, np.inf
    bounds.land[covered], bounds.known[covered], bounds.shore[covered] = False, True, np.inf
    bounds.walled[covered] = False
    for area in sheet.areas:
        window, inside = fill(area.edges, north, east)
        inside &= covered[window]
        bounds.low[window][inside], bounds.high[window][inside] = area.low, area.high
    for mask, value, many in ((bounds.land, True, sheet.land), (bounds.known, False, sheet.unsurveyed)):
        for edges in many:
            window, inside = fill(edges, north, east)
            mask[window][inside & covered[window]] = value
    land = tuple(edge for edges in sheet.land for edge in edges)
    coasts = find_coasts(walls, *_outer_edges(sheet.land), land, north[1] - north[0])
    for rings, found in ((bounds.blocks, blocks_of), (bounds.strips, strips_of)):
        uncovered = [ring for ring in rings if not contains(sheet.coverage, ring[:4].mean(axis=0)[None])[0]]
        rings[:] = [*uncovered, *found(coasts, north[1] - north[0])]
    bounds.opposite.extend(np.stack([coasts.start, coasts.end], axis=1)[coasts.opposite])
    is_natural = ~(coasts.quay | coasts.mole | coasts.single | coasts.opposite)
    window, away = edge_distance(coasts.start[is_natural], coasts.end[is_natural], north, east, int(FOOT_CELLS) + 1)
    np.copyto(bounds.shore[window], away, where=covered[window])
    clear_behind(coasts, north, east, bounds[:5], covered)
    window, away, walled = find_walled(coasts, north, east, int(FOOT_CELLS) + 1)
    np.minimum(bounds.shore[window], away, out=bounds.shore[window], where=covered[window] & ~walled)
    bounds.walled[window] |= walled & covered[window]
    clear_single(coasts, north, east, bounds[:6], covered)


def _outer_edges(areas: tuple[Edges, ...]) -> tuple[Array, Array]:
    """Return the starts and ends, (n, 2) each, of the edges that belong to one area only."""
    start, end = segments(edge for edges in areas for edge in edges)
    swap = (start[:, 0] > end[:, 0]) | ((start[:, 0] == end[:, 0]) & (start[:, 1] > end[:, 1]))
    pieces = np.where(swap[:, None], np.hstack([end, start]), np.hstack([start, end]))
    pieces, counts = np.unique(pieces, axis=0, return_counts=True)
    return pieces[counts == 1, :2], pieces[counts == 1, 2:]


def _near(points: Array, north: Array, east: Array, reach: float) -> Mask:
    """Return the mask of the nodes that have one of `points` within `reach` m."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points[:, :2])
    nodes = (np.column_stack([np.full(len(east), row), east]) for row in north)
    return np.array([np.isfinite(tree.query(row, distance_upper_bound=reach)[0]) for row in nodes])


def limits_at(survey: Survey, points: Array) -> tuple[Array, Array]:
    """Return shoal and deep limit (m) at `points` (n, 2)."""
    low, high = np.full(len(points), -np.inf), np.full(len(points), np.inf)
    for sheet in survey.sheets:
        covered = contains(sheet.coverage, points)
        low[covered], high[covered] = -np.inf, np.inf
        for area in sheet.areas:
            inside = covered & contains(area.edges, points)
            low[inside], high[inside] = area.low, area.high
    return low, high


def relax_shoal_limits(low: Array, detail: float, resolution: float) -> Array:
    """Return shoal limits, each the least within the error of the chart's borders, so that they start inside an area.

    `low`: (rows, columns) m, inf where there is no water. A deep area, such as a dredged channel, may border on a
    shoal one. The bed may then rise towards the border: a limit that ended at a node would make a jagged cliff.
    """
    from scipy.ndimage import minimum_filter

    reach = int(BORDER_ERROR * detail / resolution + 0.5)
    soft = minimum_filter(low, 2 * reach + 1, mode="nearest") if reach else low
    return np.where(np.isinf(low), low, soft)


def move_within_limits(grid: Grid, low: Array, high: Array, soundings: Array) -> Depths:
    """Return the depths of `grid` within their limits (rows, columns), without a cliff where a limit begins.

    The correction of a node is spread to its neighbours. It fades by the factor SPREAD_PER_CELL per cell and stays
    within their limits. Nodes around a sounding get none of it, because the bed is known there.
    """
    bed = grid.depths
    low, high = low.astype(np.float32), high.astype(np.float32)
    need = np.nan_to_num(np.clip(bed, low, high) - bed)
    if need.any():
        known, bounds = nodes_around(soundings, grid), need.copy()
        for _ in range(SPREAD_PASSES):
            edge = np.pad(need, 1, mode="edge")
            mean = np.float32(0.25 * SPREAD_PER_CELL) * (
                edge[:-2, 1:-1] + edge[2:, 1:-1] + edge[1:-1, :-2] + edge[1:-1, 2:]
            )
            need = np.nan_to_num(np.clip(bed + mean, low, high) - bed)
            need[known] = bounds[known]
    return np.asarray(np.clip(bed + need, low, high), np.float32)


def nodes_around(points: Array, grid: Grid) -> Mask:
    """Return the mask of the nodes that are a corner of a cell with one of `points` (n, 2 or more) in it."""
    corners = np.zeros(grid.depths.shape, bool)
    last: Indices = np.array(corners.shape, np.intp) - 1
    scaled = (points[:, :2] - (grid.north_min, grid.east_min)) / grid.resolution
    scaled = scaled[((scaled >= 0.0) & (scaled <= last)).all(axis=1)]
    rows, columns = np.minimum(np.floor(scaled).astype(np.intp), last - 1).T
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        corners[rows + row, columns + column] = True
    return corners


def deep_limit_allowance(soundings: Array, limits: Array, north: Array, east: Array, reach: float) -> Array:
    """Return how far (m) the bed may lie below its deep limit at each node.

    That is as far as a nearby sounding lies below its own limit; it fades over `reach` m. `limits`: the deep limit at
    each sounding. Generalised charts have soundings deeper than the area around them. The sounding counts: it was
    measured, the area's limit was drawn.
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


def raise_to_soundings(grid: Grid, soundings: Array, shoal_limits: Array, low: Array, passes: int = 20) -> Grid:
    """Return the grid raised where it is deeper than a sounding between its nodes, but never above `low`.

    `shoal_limits`: the shoal limit of the area that each sounding is in. A shoal smaller than a cell contains no node.
    Around its sounding this limit replaces the limit of the deeper area that the nodes are in. Each pass distributes
    the error at a sounding over the four nodes around it, in proportion to their bilinear weights. None of them becomes
    shoaler than the sounding.
    """
    depths, low = grid.depths.copy(), low.copy()
    scaled = (soundings[:, :2] - (grid.north_min, grid.east_min)) / grid.resolution
    corners = np.floor(scaled).astype(np.intp)
    inside = ((corners >= 0) & (corners < np.array(depths.shape) - 1)).all(axis=1)
    for (i, j), limit in zip(corners[inside], shoal_limits[inside], strict=True):
        low[i : i + 2, j : j + 2] = np.minimum(low[i : i + 2, j : j + 2], limit)
    for _ in range(passes):
        excess = np.where(inside, grid._replace(depths=depths).at(soundings[:, :2]) - soundings[:, 2], 0.0)
        for index in np.flatnonzero(excess > 1e-3):  # excludes nan, which a sounding beside unknown nodes has
            (i, j), (u, v) = corners[index], scaled[index] - corners[index]
            weights, nodes, top = np.outer((1 - u, u), (1 - v, v)), depths[i : i + 2, j : j + 2], soundings[index, 2]
            for _ in range(nodes.size):  # until the others have made up for those that are as shoal as the sounding
                above = float((weights * nodes).sum()) - top  # a sounding before it may have raised some already
                share = np.where(nodes > top + 1e-3, weights, 0.0)
                if above < 1e-3 or not share.any():
                    break
                nodes -= np.minimum(above * share / (share * share).sum(), np.maximum(nodes - top, 0.0))
        np.maximum(depths, low, out=depths, where=np.isfinite(low))
    return grid._replace(depths=depths)


def raise_with_slope(
    depths: NDArray[np.floating[Any]], tops: Array, inside: Array, at_edge: Array | None = None,
    foot: Array | float = NARROW_FOOT_CELLS,
) -> Array:  # fmt: skip
    """Return `depths` (m) raised to `tops` (m) inside an edge, with a slope across the edge; nothing gets deeper.

    `inside`: distance in cells of each place from the edge, negative outside. `at_edge`: depth (m) on the edge nearest
    to each place without the slope, by default the same. `foot`: greatest width of the slope outside, cells. On the
    edge, a top above the water has its waterline; a top below the water has its full height.
    """
    rise = np.maximum((depths if at_edge is None else at_edge) - np.maximum(tops, 0.0), 0.0)
    reach = np.clip(np.sqrt(2.0 * rise / BEND), MIN_FOOT_CELLS, foot)
    outside = rise * np.clip(1.0 + inside / reach, 0.0, 1.0) ** 2
    slope = depths - np.where(inside < 0.0, outside, rise * (1.0 + 2.0 * inside / reach))
    is_top = (inside >= 0.0) & ((tops >= 0.0) | (inside > STRAIGHT_CELLS))
    return np.asarray(np.where(is_top, np.minimum(depths, tops), slope))


def raise_land(grid: Grid, bounds: Bounds, points: Array) -> Depths:
    """Return depths with land as a slope, which starts LAND_RISE above the water, or at the beach if it is higher.

    At a shore the slope of the bed goes on into the land. `points`: (n, 3) m, where the depth is known.
    """
    from scipy.ndimage import distance_transform_edt

    depths, resolution = grid.depths, grid.resolution
    land, water = bounds.land, bounds.known & ~bounds.land
    if not (land.any() or np.isfinite(bounds.shore).any()):  # a narrow mole may have no node of land
        return depths
    distance, nearest = distance_transform_edt(~water, sampling=resolution, return_indices=True)
    shore = np.minimum(depths[tuple(nearest)], -LAND_RISE)
    slope = np.maximum(shore - LAND_SLOPE * distance, np.minimum(shore, -LAND_TOP))
    raised = np.where(land, slope, depths).astype(np.float32)
    # Where land ends at the edge of its chart there is no shore, so no slope is made.
    near = (distance < (STRAIGHT_CELLS + 1.0) * resolution) & (bounds.shore < STRAIGHT_CELLS)
    edge = (water & (bounds.shore < FOOT_CELLS)) | (land & near)
    inside = np.where(land, bounds.shore, -bounds.shore)
    at_edge, beyond = _continue_bed(depths, water, inside, edge, bounds.walled)
    on_land, within = land[edge], inside[edge]
    bed = np.where(on_land, beyond, depths[edge])
    foot = _foot_cells(grid, bounds.shore, points)[edge]
    bank = raise_with_slope(bed, np.full(len(bed), -LAND_RISE), within, at_edge, foot)
    least = -LEAST_SLOPE * resolution * within  # water stays water, and land stays land
    wet = np.maximum(np.minimum(bank, bed), np.minimum(bed, least))
    raised[edge] = np.where(on_land, np.clip(bank, -LAND_TOP, least), wet)
    return raised


def steps_of(strips: list[Array], grid: Grid) -> list[tuple[Array, float]]:
    """Return the steps that are the bank of natural coasts in `strips`: rings (5, 2) m, and the depth (m) of each top.

    They descend from the water line to the depth of the bank at the outer side of its strip.
    """
    steps = []
    for ring in strips:
        reach = float(np.hypot(*(ring[3] - ring[0])))
        out = (ring[3] - ring[0]) / reach
        depth = float(grid.at((ring[2:4].mean(axis=0) + BESIDE * out)[None])[0])
        width = STEP_WIDTH * grid.resolution
        for near in np.arange(0.0, reach if depth > 0.0 else 0.0, width):  # nan: unknown
            inner, outer = near if near else -SAME_WIDTH, min(near + width, reach) + BESIDE
            steps.append((np.concatenate([ring[:2] + inner * out, ring[1::-1] + outer * out]), depth * near / reach))
    return steps


def _foot_cells(grid: Grid, shore: Depths, points: Array) -> Depths:
    """Return the greatest width (cells) of a bank at each node: between the shore and a place of known depth."""
    from scipy.ndimage import minimum_filter, uniform_filter

    allowed, size = np.full(shore.shape, FOOT_CELLS, np.float32), 2 * SPREAD_CELLS + 1
    known = nodes_around(points[points[:, 2] > 0.0], grid)
    allowed[known] = np.clip(shore[known], NARROW_FOOT_CELLS, FOOT_CELLS)
    return np.asarray(uniform_filter(minimum_filter(allowed, size), size))


def _continue_bed(depths: Depths, water: Mask, inside: Depths, edge: Mask, walled: Mask) -> tuple[Array, Array]:
    """Return, for the nodes of `edge`, the depth (m) at the nearest place of the edge and, beyond it, at the node.

    Both are on a plane through the bed around that place, and on the same side of the mole if it is `walled`.
    `inside`: distance (cells) inside the edge.
    """
    nodes, last = np.argwhere(edge), np.array(edge.shape) - 1

    def at(field: NDArray[Any], places: Indices) -> NDArray[Any]:
        return np.asarray(field[tuple(np.clip(places, 0, last).T)])

    steps = np.eye(2, dtype=np.intp)
    with np.errstate(invalid="ignore"):  # the distance may be inf
        across = np.stack([at(inside, nodes + step) - at(inside, nodes - step) for step in steps], axis=1)
    across = np.nan_to_num(across, posinf=0.0, neginf=0.0).astype(float)
    across /= np.maximum(np.hypot(*across.T), 1e-9)[:, None]
    foot = nodes - inside[edge][:, None] * across
    middle, is_walled = np.rint(foot).astype(np.intp), walled[edge]
    least = np.diag([1e-9, 1e-3, 1e-3])  # makes the plane level where too few nodes give a slope
    sums, right = np.tile(least, (len(nodes), 1, 1)), np.zeros((len(nodes), 3))
    for offset in np.ndindex(2 * PLANE_CELLS + 1, 2 * PLANE_CELLS + 1):
        place = middle + np.array(offset) - PLANE_CELLS
        apart = np.column_stack([np.ones(len(nodes)), place - foot])
        found = at(depths, place).astype(float)
        weight = np.exp(-0.5 * ((apart[:, 1:] / PLANE_SPREAD) ** 2).sum(axis=1)) * np.isfinite(found)
        weight *= at(water, place) & (at(walled, place) == is_walled)
        sums += weight[:, None, None] * apart[:, :, None] * apart[:, None, :]
        right += (weight * np.nan_to_num(found))[:, None] * apart
    plane = np.linalg.solve(sums, right[:, :, None])[:, :, 0]
    return plane[:, 0], plane[:, 0] + (plane[:, 1:] * (nodes - foot)).sum(axis=1)

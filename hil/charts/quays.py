"""Let the bed reach up to quay walls at its full depth: the wall is an obstacle, and the bed has no bank before it.

A bank over a few cells of a grid, which is straight at the water line, has ripples between its nodes where it is
oblique to the grid. Land as wide as a few cells behind a wall becomes water, so that the step of the bed up to the land
is hidden behind the wall. A mole that is narrower, with walls on both sides, becomes blocks that stand on the bed.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, Mask, contains, edge_distance
from hil.charts.sources.survey import Survey

Array = NDArray[np.float64]

ON_WALL = 0.6  # m: greatest distance of an edge of land from the wall along it, which is simplified
SMALLEST = 0.5  # m: side of a block for a part of a mole; the obstacles of its walls cover narrower ones
BESIDE = 0.05  # m from an edge, where its land and its water begin
BEHIND = 2.0  # cells behind a wall that become water
LAND_DEPTHS = (1.5, 3.0, 4.5)  # cells behind a wall that are land; of a narrower mole all sides have to be walls
NARROW_MOLES = (
    "the other side of each is no wall, so their bed is a bank with ripples of up to 0.6 m; a finer --resolution makes "
    "them quays"
)


def wall_outline(survey: Survey) -> Any:
    """Return the strip around all walls of `survey`, a prepared geometry; None without walls."""
    import shapely

    lines = [shapely.LineString(hazard.line) for hazard in survey.hazards if hazard.is_wall and len(hazard.line) > 1]
    if not lines:
        return None
    strip = shapely.union_all([line.buffer(ON_WALL) for line in lines])
    shapely.prepare(strip)
    return strip


def find_quays(
    strip: Any, start: Array, end: Array, north: Array, east: Array, land: Mask, water: Mask
) -> tuple[Mask, Mask]:
    """Return which edges of land, (n, 2) each, are quays, and which are walls of land that is too narrow for that.

    Both are in `strip` and have water before them; quays have wide land behind.
    """
    import shapely

    if strip is None or not len(start):
        return np.zeros(len(start), bool), np.zeros(len(start), bool)
    on_wall = shapely.covers(strip, shapely.linestrings(np.stack([start, end], axis=1)))
    middle, along, cell = 0.5 * (start + end), end - start, north[1] - north[0]
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]

    def there(mask: Mask, cells: float) -> Mask:
        nodes = np.rint((middle + cells * cell * across - (north[0], east[0])) / cell).astype(np.intp)
        inside = ((nodes >= 0) & (nodes < mask.shape)).all(axis=1)
        return np.asarray(inside & mask[tuple(np.clip(nodes, 0, np.array(mask.shape) - 1).T)])

    is_quay, at_water = np.zeros((2, len(start)), bool)
    for side in (1.0, -1.0):
        behind, before = [there(land, side * cells) for cells in LAND_DEPTHS], there(water, -side * LAND_DEPTHS[0])
        is_quay |= on_wall & np.logical_and.reduce(behind) & before
        at_water |= on_wall & before
    return is_quay, at_water & ~is_quay


def find_moles(
    strip: Any, start: Array, end: Array, at_wall: Mask, land: Edges, cell: float
) -> tuple[Mask, list[Array]]:
    """Return which edges of land, (n, 2) each, are of moles with walls on both sides, and rectangles (5, 2) for them.

    `at_wall`: the edges in question, at walls; `cell`: m of the grid. A rectangle reaches from an edge to the other
    side of the mole, where it is narrowest. Short edges at its head have none.
    """
    import shapely

    is_mole, (index,) = np.zeros(len(start), bool), np.nonzero(at_wall)
    start, end, edges = start[index], end[index], np.stack([start, end], axis=1)
    along = end - start
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    inward = np.where(contains(land, 0.5 * (start + end) + BESIDE * across)[:, None], across, -across)
    feet = np.stack([start + share * along for share in (0.1, 0.5, 0.9)])
    rays = shapely.linestrings(np.stack([feet + BESIDE * inward, feet + LAND_DEPTHS[-1] * cell * inward], axis=2))
    lines = shapely.linestrings(edges)
    ray, line = shapely.STRtree(lines).query(rays.ravel(), "intersects")
    widths = np.full(rays.size, np.inf)
    met = shapely.intersection(rays.ravel()[ray], lines[line])
    np.minimum.at(widths, ray, shapely.distance(shapely.points(feet.reshape(-1, 2)[ray]), met))
    widths = np.where(np.isfinite(widths), widths, -1e9).reshape(rays.shape)  # nothing of it is a wall there
    if strip is not None:
        far_sides = shapely.points(feet + widths[..., None] * inward)
        is_mole[index] = shapely.covers(strip, far_sides).all(axis=0)
    offset = widths.min(axis=0)[:, None] * inward
    has_size = is_mole[index] & (widths.min(axis=0) > SMALLEST) & (np.hypot(*along.T) > SMALLEST)
    rings = list(np.stack([start, end, end + offset, start + offset, start], axis=1)[has_size])
    heads = at_wall & (np.hypot(*(edges[:, 1] - edges[:, 0]).T) < LAND_DEPTHS[-1] * cell)
    corners = edges @ (1.0, 1.0j)
    while (more := heads & ~is_mole & np.isin(corners, corners[is_mole]).any(axis=1)).any():
        is_mole |= more
    return is_mole, rings


def clear_behind(
    start: Array, end: Array, north: Array, east: Array, bounds: tuple[NDArray[Any], ...], free: Mask
) -> None:
    """Make the land behind the quays (edges, (n, 2) each) water within the limits of the water before them.

    `bounds`: limits, masks and distances as hil.charts.bounds has them. Only where `free`, and not near another shore.
    """
    from scipy.ndimage import distance_transform_edt

    window, away = edge_distance(start, end, north, east)
    low, high, land, known, shore = (part[window] for part in bounds)
    behind = land & (away < BEHIND) & (shore > BEHIND) & free[window]
    if behind.any():
        rows, columns = distance_transform_edt(land | ~known, return_distances=False, return_indices=True)
        nearest = rows[behind], columns[behind]
        low[behind], high[behind], land[behind] = low[nearest], high[nearest], False

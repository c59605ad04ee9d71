"""Let the bed reach up to quay walls at its full depth: the wall is an obstacle, and the bed has no bank before it.

A bank over a few cells of a grid, which is straight at the water line, has ripples between its nodes where it is
oblique to the grid. Land as wide as a few cells behind a wall becomes water, so that the step of the bed up to the land
is hidden behind the wall. A mole that is narrower becomes blocks that stand on the bed. If its other side is a natural
coast, that coast has its bank. Where the grid has no room for both, steps take the place of the bank.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, Mask, Window, contains, edge_distance
from hil.charts.sources.survey import Survey

Array = NDArray[np.float64]

ON_WALL = 0.6  # m: greatest distance of an edge of land from the wall along it, which is simplified
SMALLEST = 0.5  # m: side of a block for a part of a mole; the obstacles of its walls cover narrower ones
SAME_WIDTH = 0.5  # m: greatest difference of the widths of a mole in one block
LONGEST = 4  # cells along a natural coast that have the same steps
BESIDE = 0.05  # m from an edge, where its land and its water begin
BEHIND = 2.0  # cells behind a wall that become water
NARROW = 4.5  # cells, width of land with walls on both sides up to which it is a mole
WIDE = 9.0  # cells, the same with a natural coast on one side, whose bank would reach through it
DIAGONAL = 1.5  # cells behind a wall, over which a cell with water before the wall reaches
FEET = (0.1, 0.5, 0.9)  # shares of a piece of an edge from which rays lead across the land


class Coasts(NamedTuple):
    """Pieces of the edges of land, at most a cell long near walls: `start`, `end`, (n, 2) each, and masks of them.

    - `quay`: wall of wide land.
    - `mole`: wall of a mole with walls on both sides.
    - `single`: wall of a mole with a natural coast on the other side.
    - `opposite`: that coast.
    - `width`: m of the land behind each piece, inf from WIDE on; `inward` (n, 2): the unit vectors towards the land.
    - `edge`: (n,) index of the edge that each piece is of.
    """

    start: Array
    end: Array
    quay: Mask
    mole: Mask
    single: Mask
    opposite: Mask
    width: Array
    inward: Array
    edge: NDArray[np.intp]


def wall_outline(survey: Survey) -> Any:
    """Return the strip around all walls of `survey`, a prepared geometry; None without walls."""
    import shapely

    lines = [shapely.LineString(hazard.line) for hazard in survey.hazards if hazard.is_wall and len(hazard.line) > 1]
    if not lines:
        return None
    strip = shapely.union_all([line.buffer(ON_WALL) for line in lines])
    shapely.prepare(strip)
    return strip


def find_coasts(strip: Any, start: Array, end: Array, land: Edges, cell: float) -> Coasts:
    """Return what each edge of `land`, (n, 2), is by the walls in `strip`; `cell`: m of the grid."""
    import shapely

    lines = shapely.linestrings(np.stack([start, end], axis=1))
    near, tree = np.zeros(len(start), bool), shapely.STRtree(lines)
    if strip is not None:
        near[tree.query(lines[shapely.intersects(strip, lines)], "dwithin", (WIDE + 1.0) * cell)[1]] = True
    counts = np.where(near, np.maximum(1, np.ceil(np.hypot(*(end - start).T) / cell)), 1).astype(np.intp)
    edge = np.repeat(np.arange(len(start)), counts)
    part = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = ((end - start) / counts[:, None])[edge]
    first = start[edge] + part[:, None] * along
    quay, mole, single, opposite = np.zeros((4, len(edge)), bool)
    width, inward = np.full(len(edge), np.inf), np.zeros((len(edge), 2))
    coasts = Coasts(first, first + along, quay, mole, single, opposite, width, inward, edge)
    (index,) = np.nonzero(near[edge])
    if not len(index):
        return coasts
    pieces = np.stack([coasts.start, coasts.end], axis=1)
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    (judged,) = np.nonzero(near)
    is_left = np.zeros(len(start), bool)
    sides = across[np.cumsum(counts) - counts][judged]
    is_left[judged] = contains(land, 0.5 * (start + end)[judged] + BESIDE * sides)
    inward[:] = np.where(is_left[edge][:, None], across, -across)
    feet = first[index] + np.array(FEET)[:, None, None] * along[index]
    widths, far_sides = _cross(tree, feet, inward[index], WIDE * cell)
    on_wall = shapely.covers(strip, shapely.linestrings(pieces[index]))
    is_far_wall = shapely.covers(strip, shapely.points(far_sides)) | ~np.isfinite(widths)
    width[index] = widths.min(axis=0)
    has_walls, is_narrow = is_far_wall.all(axis=0), width[index] < NARROW * cell
    quay[index], mole[index] = on_wall & has_walls & ~is_narrow, on_wall & has_walls & is_narrow
    single[index] = on_wall & ~has_walls
    walls = shapely.STRtree(shapely.linestrings(pieces[single]))
    is_opposite = np.zeros(widths.size, bool)
    is_opposite[walls.query(shapely.points(far_sides).ravel(), "dwithin", ON_WALL)[0]] = True
    opposite[index] = ~on_wall & (is_opposite.reshape(widths.shape) & np.isfinite(widths)).any(axis=0)
    return coasts


def _cross(tree: Any, feet: Array, directions: Array, reach: float) -> tuple[Array, Array]:
    """Return how far (m) it is from `feet` (k, n, 2) in `directions` (n, 2) to a line of `tree`, and where that is.

    The distances, (k, n), are inf from `reach` on.
    """
    import shapely

    rays = shapely.linestrings(np.stack([feet + BESIDE * directions, feet + reach * directions], axis=2)).ravel()
    ray, line = tree.query(rays, "intersects")
    distances = np.full(rays.size, np.inf)
    met = shapely.intersection(rays[ray], tree.geometries[line])
    np.minimum.at(distances, ray, shapely.distance(shapely.points(feet.reshape(-1, 2)[ray]), met))
    distances = distances.reshape(feet.shape[:2])
    return distances, feet + np.where(np.isfinite(distances), distances, 0.0)[..., None] * directions


def blocks_of(coasts: Coasts, cell: float) -> list[Array]:
    """Return rectangles, (5, 2) m each, for narrow moles: from a wall to the other side, where the mole is narrowest.

    Towards a natural coast they reach no further than the bed behind the wall is water. A mole has none where it is
    smaller than SMALLEST.
    """
    width = np.where(coasts.single, np.minimum(coasts.width, 2.0 * _room(coasts, cell)), coasts.width)
    rings = [
        _rectangle(coasts, run, float(width[run].min())) for run in _runs(coasts, coasts.mole | coasts.single, width)
    ]
    return [ring for ring in rings if min(np.hypot(*np.diff(ring[:3], axis=0).T)) > SMALLEST]


def _runs(coasts: Coasts, chosen: Mask, width: Array, most: float = np.inf) -> list[list[int]]:
    """Return the `chosen` pieces in lists of at most `most` neighbours on one edge that have about the same `width`."""
    runs: list[list[int]] = []
    for piece in np.flatnonzero(chosen).tolist():
        run = runs[-1] if runs else [piece]
        follows = piece == run[-1] + 1 and coasts.edge[piece] == coasts.edge[run[0]] and len(run) < most
        if follows and np.ptp(width[[*run, piece]]) < SAME_WIDTH:
            run.append(piece)
        else:
            runs.append([piece])
    return runs


def _rectangle(coasts: Coasts, run: list[int], width: float) -> Array:
    """Return the rectangle (5, 2) on a run of pieces, `width` m to the land, or to the water if negative.

    It is longer by BESIDE at both ends, so that there is no gap before the next one.
    """
    inward = coasts.inward[run[0]]
    along, across = BESIDE * np.array([-inward[1], inward[0]]), width * inward
    ends = coasts.start[run[0]], coasts.end[run[-1]]
    sense = np.sign((ends[1] - ends[0]) @ along)
    start, end = ends[0] - sense * along, ends[1] + sense * along
    return np.array([start, end, end + across, start + across, start])


def strips_of(coasts: Coasts, cell: float) -> list[Array]:
    """Return strips of natural coasts opposite walls, rectangles (5, 2) m, first the two ends of their coasts.

    In them nodes of the grid have the depth before the wall, so that the grid has no bank there.
    """
    reach = 2.0 * _room(coasts, cell) - coasts.width
    runs = _runs(coasts, coasts.opposite & (reach > BESIDE), reach, LONGEST)
    return [_rectangle(coasts, run, -float(reach[run].max())) for run in runs]


def _room(coasts: Coasts, cell: float) -> Array:
    """Return how far (m) a cell of the grid reaches across each piece."""
    return np.asarray(cell * np.abs(coasts.inward).sum(axis=1))


def clear_behind(coasts: Coasts, north: Array, east: Array, bounds: tuple[NDArray[Any], ...], free: Mask) -> None:
    """Make the land behind quays, and moles with walls around them, water within the limits of the water before them.

    `bounds`: limits, masks and distances as hil.charts.bounds has them. Only where `free`, and not near another shore.
    """
    is_hidden = coasts.quay | coasts.mole
    window, away = edge_distance(coasts.start[is_hidden], coasts.end[is_hidden], north, east)
    low, high, land, known, shore = (part[window] for part in bounds)
    behind = land & (away < BEHIND) & (shore > BEHIND) & free[window]
    if behind.any():
        nearest = _nearest(known & ~land, behind)
        low[behind], high[behind], land[behind] = low[nearest], high[nearest], False


def _nearest(of: Mask, to: Mask) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return row and column of the nearest node in `of` for each node in `to`."""
    from scipy.ndimage import distance_transform_edt

    rows, columns = distance_transform_edt(~of, return_distances=False, return_indices=True)
    return rows[to], columns[to]


def find_walled(coasts: Coasts, north: Array, east: Array, reach: int) -> tuple[Window, Array, Mask]:
    """Return the distance in cells of nodes from natural coasts opposite walls, and which are on the walls' side.

    The distance is exact up to `reach` cells. A node is on the walls' side if a wall is between it and the nearest
    place of the coast. The window is that of both results.
    """
    import shapely

    window, away = edge_distance(coasts.start[coasts.opposite], coasts.end[coasts.opposite], north, east, reach)
    is_walled = np.zeros(away.shape, bool)
    if coasts.opposite.any():
        lines = shapely.linestrings(np.stack([coasts.start, coasts.end], axis=1))
        near = np.argwhere(away < reach)
        nodes = shapely.points(np.column_stack([north[window[0]][near[:, 0]], east[window[1]][near[:, 1]]]))
        facing, walls = lines[coasts.opposite], lines[coasts.quay | coasts.mole | coasts.single]
        ways = shapely.shortest_line(nodes, facing[shapely.STRtree(facing).nearest(nodes)])
        way, _ = shapely.STRtree(walls).query(ways, "intersects")
        is_walled[tuple(near[way].T)] = True
    return window, away, is_walled


def clear_single(coasts: Coasts, north: Array, east: Array, bounds: tuple[NDArray[Any], ...], free: Mask) -> None:
    """Give the nodes behind walls opposite natural coasts the limits of the water before them.

    These are the nodes of cells with water before such a wall, land or water. They join those on the walls' side.
    `bounds`, `free`: as of clear_behind.
    """
    from scipy.ndimage import binary_dilation

    window, away = edge_distance(coasts.start[coasts.single], coasts.end[coasts.single], north, east)
    low, high, land, known, shore, walled = (part[window] for part in bounds)
    before = walled & known & ~land & (away < DIAGONAL)
    behind = binary_dilation(before, np.ones((3, 3))) & ~walled & (away < DIAGONAL) & free[window]
    if behind.any():
        nearest = _nearest(before, behind)
        low[behind], high[behind] = low[nearest], high[nearest]
        land[behind], known[behind], shore[behind], walled[behind] = False, True, np.inf, True

"""Obstructions, wrecks, rocks, piles, islets, structures, buildings, marks and what floats, of a chart.

A chart gives most of them as points, without a size. The radii and draughts here are ours, on the large side of what
such things measure. Where no depth is given, WATLEV gives the water's level relative to them. Of shore constructions,
causeways and dams the parts with water on both sides stand in it: piers and moles; the others are the land's edge.
Structures and what floats keep their outline, an area as a rectangle where that has about the same size.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, edge_distance, fill, segments
from hil.charts.bounds import banked, limits_at
from hil.charts.charted import BottomGrid, Charted
from hil.charts.grid import Grid
from hil.charts.gridding import Surface
from hil.charts.sources.s57 import Feature
from hil.charts.sources.survey import Hazard, Survey, first_in_cell
from sim.environment.obstacles import STANDING, Box, Cylinder

Array = NDArray[np.float64]

RADII = {
    "OBSTRN": 2.0, "WRECKS": 8.0, "UWTROC": 2.0, "PILPNT": 0.4, "PYLONS": 3.0, "MORFAC": 1.0, "LNDARE": 5.0,
    "SLCONS": 1.0, "CAUSWY": 3.0, "DAMCON": 3.0, "PONTON": 1.0, "HULKES": 4.0, "FLODOC": 4.0,
    "OFSPLF": 5.0, "GATCON": 1.0, "DYKCON": 3.0, "FSHFAC": 0.5, "LOGPON": 1.0, "OILBAR": 0.5, "LITVES": 4.0,
    "LITFLT": 2.0, "LNDMRK": 2.0, "BUISGL": 3.0,
    **dict.fromkeys(("BCNCAR", "BCNISD", "BCNLAT", "BCNSAW", "BCNSPP"), 0.3),
    **dict.fromkeys(("BOYCAR", "BOYINB", "BOYISD", "BOYLAT", "BOYSAW", "BOYSPP"), 1.0),
}  # fmt: skip
DRAUGHTS = {
    "PONTON": 1.0, "HULKES": 4.0, "FLODOC": 5.0, "LOGPON": 1.0, "OILBAR": 1.0, "LITVES": 3.0, "LITFLT": 2.0,
    **{kind: 1.0 for kind in RADII if kind.startswith("BOY")},
}  # m  # fmt: skip
DRAUGHT = 1.0  # m, of others that float
STRUCTURES = {"SLCONS", "CAUSWY", "DAMCON", "DYKCON", "GATCON"}
MOORING_BUOY = 7.0  # S-57 appendix A, attribute 40 (CATMOR)
OUT_OF_WATER = -100.0  # as sim.environment.obstacles has it
STANDS_UP = {
    "PILPNT",
    "PYLONS",
    "MORFAC",
    "LNDARE",
    "OFSPLF",
    "FSHFAC",
    "LNDMRK",
    "BUISGL",
    *(kind for kind in RADII if kind.startswith("BCN")),
    *STRUCTURES,
}  # they come out of the water unless WATLEV states otherwise
# Always under water (WATLEV 3) does not state how deep. The others (S-57 appendix A, attribute 187):
# partly submerged at high water, always dry, covers and uncovers, awash.
TOPS = {1.0: OUT_OF_WATER, 2.0: OUT_OF_WATER, 4.0: 0.0, 5.0: 0.0}
FLOATING = 7.0
BURIED = 0.01  # m: what rises less is not there
RECTANGULAR = 0.6  # share of its rectangle that an area must have to be one
SIMPLER = 0.5  # m that the line of a structure may be off what the chart draws
LEAST_HEIGHT = 1.0  # m above the bed of what is only known to be there


class Placed(NamedTuple):
    """Result of placing hazards: obstacles for a world, and the grid with risen areas; and what else was charted."""

    grid: Grid
    cylinders: tuple[Cylinder, ...]
    boxes: tuple[Box, ...]
    charted: Charted = Charted()
    bottom: BottomGrid | None = None


def hazards_of(feature: Feature, points: Array, edges: Edges) -> list[Hazard]:
    """Return the hazards that one object is, its `points` and `edges` on the plane; none for land and fisheries."""
    if feature.kind not in RADII or (feature.kind in {"LNDARE", "FSHFAC"} and feature.is_area):
        return []
    top, radius, bottom, is_structure = _top(feature), RADII[feature.kind], STANDING, feature.kind in STRUCTURES
    floats = feature.number("WATLEV") == FLOATING or feature.number("CATMOR") == MOORING_BUOY
    if floats or feature.kind in DRAUGHTS:
        top, bottom = OUT_OF_WATER, DRAUGHTS.get(feature.kind, DRAUGHT)
    if feature.is_area:
        line = np.concatenate([np.empty((0, 2)), *edges])
        return [Hazard(feature.kind, line, radius, top, edges, bottom, is_structure)] if edges else []
    lines = [_simplified(line) for line in edges] if is_structure or bottom < STANDING else edges
    places = [points[i : i + 1] for i in range(len(points))]
    return [Hazard(feature.kind, line, radius, top, (), bottom, is_structure) for line in (*places, *lines)]


def _simplified(line: Array) -> Array:
    from shapely import LineString

    return np.asarray(LineString(line).simplify(SIMPLER).coords) if len(line) > 2 else line


def _top(feature: Feature) -> float | None:
    depth, level = feature.number("VALSOU"), feature.number("WATLEV")
    if depth is not None:
        return depth
    if level in TOPS:
        return TOPS[level]
    return OUT_OF_WATER if feature.kind in STANDS_UP and level is None else None


def place(hazards: tuple[Hazard, ...], grid: Grid, shoal_limit: Array) -> Placed:
    """Stand `hazards` on the bed of `grid`; one without a known top reaches up to `shoal_limit`, (rows, columns).

    That is what a chart system assumes (IHO S-52, procedure DEPVAL). Left out: what is on land, off the grid or
    below the bed.
    """
    grid = grid._replace(depths=grid.depths.copy())
    limit = Grid(shoal_limit.astype(np.float32), *grid[1:])
    standing = [hazard for hazard in hazards if not _raise_bed(hazard, grid, shoal_limit)]
    cylinders: list[Cylinder] = []
    boxes: list[Box] = []
    for hazard in standing:
        if hazard.edges and (hazard.banks or hazard.bottom < STANDING):
            boxes += _outlined(hazard, grid, limit)
        elif len(hazard.line) == 1 or hazard.edges:
            cylinders += _cylinder(hazard, grid, limit)
        else:
            boxes += _boxes(hazard, grid, limit)
    return Placed(grid, tuple(cylinders), tuple(boxes))


def beds_under(survey: Survey, soundings: Array, surface: Surface) -> Array:
    """Return a bed, (n, 3) north, east, depth, for each hazard of known depth that `surface` would bury.

    Whatever stands there has its foot below its top. A sounding as near as the chart is drawn is the bed instead.
    """
    from scipy.spatial.distance import cdist

    known = [
        (*hazard.line.mean(axis=0), hazard.top)
        for hazard in survey.hazards
        if hazard.top is not None
        and hazard.top > 0.0
        and hazard.bottom == STANDING
        and (len(hazard.line) == 1 or hazard.edges)
    ]
    if not known:
        return np.empty((0, 3))
    tops = np.array(known)
    tops = tops[np.argsort(-tops[:, 2], kind="stable")]  # of two in one place the deeper
    tops = tops[first_in_cell(tops, max(survey.detail, BURIED))]
    sounded = cdist(tops[:, :2], soundings[:, :2]).min(axis=1) < survey.detail
    low, _ = limits_at(survey, tops[:, :2])
    bed = np.maximum(surface.at(tops[:, :2]), low)
    buried = tops[~sounded & (bed < tops[:, 2] + BURIED)]
    return np.asarray(buried + np.array([0.0, 0.0, LEAST_HEIGHT]))


def _raise_bed(hazard: Hazard, grid: Grid, shoal_limit: Array) -> bool:
    """Raise the bed of `grid` to the top of an area; False for what floats, has no area, or none that holds a node."""
    if hazard.bottom < STANDING:
        return False
    (rows, columns), away = edge_distance(*segments(hazard.edges), grid.north, grid.east)
    inside, (part, held) = np.full(away.shape, -1.0), fill(hazard.edges, grid.north[rows], grid.east[columns])
    if not held.any():
        return False
    inside[part][held] = 1.0
    bed = grid.depths[rows, columns]
    top = np.maximum(shoal_limit[rows, columns] if hazard.top is None else hazard.top, -LEAST_HEIGHT)
    bed[:] = banked(bed, top, inside * away)
    return True


def _height(hazard: Hazard, place: Array, grid: Grid, limit: Grid) -> float | None:
    """Return the depth of its top at `place` (2,), None where it does not stand in water."""
    bed, shoal = (float(g.at(place[None])[0]) for g in (grid, limit))
    if not bed > 0.0:  # nan, too
        return None
    if hazard.top is not None:
        return hazard.top if hazard.top < bed - BURIED else None
    highest = bed - LEAST_HEIGHT
    return max(0.0, min(shoal, highest) if np.isfinite(shoal) else highest)


def _cylinder(hazard: Hazard, grid: Grid, limit: Grid) -> list[Cylinder]:
    """Return a point, or an area smaller than a cell of the grid."""
    middle = hazard.line.mean(axis=0)
    top = _height(hazard, middle, grid, limit)
    radius = max(hazard.radius, float(np.hypot(*(hazard.line - middle).T).max()))
    if top is None:
        return []
    north, east, radius, top = _rounded(*middle, radius, top)
    return [Cylinder(north, east, radius, top, bottom=hazard.bottom)]


def _boxes(hazard: Hazard, grid: Grid, limit: Grid) -> list[Box]:
    """Return a line, piece by piece."""
    boxes = []
    for start, end in zip(hazard.line[:-1], hazard.line[1:], strict=True):
        middle, along = 0.5 * (start + end), end - start
        top = _height(hazard, middle, grid, limit)
        length, heading = float(np.hypot(*along)), float(np.arctan2(along[1], along[0]))
        if top is not None and length > 0.0 and (not hazard.banks or _is_between_waters(middle, along, hazard, grid)):
            size = length + 2.0 * hazard.radius
            north, east, size, width, heading, top = _rounded(*middle, size, 2.0 * hazard.radius, heading, top)
            boxes.append(Box(north, east, size, width, heading, top, bottom=hazard.bottom))
    return boxes


def _is_between_waters(middle: Array, along: Array, hazard: Hazard, grid: Grid) -> bool:
    """True if a cell away from a piece of a line there is water on either side."""
    across = np.array([-along[1], along[0]]) / np.hypot(*along) * (hazard.radius + grid.resolution)
    return bool((grid.at(np.stack([middle - across, middle + across])) > 0.0).all())


def _outlined(hazard: Hazard, grid: Grid, limit: Grid) -> list[Box]:
    """Return an area as a rectangle where it is about one, else its outline, piece by piece."""
    from shapely import LineString, polygonize

    boxes: list[Box] = []
    for polygon in polygonize([LineString(edge) for edge in hazard.edges]).geoms:
        rectangle = polygon.minimum_rotated_rectangle
        if polygon.area < RECTANGULAR * rectangle.area:
            ring = hazard._replace(line=_simplified(np.asarray(polygon.exterior.coords)), banks=False)
            boxes += _boxes(ring, grid, limit)
            continue
        corners = np.asarray(rectangle.exterior.coords)
        sides = np.diff(corners[:3], axis=0)
        size, width = np.hypot(*sides.T)
        top = _height(hazard, corners[:4].mean(axis=0), grid, limit)
        if top is not None:
            heading = float(np.arctan2(sides[0, 1], sides[0, 0]))
            north, east, size, width, heading, top = _rounded(*corners[:4].mean(axis=0), size, width, heading, top)
            boxes.append(Box(north, east, size, width, heading, top, bottom=hazard.bottom))
    return boxes


def _rounded(*values: float) -> tuple[float, ...]:
    return tuple(round(float(value), 3) for value in values)

"""Obstacles of a chart: obstructions, wrecks, rocks, piles, islets, structures, buildings, marks and floating objects.

A chart gives most of them as points without a size: sources/objects.toml has their radii and draughts. Where a chart
gives no depth, WATLEV (water level effect) says whether the object is above the water. Of shore constructions,
causeways and dams only the parts with water on both sides become obstacles (piers and moles); the rest is the edge of
land. Structures and floating objects have their charted outline; an area becomes a rectangle of about the same size
where possible. Areas on the bed raise it, except for rectangles with walls, which are blocks.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges, edge_distance, fill, segments
from hil.charts.bounds import limits_at, raise_with_slope
from hil.charts.charted_objects import BottomGrid, ChartedObjects
from hil.charts.grid import Grid
from hil.charts.gridding import Surface
from hil.charts.sources.s57 import Feature
from hil.charts.sources.s57_process import OBJECTS
from hil.charts.sources.survey import Hazard, Survey, first_in_cell
from sim.environment.obstacles import STANDING, Box, Cylinder

Array = NDArray[np.float64]

DRAUGHT = 1.0  # m, of other floating objects
SLOPES = (8.0, 9.0, 12.0, 13.0, 17.0)  # CATSLC (attribute 60): rip rap, revetment, ramp, slipway, log ramp
MOORING_BUOY = 7.0  # S-57 appendix A, attribute 40 (CATMOR)
OUT_OF_WATER = -100.0  # m: depth of a top above the water, as in sim.environment.obstacles
# Depths of tops by WATLEV (S-57 appendix A, attribute 187): 1 partly submerged at high water, 2 always dry, 4 covers
# and uncovers, 5 awash. 3, always under water, gives no depth.
TOPS = {1.0: OUT_OF_WATER, 2.0: OUT_OF_WATER, 4.0: 0.0, 5.0: 0.0}
FLOATING = 7.0
BURIED = 0.01  # m: an object that rises less above the bed is left out
RECTANGULAR = 0.6  # least share of its bounding rectangle that an area fills to become a rectangle
SIMPLIFIED = 0.5  # m: greatest deviation of a simplified line from the charted one
QUAY_DEPTH = 0.5  # m of water on a wall's line, from which it is a quay and not the top of a bank
FAR_CELLS = 10.0  # from the edge of an area, beyond its slope on either side
MIN_HEIGHT = 1.0  # m above the bed, of objects without a known height


class SeabedModel(NamedTuple):
    """The seabed of a world: grid of depths, obstacles, other charted objects, and the nature of the bed."""

    grid: Grid
    cylinders: tuple[Cylinder, ...]
    boxes: tuple[Box, ...]
    charted: ChartedObjects = ChartedObjects()
    bottom: BottomGrid | None = None


def hazards_of(feature: Feature, points: Array, edges: Edges) -> list[Hazard]:
    """Return the hazards of one chart object, with `points` and `edges` on the plane; none for land and fisheries."""
    traits = OBJECTS[feature.kind]
    if "radius" not in traits or (feature.kind in {"LNDARE", "FSHFAC"} and feature.is_area):
        return []
    top, radius, bottom, is_structure = _top(feature), traits["radius"], STANDING, "is_structure" in traits
    floats = feature.number("WATLEV") == FLOATING or feature.number("CATMOR") == MOORING_BUOY
    if floats or "draught" in traits:
        top, bottom = OUT_OF_WATER, traits.get("draught", DRAUGHT)
    is_wall = feature.kind == "SLCONS" and top == OUT_OF_WATER and feature.number("CATSLC") not in SLOPES
    if feature.is_area:
        line = np.concatenate([np.empty((0, 2)), *edges])
        return [Hazard(feature.kind, line, radius, top, edges, bottom, is_structure, is_wall)] if edges else []
    lines = [_simplified(line) for line in edges] if is_structure or bottom < STANDING else edges
    places = [points[i : i + 1] for i in range(len(points))]
    return [Hazard(feature.kind, line, radius, top, (), bottom, is_structure, is_wall) for line in (*places, *lines)]


def _simplified(line: Array) -> Array:
    from shapely import LineString

    return np.asarray(LineString(line).simplify(SIMPLIFIED).coords) if len(line) > 2 else line


def _top(feature: Feature) -> float | None:
    depth, level = feature.number("VALSOU"), feature.number("WATLEV")
    if depth is not None:
        return depth
    if level in TOPS:
        return TOPS[level]
    return OUT_OF_WATER if "stands_up" in OBJECTS[feature.kind] and level is None else None


def place_hazards(
    hazards: tuple[Hazard, ...], grid: Grid, shoal_limit: Array, blocks: Sequence[tuple[Array, float]] = ()
) -> SeabedModel:
    """Return the seabed with `hazards` on the bed of `grid`; areas raise the bed, other hazards become obstacles.

    A hazard without a known top reaches up to `shoal_limit` (rows, columns), as a chart display assumes (IHO S-52,
    procedure DEPVAL). Hazards on land, outside the grid or below the bed are left out. `blocks`: corners of rectangles
    (4 or more, 2) that stand for land or bed, each with the depth of its top.
    """
    grid = grid._replace(depths=grid.depths.copy())
    limit = Grid(shoal_limit.astype(np.float32), *grid[1:])
    standing = [hazard for hazard in hazards if not _raise_bed(hazard, grid, shoal_limit)]
    cylinders: list[Cylinder] = []
    on_grid = [np.isfinite(grid.at(corners[:4].mean(axis=0)[None])[0]) for corners, _ in blocks]
    boxes = [_rectangular(*block) for block, is_known in zip(blocks, on_grid, strict=True) if is_known]
    for hazard in standing:
        if hazard.edges and (hazard.needs_water_both_sides or hazard.bottom < STANDING):
            boxes += _outlined(hazard, grid, limit)
        elif len(hazard.line) == 1 or hazard.edges:
            cylinders += _cylinder(hazard, grid, limit)
        else:
            boxes += _boxes(hazard, grid, limit)
    return SeabedModel(grid, tuple(cylinders), tuple(boxes))


def beds_under(survey: Survey, soundings: Array, surface: Surface) -> Array:
    """Return a point of the bed, (n, 3) north, east, depth, for each hazard of known depth that `surface` would bury.

    The point is MIN_HEIGHT below the top of the hazard. None is returned where a sounding within the chart's detail
    gives the bed.
    """
    from scipy.spatial.distance import cdist

    standing = [each for each in survey.hazards if each.bottom == STANDING and (len(each.line) == 1 or each.edges)]
    known = [(*each.line.mean(axis=0), each.top) for each in standing if each.top is not None and each.top > 0.0]
    if not known:
        return np.empty((0, 3))
    tops = np.array(known)
    tops = tops[np.argsort(-tops[:, 2], kind="stable")]  # of several at one position, use the deepest
    tops = tops[first_in_cell(tops, max(survey.detail, BURIED))]
    sounded = cdist(tops[:, :2], soundings[:, :2]).min(axis=1, initial=np.inf) < survey.detail
    low, _ = limits_at(survey, tops[:, :2])
    bed = np.maximum(surface.at(tops[:, :2]), low)
    buried = tops[~sounded & (bed < tops[:, 2] + BURIED)]
    return np.asarray(buried + np.array([0.0, 0.0, MIN_HEIGHT]))


def _raise_bed(hazard: Hazard, grid: Grid, shoal_limit: Array) -> bool:
    """Raise the bed of `grid` to the top of an area.

    False for a floating object or a block, or if no node is inside an area.
    """
    if hazard.bottom < STANDING or _is_block(hazard, grid):
        return False
    (rows, columns), distance = edge_distance(*segments(hazard.edges), grid.north, grid.east)
    inside, (part, held) = np.full(distance.shape, -1.0), fill(hazard.edges, grid.north[rows], grid.east[columns])
    if not held.any():
        return False
    inside[part][held] = 1.0
    bed = grid.depths[rows, columns]
    top = np.maximum(shoal_limit[rows, columns] if hazard.top is None else hazard.top, -MIN_HEIGHT)
    bed[:] = raise_with_slope(bed, top, inside * np.minimum(distance, FAR_CELLS))
    return True


def _top_at(hazard: Hazard, position: Array, grid: Grid, limit: Grid) -> float | None:
    """Return the depth of the hazard's top at `position` (2,), None where there is no water or the bed is above it."""
    bed, shoal = (float(g.at(position[None])[0]) for g in (grid, limit))
    if not bed > 0.0:  # also true for nan
        return None
    if hazard.top is not None:
        return hazard.top if hazard.top < bed - BURIED else None
    highest = bed - MIN_HEIGHT
    return max(0.0, min(shoal, highest) if np.isfinite(shoal) else highest)


def _cylinder(hazard: Hazard, grid: Grid, limit: Grid) -> list[Cylinder]:
    """Return the obstacle of a point, or of an area smaller than a cell of the grid; none if it is not in water."""
    middle = hazard.line.mean(axis=0)
    top = _top_at(hazard, middle, grid, limit)
    radius = max(hazard.radius, float(np.hypot(*(hazard.line - middle).T).max()))
    if top is None:
        return []
    north, east, radius, top = _rounded(*middle, radius, top)
    return [Cylinder(north, east, radius, top, bottom=hazard.bottom)]


def _boxes(hazard: Hazard, grid: Grid, limit: Grid) -> list[Box]:
    """Return the obstacles of a line, one for each segment that is in water."""
    boxes = []
    for start, end in zip(hazard.line[:-1], hazard.line[1:], strict=True):
        middle, along = 0.5 * (start + end), end - start
        top = _top_at(hazard, middle, grid, limit)
        length, heading = float(np.hypot(*along)), float(np.arctan2(along[1], along[0]))
        if (
            top is not None
            and length > 0.0
            and (not hazard.needs_water_both_sides or _is_in_water(middle, along, hazard, grid))
        ):
            width = 2.0 * hazard.radius
            north, east, size, side, heading, top = _rounded(*middle, length + width, width, heading, top)
            boxes.append(Box(north, east, size, side, heading, top, bottom=hazard.bottom))
    return boxes


def _is_in_water(middle: Array, along: Array, hazard: Hazard, grid: Grid) -> bool:
    """True if there is water on both sides of a segment, at a distance of one cell, or the water before a quay."""
    if hazard.is_wall and grid.at(middle[None])[0] > QUAY_DEPTH:
        return True
    across = np.array([-along[1], along[0]]) / np.hypot(*along) * (hazard.radius + grid.resolution)
    return bool((grid.at(np.stack([middle - across, middle + across])) > 0.0).all())


def _outlined(hazard: Hazard, grid: Grid, limit: Grid) -> list[Box]:
    """Return the obstacles of an area: a rectangle where it nearly is one, else one for each segment of its outline."""
    boxes: list[Box] = []
    for polygon, corners in _polygons(hazard):
        if corners is None:
            ring = hazard._replace(line=_simplified(np.asarray(polygon.exterior.coords)), needs_water_both_sides=False)
            boxes += _boxes(ring, grid, limit)
            continue
        top = _top_at(hazard, corners.mean(axis=0), grid, limit)
        if top is not None:
            boxes.append(_rectangular(corners, top, hazard.bottom))
    return boxes


def _polygons(hazard: Hazard) -> list[tuple[Any, Array | None]]:
    """Return the polygons of an area, each with the corners (4, 2) of its rectangle where it nearly is one."""
    from shapely import LineString, polygonize

    polygons = polygonize([LineString(edge) for edge in hazard.edges]).geoms
    rectangles = [polygon.minimum_rotated_rectangle for polygon in polygons]
    return [
        (polygon, np.asarray(rectangle.exterior.coords)[:4] if polygon.area >= RECTANGULAR * rectangle.area else None)
        for polygon, rectangle in zip(polygons, rectangles, strict=True)
    ]


def _is_block(hazard: Hazard, grid: Grid) -> bool:
    """Return whether an area with walls consists of rectangles, with water on their middles."""
    corners = [corners for _, corners in _polygons(hazard)] if hazard.is_wall else []
    return bool(corners) and all(each is not None and grid.at(each.mean(axis=0)[None])[0] > 0.0 for each in corners)


def _rectangular(corners: Array, top: float, bottom: float = STANDING) -> Box:
    """Return the block with the outline `corners` (4 or more, 2)."""
    sides, middle = np.diff(corners[:3], axis=0), corners[:4].mean(axis=0)
    heading = float(np.arctan2(sides[0, 1], sides[0, 0]))
    north, east, size, side, heading, top = _rounded(*middle, *np.hypot(*sides.T), heading, top)
    return Box(north, east, size, side, heading, top, bottom=bottom)


def _rounded(*values: float) -> tuple[float, ...]:
    return tuple(round(float(value), 3) for value in values)

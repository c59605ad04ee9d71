"""Compute the horizontal distance to where a seabed with relief becomes too shallow."""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, floor, inf, isnan, sqrt

from sim.environment.terrain import NO_DATA, Terrain
from sim.environment.terrain_grid import Grid

Corner = tuple[float, float, float]  # row, column, depth in m
Place = tuple[float, float]  # row and column of the grid, not rounded

_FIRST_RADIUS = 4.0  # cells


def distance_to_shallows(terrain: Terrain, north: float, east: float, depth: float, within: float) -> float:
    """Return the distance in m from a place to the nearest one where the seabed is at `depth` m or shallower.

    inf if there is none within `within` m; where it is too shallow already, how deep (m, negative) the depth is in the
    seabed. Within a cell the contour counts as a straight line between the cell's edges: right on a plane, and
    elsewhere to the bend of the contour within a cell. A cell without data is all too shallow.
    """
    here = terrain.depth(north, east)
    if here <= depth:
        return here - depth
    edge = _to_edge(terrain, north, east) if terrain.outside <= depth else inf
    radius = min(_FIRST_RADIUS * terrain.grid.resolution, within)
    while True:  # a look twice as far costs four times as much
        least = min(edge, _nearest(terrain, north, east, depth, radius))
        if least <= radius or radius >= within:
            return least if least <= within else inf
        radius = min(2.0 * radius, within)


def _nearest(terrain: Terrain, north: float, east: float, depth: float, within: float) -> float:
    """Return the nearest shallow place of the cells within `within` m."""
    if terrain.shallowest(north, east, within) > depth:
        return inf
    place, least = terrain.coordinates(north, east), inf
    for corners in _cells(terrain, place, within * terrain.scale):
        if min(corner[2] for corner in corners) <= depth:
            least = min(least, _to_ring(place, _shallow_part(corners, depth)))
    return least * terrain.grid.resolution


def _cells(terrain: Terrain, place: Place, reach: float) -> Iterator[list[Corner]]:
    """Yield the corners, in their order around, of every cell within `reach` cells of a place."""
    grid, depths = terrain.grid, terrain.depths
    for row in range(max(floor(place[0] - reach), 0), min(ceil(place[0] + reach), grid.rows - 1)):
        for column in range(max(floor(place[1] - reach), 0), min(ceil(place[1] + reach), grid.columns - 1)):
            around = ((row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column))
            corners = [(float(i), float(j), depths[i * grid.columns + j]) for i, j in around]
            if any(isnan(corner[2]) for corner in corners):
                corners = [(i, j, NO_DATA) for i, j, _ in corners]
            yield corners


def _shallow_part(corners: list[Corner], depth: float) -> list[Place]:
    """Return the corners that are too shallow, and where the contour crosses the edges between."""
    ring: list[Place] = []
    for (row, column, here), (to_row, to_column, there) in pairwise([*corners, corners[0]]):
        if here <= depth:
            ring.append((row, column))
        if (here <= depth) != (there <= depth):
            share = (depth - here) / (there - here)
            ring.append((row + share * (to_row - row), column + share * (to_column - column)))
    return ring


def _to_ring(place: Place, ring: list[Place]) -> float:
    """Return the distance in cells from a place outside of a closed ring."""
    return min(_to_side(place, start, end) for start, end in pairwise([*ring, ring[0]]))


def _to_side(place: Place, start: Place, end: Place) -> float:
    x, y = end[0] - start[0], end[1] - start[1]
    to_x, to_y = place[0] - start[0], place[1] - start[1]
    square = x * x + y * y
    share = min(max((to_x * x + to_y * y) / square, 0.0), 1.0) if square else 0.0
    away_x, away_y = to_x - share * x, to_y - share * y
    return sqrt(away_x * away_x + away_y * away_y)


def _to_edge(terrain: Terrain, north: float, east: float) -> float:
    """Return the distance (m) from a place on the grid to its edge."""
    grid: Grid = terrain.grid
    x, y = terrain.coordinates(north, east)
    return grid.resolution * min(x, y, grid.rows - 1 - x, grid.columns - 1 - y)

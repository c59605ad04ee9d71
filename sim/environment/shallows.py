"""Compute the horizontal distance to the nearest point where a seabed with relief is too shallow."""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, floor, hypot, inf, isnan

from hil.common.vectors import off_line
from sim.environment.terrain import NO_DATA, Terrain

Corner = tuple[float, float, float]  # row, column, depth in m
Coordinates = tuple[float, float]  # row and column of the grid, not rounded

_FIRST_RADIUS = 4.0  # cells


def distance_to_shallows(terrain: Terrain, north: float, east: float, depth: float, within: float) -> float:
    """Return the distance in m from a position to the nearest one where the seabed is at `depth` m or shallower.

    inf if there is none within `within` m. If it is too shallow at the position itself, the result is negative: the
    depth of the seabed there minus `depth`. Within a cell the contour is approximated by a straight line between the
    cell's edges, which is exact on a plane. A cell without data counts as too shallow.
    """
    here = terrain.depth(north, east)
    if here <= depth:
        return here - depth
    edge, grid = inf, terrain.grid
    if terrain.outside <= depth:
        x, y = terrain.coordinates(north, east)
        edge = grid.resolution * min(x, y, grid.rows - 1 - x, grid.columns - 1 - y)
    radius = min(_FIRST_RADIUS * grid.resolution, within)
    while True:  # twice the radius costs four times as much, so it begins with a small one
        least = min(edge, _nearest(terrain, north, east, depth, radius))
        if least <= radius or radius >= within:
            return least if least <= within else inf
        radius = min(2.0 * radius, within)


def _nearest(terrain: Terrain, north: float, east: float, depth: float, within: float) -> float:
    """Return the distance (m) to the nearest shallow point of the cells within `within` m; inf if there is none."""
    if terrain.shallowest(north, east, within) > depth:
        return inf
    point, least = terrain.coordinates(north, east), inf
    for corners in _cells(terrain, point, within * terrain.scale):
        if min(corner[2] for corner in corners) <= depth:
            ring = _shallow_part(corners, depth)
            sides = pairwise([*ring, ring[0]])
            least = min(least, *(hypot(*off_line(*point, *start, *end)) for start, end in sides))
    return least * terrain.grid.resolution


def _cells(terrain: Terrain, point: Coordinates, reach: float) -> Iterator[list[Corner]]:
    """Yield the four corners, in cyclic order, of every cell within `reach` cells of a point."""
    grid, depths = terrain.grid, terrain.depths
    for row in range(max(floor(point[0] - reach), 0), min(ceil(point[0] + reach), grid.rows - 1)):
        for column in range(max(floor(point[1] - reach), 0), min(ceil(point[1] + reach), grid.columns - 1)):
            around = ((row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column))
            corners = [(float(i), float(j), depths[i * grid.columns + j]) for i, j in around]
            if any(isnan(corner[2]) for corner in corners):
                corners = [(i, j, NO_DATA) for i, j, _ in corners]
            yield corners


def _shallow_part(corners: list[Corner], depth: float) -> list[Coordinates]:
    """Return the polygon of a cell's shallow part: its shallow corners, and where the contour crosses its edges."""
    ring: list[Coordinates] = []
    for (row, column, from_depth), (to_row, to_column, to_depth) in pairwise([*corners, corners[0]]):
        if from_depth <= depth:
            ring.append((row, column))
        if (from_depth <= depth) != (to_depth <= depth):
            share = (depth - from_depth) / (to_depth - from_depth)
            ring.append((row + share * (to_row - row), column + share * (to_column - column)))
    return ring

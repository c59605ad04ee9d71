"""One ray over the seabed, in plain Python: the specification that sim/native/rays_seabed.h repeats.

A ray is followed from cell to cell of the grid (Amanatides & Woo 1987, Eurographics). In a cell, with s m along the ray
from its entry, the height above the seabed, h(s) - z(s), is a polynomial of second degree, because the surface is
bilinear; its first zero is exactly the hit. A ray that enters a cell below its surface has hit a step: the edge of the
grid, or a cell without data.
"""

from collections.abc import Sequence
from math import inf, sqrt
from typing import TYPE_CHECKING

from hil.common.vectors import Vector3

if TYPE_CHECKING:
    from sim.environment.terrain import Terrain

SURFACE, STEP_NORTH, STEP_EAST = 0, 1, 2  # the part of the seabed: its surface, or a step across north or east
TINY = 1e-12  # a component below this does not move a ray
ON_SURFACE = 1e-6  # m by which rounding may have put a point below the surface
MISSED = inf, -inf  # a part of a ray without a point


def intersect_seabed(
    terrain: "Terrain | None", depth: float, origin: Sequence[float], direction: Sequence[float], reach: float
) -> tuple[float, int]:
    """Return the distance to the seabed (inf beyond `reach`) and the part that is hit; it is flat without terrain."""
    z, dz = origin[2], direction[2]
    if terrain is None:
        return _intersect_flat(z, dz, depth, 0.0, reach), SURFACE
    x, y = terrain.coordinates(origin[0], origin[1])
    dx, dy = direction[0] * terrain.scale, direction[1] * terrain.scale
    into_row, out_of_row = slab(x, dx, 0.0, terrain.grid.rows - 1.0, 0.0, reach)
    near, far = slab(y, dy, 0.0, terrain.grid.columns - 1.0, into_row, out_of_row)
    if near > far:
        return _intersect_flat(z, dz, depth, 0.0, reach), SURFACE
    distance = _intersect_flat(z, dz, depth, 0.0, near)
    if distance < near:
        return distance, SURFACE
    side = STEP_EAST if near > into_row else STEP_NORTH if near > 0.0 else SURFACE
    distance, side = _walk(terrain, (x, y, z), (dx, dy, dz), near, far, side)
    if distance < inf or far >= reach:
        return distance, side
    distance = _intersect_flat(z, dz, depth, far, reach)
    step = distance == far and z + dz * far > depth + ON_SURFACE
    return distance, (STEP_EAST if far < out_of_row else STEP_NORTH) if step else SURFACE


def _intersect_flat(z: float, dz: float, depth: float, near: float, far: float) -> float:
    """Return the distance between `near` and `far` m at which a ray reaches `depth`; inf if it does not."""
    if z + dz * near >= depth:
        return near
    distance = (depth - z) / dz if dz > 0.0 else inf
    return distance if distance <= far else inf


def _walk(
    terrain: "Terrain", origin: Vector3, direction: Vector3, near: float, far: float, side: int
) -> tuple[float, int]:
    """Return the hit between `near` and `far` m along a ray within the grid; x and y are in cells."""
    depths, columns = terrain.depths, terrain.grid.columns
    last_row, last_column = terrain.grid.rows - 2, columns - 2
    (x, y, z), (dx, dy, dz) = origin, direction
    row = min(max(int(x + dx * near), 0), last_row)
    column = min(max(int(y + dy * near), 0), last_column)
    moves_x, moves_y = abs(dx) > TINY, abs(dy) > TINY
    inverse_x, inverse_y = 1.0 / dx if moves_x else inf, 1.0 / dy if moves_y else inf
    (step_x, edge_x), (step_y, edge_y) = (1, 1) if dx > 0.0 else (-1, 0), (1, 1) if dy > 0.0 else (-1, 0)
    next_x = (row + edge_x - x) * inverse_x if moves_x else inf
    next_y = (column + edge_y - y) * inverse_y if moves_y else inf
    while True:
        end = min(next_x, next_y, far)
        first = row * columns + column
        second = first + columns
        a, b, c, d = depths[first], depths[first + 1], depths[second], depths[second + 1]
        lowest = max(z + dz * near, z + dz * end)
        if not (lowest < a and lowest < b and lowest < c and lowest < d):
            distance = _intersect_cell(
                (a, b, c, d), (x + dx * near - row, y + dy * near - column, z + dz * near), direction, end - near
            )
            if distance >= 0.0:
                return near + distance, SURFACE
            if distance == BELOW:
                return near, side
        if end >= far:
            return inf, SURFACE
        if next_x <= next_y:
            row, side = row + step_x, STEP_NORTH
            next_x = (row + edge_x - x) * inverse_x
        else:
            column, side = column + step_y, STEP_EAST
            next_y = (column + edge_y - y) * inverse_y
        if not (0 <= row <= last_row and 0 <= column <= last_column):
            return inf, SURFACE
        near = end


ABOVE, BELOW = -1.0, -2.0


def _intersect_cell(
    corners: tuple[float, float, float, float], origin: Vector3, direction: Vector3, length: float
) -> float:
    """Return the distance from the cell's entry to its surface; ABOVE if there is no hit within `length` m.

    BELOW if the ray enters the cell below the surface. The height above the seabed is w(s) = -(p + q s + r s²), with
    p < 0 at the entry.
    """
    (a, b, c, d), (u, v, z), (dx, dy, dz) = corners, origin, direction
    north, east, twist = c - a, b - a, a - b - c + d
    p = z - (a + north * u + east * v + twist * u * v)
    if not p < 0.0:
        return 0.0 if p <= ON_SURFACE else BELOW
    q = dz - (north * dx + east * dy + twist * (u * dy + v * dx))
    r = -twist * dx * dy
    root = q * q - 4.0 * r * p
    if root < 0.0:
        return ABOVE
    below = q + sqrt(root)
    if not below > 0.0:
        return ABOVE
    distance = -2.0 * p / below
    return distance if distance <= length else ABOVE


def slab(at: float, rate: float, low: float, high: float, near: float, far: float) -> tuple[float, float]:
    """Return the part of the interval `near` to `far` (m) in which at + rate s is between `low` and `high`.

    If there is none, the first number is greater than the second.
    """
    if abs(rate) <= TINY:
        return (near, far) if low <= at <= high else MISSED
    inverse = 1.0 / rate
    one, other = (low - at) * inverse, (high - at) * inverse
    if one > other:
        one, other = other, one
    return max(near, one), min(far, other)

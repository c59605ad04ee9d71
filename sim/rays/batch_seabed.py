"""sim/rays/seabed.py once more, for many rays at once with numpy."""

from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from sim.rays.seabed import ABOVE, BELOW, ON_SURFACE, STEP_EAST, STEP_NORTH, SURFACE, TINY
from sim.terrain import Terrain

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Vectors = tuple[Floats, Floats, Floats]


def meet_seabed(
    terrain: Terrain | None, depth: float, origin: Sequence[float], directions: Vectors, reach: float
) -> tuple[Floats, Integers]:
    """Distances and details."""
    z, dz = origin[2], directions[2]
    if terrain is None:
        return _meet_flat(z, dz, depth, 0.0, reach), np.full(len(dz), SURFACE)
    x, y = terrain.coordinates(origin[0], origin[1])
    dx, dy = directions[0] * terrain.scale, directions[1] * terrain.scale
    into_row, out_of_row = slab(x, dx, 0.0, terrain.grid.rows - 1.0, 0.0, reach)
    near, far = slab(y, dy, 0.0, terrain.grid.columns - 1.0, into_row, out_of_row)
    beside = near > far
    found = _meet_flat(z, dz, depth, 0.0, np.where(beside, reach, near))
    sides = np.full(len(dz), SURFACE)
    (inside,) = np.nonzero(~beside & ~((near > 0.0) & (found < near)))
    side = np.where(near > into_row, STEP_EAST, np.where(near > 0.0, STEP_NORTH, SURFACE))[inside]
    rays = dx[inside], dy[inside], dz[inside]
    found[inside], sides[inside] = _walk(terrain, (x, y, z), rays, near[inside], far[inside], side)
    (beyond,) = np.nonzero((found == inf) & ~beside & (far < reach))
    far, out_of_row, dz = far[beyond], out_of_row[beyond], dz[beyond]
    distance = _meet_flat(z, dz, depth, far, reach)
    step = (distance == far) & (z + dz * far > depth + ON_SURFACE)
    found[beyond] = distance
    sides[beyond] = np.where(step, np.where(far < out_of_row, STEP_EAST, STEP_NORTH), SURFACE)
    return found, sides


def _meet_flat(z: float, dz: Floats, depth: float, near: Floats | float, far: Floats | float) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(dz > 0.0, (depth - z) / dz, inf)
    distance = np.where(distance <= far, distance, inf)
    return np.where(z + dz * near >= depth, near, distance)


def slab(
    at: Floats | float, rate: Floats, low: float, high: float, near: Floats | float, far: Floats | float
) -> tuple[Floats, Floats]:
    """As its namesake."""
    still = np.abs(rate) <= TINY
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slow = 1.0 / rate
        one, other = (low - at) * slow, (high - at) * slow
    inside = (low <= at) & (at <= high)
    first, second = np.maximum(near, np.minimum(one, other)), np.minimum(far, np.maximum(one, other))
    near, far = (
        np.where(still, np.where(inside, near, inf), first),
        np.where(still, np.where(inside, far, -inf), second),
    )
    return near, far


def _walk(
    terrain: Terrain, origin: Sequence[float], rays: Vectors, near: Floats, far: Floats, side: Integers
) -> tuple[Floats, Integers]:
    """Every ray goes on by one cell a turn; those that have met something or are through leave the arrays."""
    columns, last_row, last_column = terrain.grid.columns, terrain.grid.rows - 2, terrain.grid.columns - 2
    depths = np.asarray(terrain.depths)
    (x, y, z), (dx, dy, dz) = origin, rays
    found, sides = np.full(len(near), inf), np.full(len(near), SURFACE)
    index = np.arange(len(near))
    row = np.clip((x + dx * near).astype(np.int64), 0, last_row)
    column = np.clip((y + dy * near).astype(np.int64), 0, last_column)
    while len(index):
        next_x, next_y = _crossing(row, x, dx), _crossing(column, y, dy)
        end = np.minimum(np.minimum(next_x, next_y), far)
        first = row * columns + column
        a, b, c, d = (depths[first + ahead].astype(np.float64) for ahead in (0, 1, columns, columns + 1))
        lowest = np.maximum(z + dz * near, z + dz * end)
        distance = np.full(len(index), ABOVE)
        (close,) = np.nonzero(~((lowest < a) & (lowest < b) & (lowest < c) & (lowest < d)))
        place = (x + dx * near - row)[close], (y + dy * near - column)[close], (z + dz * near)[close]
        corners = a[close], b[close], c[close], d[close]
        distance[close] = _meet_cell(corners, place, (dx[close], dy[close], dz[close]), (end - near)[close])
        met, below = distance >= 0.0, distance == BELOW
        found[index[met]] = (near + distance)[met]
        found[index[below]], sides[index[below]] = near[below], side[below]
        north = next_x <= next_y
        row = np.where(north, row + np.where(dx > 0.0, 1, -1), row)
        column = np.where(north, column, column + np.where(dy > 0.0, 1, -1))
        stays = ~met & ~below & (end < far) & (row >= 0) & (row <= last_row) & (column >= 0) & (column <= last_column)
        index, row, column, side = (
            index[stays],
            row[stays],
            column[stays],
            np.where(north, STEP_NORTH, STEP_EAST)[stays],
        )
        near, far, dx, dy, dz = end[stays], far[stays], dx[stays], dy[stays], dz[stays]
    return found, sides


def _crossing(cell: Integers, at: float, rate: Floats) -> Floats:
    """Where the rays leave these cells, in m."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slow = 1.0 / rate
        return np.where(np.abs(rate) > TINY, (cell + np.where(rate > 0.0, 1, 0) - at) * slow, inf)


def _meet_cell(corners: tuple[Floats, ...], place: Vectors, rays: Vectors, length: Floats) -> Floats:
    (a, b, c, d), (u, v, z), (dx, dy, dz) = corners, place, rays
    north, east, twist = c - a, b - a, a - b - c + d
    p = z - (a + north * u + east * v + twist * u * v)
    q = dz - (north * dx + east * dy + twist * (u * dy + v * dx))
    r = -twist * dx * dy
    root = q * q - 4.0 * r * p
    with np.errstate(divide="ignore", invalid="ignore"):
        below = q + np.sqrt(root)
        distance = -2.0 * p / below
        met = (root >= 0.0) & (below > 0.0) & (distance <= length)
    inside = np.where(met, distance, ABOVE)
    return np.where(p < 0.0, inside, np.where(p <= ON_SURFACE, 0.0, BELOW))

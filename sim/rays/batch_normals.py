"""The normals of sim/rays/single.py once more, for many hits at once with numpy."""

from collections.abc import Sequence

import numpy as np

from sim.rays.batch import turn_all, turn_all_back
from sim.rays.batch_seabed import Floats, Integers, Vectors
from sim.rays.geometry import NOTHING, SEABED, Geometry
from sim.rays.seabed import STEP_EAST, STEP_NORTH
from sim.rays.solids import BOX, HALF_SPACE, KIND, MESH, POSITION, ROTATION, ROW, SIZES, SPHERE
from sim.rays.tree import TRIANGLE
from sim.terrain import Terrain


def normals(geometry: Geometry, objects: Integers, details: Integers, directions: Vectors, points: Vectors) -> Floats:
    """3 x n: the unit vectors (NED) away from what was hit, nan for nothing."""
    found = np.full((3, len(objects)), np.nan)
    for number in np.unique(objects[objects != NOTHING]).tolist():
        mine = objects == number
        rays = directions[0][mine], directions[1][mine], directions[2][mine]
        places = points[0][mine], points[1][mine], points[2][mine]
        if number == SEABED:
            found[:, mine] = _seabed_normals(geometry.terrain, details[mine], rays, places)
        else:
            row = list(geometry.solids[(number - 1) * ROW : number * ROW])
            found[:, mine] = _normals(geometry, row, details[mine], rays, places)
    return found


def _seabed_normals(terrain: Terrain | None, details: Integers, rays: Vectors, places: Vectors) -> Floats:
    found = np.zeros((3, len(details)))
    if terrain is None:
        found[2] = -1.0
    else:
        north, east = _gradients(terrain, places[0], places[1])
        scale = 1.0 / np.sqrt(north * north + east * east + 1.0)
        found[:] = north * scale, east * scale, -scale
    for axis, step in ((0, STEP_NORTH), (1, STEP_EAST)):
        mine = details == step
        found[:, mine] = 0.0
        found[axis, mine] = np.where(rays[axis][mine] > 0.0, -1.0, 1.0)
    return found


def _gradients(terrain: Terrain, north: Floats, east: Floats) -> tuple[Floats, Floats]:
    """As Terrain.gradient."""
    grid, depths = terrain.grid, np.asarray(terrain.depths)
    x, y = (north - grid.north_min) * terrain.scale, (east - grid.east_min) * terrain.scale
    inside = (x >= 0.0) & (x <= grid.rows - 1) & (y >= 0.0) & (y <= grid.columns - 1)
    row = np.clip(x.astype(np.int64), 0, grid.rows - 2)
    column = np.clip(y.astype(np.int64), 0, grid.columns - 2)
    first = row * grid.columns + column
    a, b, c, d = (depths[first + ahead].astype(np.float64) for ahead in (0, 1, grid.columns, grid.columns + 1))
    u, v, twist = x - row, y - column, a - b - c + d
    to_north, to_east = ((c - a) + twist * v) * terrain.scale, ((b - a) + twist * u) * terrain.scale
    known = inside & ~np.isnan(to_north + to_east)
    return np.where(known, to_north, 0.0), np.where(known, to_east, 0.0)


def _normals(geometry: Geometry, row: Sequence[float], details: Integers, rays: Vectors, places: Vectors) -> Floats:
    """Of one solid."""
    if row[KIND] == HALF_SPACE:
        return np.repeat(np.array([row[SIZES : SIZES + 3]]).T, len(details), axis=1)
    (x, y, z), rotation = row[POSITION:ROTATION], row[ROTATION:SIZES]
    if row[KIND] == MESH:
        own = _triangle_normals(geometry, details, turn_all_back(rotation, rays))
    else:
        own = _solid_normals(row, *turn_all_back(rotation, (places[0] - x, places[1] - y, places[2] - z)))
    return np.array(turn_all(rotation, own))


def _solid_normals(row: Sequence[float], x: Floats, y: Floats, z: Floats) -> Vectors:
    if row[KIND] == SPHERE:
        return _units(x, y, z)
    zero, one = np.zeros_like(x), np.ones_like(x)
    if row[KIND] == BOX:
        gaps = np.abs([a - size for a, size in zip((x, x, y, y, z, z), row[SIZES : SIZES + 6], strict=True)])
        face = np.argmin(gaps, axis=0)
        out = np.where(face % 2 == 0, -one, one)
        return np.where(face < 2, out, zero), np.where(face // 2 == 1, out, zero), np.where(face > 3, out, zero)
    gaps = np.abs([np.sqrt(x * x + y * y) - row[SIZES], z - row[SIZES + 1], z - row[SIZES + 2]])
    side = np.argmin(gaps, axis=0)
    out_x, out_y, _ = _units(x, y, zero)
    around = side == 0
    ends = np.where(side == 1, -one, one)
    return np.where(around, out_x, zero), np.where(around, out_y, zero), np.where(around, zero, ends)


def _units(x: Floats, y: Floats, z: Floats) -> Vectors:
    length = np.sqrt(x * x + y * y + z * z)
    some = length > 0.0
    safe = np.where(some, length, 1.0)
    return np.where(some, x / safe, 0.0), np.where(some, y / safe, 0.0), np.where(some, z / safe, -1.0)


def _triangle_normals(geometry: Geometry, details: Integers, rays: Vectors) -> Vectors:
    edges = np.frombuffer(geometry.triangles).reshape(-1, TRIANGLE)[details, 3:].T
    ex, ey, ez, fx, fy, fz = edges
    x, y, z = _units(ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx)
    sign = np.where(x * rays[0] + y * rays[1] + z * rays[2] > 0.0, -1.0, 1.0)
    return x * sign, y * sign, z * sign

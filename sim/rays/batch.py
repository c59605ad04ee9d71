"""Many rays at once with numpy, for whoever has no compiler: sim/rays/single.py once more, to the last bit.

Each function does for arrays, one value a ray, what its namesake there does, in the same order of operations.
"""

from array import array
from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from sim.rays.batch_seabed import Floats, Integers, Vectors, meet_seabed, slab
from sim.rays.geometry import NOTHING, SEABED, Geometry, Hits
from sim.rays.seabed import TINY
from sim.rays.single import turn_back
from sim.rays.solids import BOX, CYLINDER, HALF_SPACE, KIND, MESH, POSITION, REACH, ROOT, ROTATION, ROW, SIZES, SPHERE
from sim.rays.tree import NODE, TRIANGLE


def trace(
    geometry: Geometry, origin: Sequence[float], directions: Vectors, reach: float
) -> tuple[Floats, Integers, Integers]:
    """Distances, objects and details."""
    best, details = meet_seabed(geometry.terrain, geometry.depth, origin, directions, reach)
    objects = np.where(best < inf, SEABED, NOTHING)
    rows = np.array(geometry.solids).reshape(-1, ROW)
    for number, row in enumerate(rows.tolist(), 1):
        (tried,) = np.nonzero(~_passes(row, origin, directions, reach))
        if not len(tried):
            continue
        x, y, z = directions
        distances, found = _meet_solid(
            geometry, row, origin, (x[tried], y[tried], z[tried]), np.minimum(reach, best[tried])
        )
        nearer = distances < best[tried]
        tried = tried[nearer]
        best[tried], objects[tried], details[tried] = distances[nearer], number, found[nearer]
    return best, objects, details


def cast(
    geometry: Geometry,
    origin: Sequence[float],
    rotation: Sequence[float],
    directions: "memoryview[float]",
    reach: float,
    distances: "array[float]",
    hits: Hits | None,
) -> None:
    """Fill `distances`, and `hits` where it is given, for all rays: see RayScene."""
    x, y, z = np.asarray(directions).reshape(-1, 3).T
    along = turn_all(rotation, (x, y, z))
    found, objects, details = trace(geometry, origin, along, reach)
    np.frombuffer(distances)[:] = found
    if hits is None:
        return
    from sim.rays.batch_normals import normals

    way = np.where(found < inf, found, np.nan)
    points = origin[0] + way * along[0], origin[1] + way * along[1], origin[2] + way * along[2]
    np.frombuffer(hits.points).reshape(-1, 3).T[:] = points
    np.frombuffer(hits.normals).reshape(-1, 3).T[:] = normals(geometry, objects, details, along, points)
    np.frombuffer(hits.objects, np.int32)[:] = objects


def turn_all(rotation: Sequence[float], vectors: Vectors) -> Vectors:
    """As single.turn, all of them."""
    a, b, c, d, e, f, g, h, i = rotation
    x, y, z = vectors
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def turn_all_back(rotation: Sequence[float], vectors: Vectors) -> Vectors:
    """As single.turn_back, all of them."""
    a, b, c, d, e, f, g, h, i = rotation
    x, y, z = vectors
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def _passes(row: Sequence[float], origin: Sequence[float], directions: Vectors, reach: float) -> NDArray[np.bool_]:
    size, x, y = row[REACH], row[POSITION] - origin[0], row[POSITION + 1] - origin[1]
    dx, dy, _ = directions
    across = dx * y - dy * x
    out_of_reach = x * x + y * y > (size + reach) * (size + reach)
    with np.errstate(invalid="ignore"):
        return out_of_reach | (across * across > size * size * (dx * dx + dy * dy))


def _meet_solid(
    geometry: Geometry, row: Sequence[float], origin: Sequence[float], directions: Vectors, reach: Floats
) -> tuple[Floats, Integers]:
    kind, sizes = row[KIND], row[SIZES:ROOT]
    nothing = np.zeros(len(reach), np.int64)
    if kind == HALF_SPACE:
        return _meet_half_space(sizes, origin, directions, reach), nothing
    position, rotation = row[POSITION:ROTATION], row[ROTATION:SIZES]
    at = turn_back(rotation, origin[0] - position[0], origin[1] - position[1], origin[2] - position[2])
    along = turn_all_back(rotation, directions)
    near, far = np.zeros(len(reach)), reach
    if kind == MESH:
        best = np.full(len(reach), inf)
        _meet_mesh(geometry, int(row[ROOT]), at, along, np.arange(len(reach)), reach, best, nothing)
        return best, nothing
    if kind == SPHERE:
        near, far = _round(at, along, sizes[0], 3, near, far)
    elif kind == CYLINDER:
        near, far = _round(at, along, sizes[0], 2, near, far)
        near, far = slab(at[2], along[2], sizes[1], sizes[2], near, far)
    elif kind == BOX:
        for axis in range(3):
            near, far = slab(at[axis], along[axis], sizes[2 * axis], sizes[2 * axis + 1], near, far)
    return np.where(near <= far, near, inf), nothing


def _meet_half_space(sizes: Sequence[float], origin: Sequence[float], directions: Vectors, reach: Floats) -> Floats:
    x, y, z, offset, *_ = sizes
    height = x * origin[0] + y * origin[1] + z * origin[2] - offset
    if height <= 0.0:
        return np.zeros(len(reach))
    rate = x * directions[0] + y * directions[1] + z * directions[2]
    with np.errstate(divide="ignore"):
        distance = np.where(rate < 0.0, -height / rate, inf)
    return np.where(distance <= reach, distance, inf)


def _round(
    at: Sequence[float], along: Vectors, radius: float, axes: int, near: Floats, far: Floats
) -> tuple[Floats, Floats]:
    (x, y, z), (dx, dy, dz) = at, along
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius * radius
    if axes == 3:
        a, b, c = a + dz * dz, b + z * dz, c + z * z
    still = a <= TINY
    root = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.sqrt(root)
        one, other = (-b - half) / a, (-b + half) / a
        first = np.where(root < 0.0, inf, np.maximum(near, one))
        second = np.where(root < 0.0, -inf, np.minimum(far, other))
    inside = c <= 0.0
    return np.where(still, near if inside else inf, first), np.where(still, far if inside else -inf, second)


def _meet_mesh(
    geometry: Geometry, node: int, at: Sequence[float], along: Vectors, rays: Integers,
    reach: Floats, best: Floats, found: Integers,
) -> None:  # fmt: skip
    """Those `rays` that meet the box of a node go on to what is in it; `best` and `found` get the nearest triangles."""
    numbers = geometry.nodes[node * NODE : (node + 1) * NODE]
    near, far = np.zeros(len(rays)), np.minimum(reach[rays], best[rays])
    for axis in range(3):
        near, far = slab(at[axis], along[axis][rays], numbers[axis], numbers[3 + axis], near, far)
    rays = rays[near <= far]
    if not len(rays):
        return
    first, count = int(numbers[6]), int(numbers[7])
    if not count:
        _meet_mesh(geometry, node + 1, at, along, rays, reach, best, found)
        _meet_mesh(geometry, first, at, along, rays, reach, best, found)
    x, y, z = along
    for number in range(first, first + count):
        corner = geometry.triangles[number * TRIANGLE : (number + 1) * TRIANGLE]
        distance = _meet_triangle(corner, at, (x[rays], y[rays], z[rays]))
        nearer = (distance < best[rays]) & (distance <= reach[rays])
        best[rays[nearer]], found[rays[nearer]] = distance[nearer], number


def _meet_triangle(corner: Sequence[float], at: Sequence[float], along: Vectors) -> Floats:
    ax, ay, az, ex, ey, ez, fx, fy, fz = corner
    dx, dy, dz = along
    px, py, pz = dy * fz - dz * fy, dz * fx - dx * fz, dx * fy - dy * fx
    determinant = ex * px + ey * py + ez * pz
    tx, ty, tz = at[0] - ax, at[1] - ay, at[2] - az
    qx, qy, qz = ty * ez - tz * ey, tz * ex - tx * ez, tx * ey - ty * ex
    with np.errstate(divide="ignore", invalid="ignore"):
        slow = 1.0 / determinant
        u = (tx * px + ty * py + tz * pz) * slow
        v = (dx * qx + dy * qy + dz * qz) * slow
        distance = (fx * qx + fy * qy + fz * qz) * slow
        met = (determinant != 0.0) & (u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (u + v <= 1.0) & (distance >= 0.0)
    return np.where(met, distance, inf)

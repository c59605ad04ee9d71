"""One ray, in plain Python: the specification that sim/native/rays.h repeats to the last bit.

A ray that starts inside a solid has distance 0; a mesh has no inside. The `detail` of a hit is the part of the object:
on the seabed as in sim/rays/seabed.py, on a mesh the number of the triangle, on other solids 0.
"""

from array import array
from collections.abc import Sequence
from math import floor, inf, nan, sqrt
from typing import NamedTuple

from hil.common.vectors import Vector3
from sim.rays.geometry import NOTHING, SEABED, Geometry, Hits
from sim.rays.seabed import MISSED, STEP_EAST, STEP_NORTH, TINY, intersect_seabed, slab
from sim.rays.solids import BOX, CYLINDER, HALF_SPACE, KIND, MESH, POSITION, REACH, ROOT, ROTATION, ROW, SIZES, SPHERE
from sim.rays.tree import NODE, WIDTH, triangle

_FLAT = 1e-30  # greatest part of a direction that counts as parallel


class Hit(NamedTuple):
    """A hit: distance (m), object, and detail (see the top of this module)."""

    distance: float
    object: int
    detail: int


def rotate_to_world(rotation: Sequence[float], x: float, y: float, z: float) -> Vector3:
    """Return a vector of a solid's axes in the world's; `rotation` (row after row) is from the solid to the world."""
    a, b, c, d, e, f, g, h, i = rotation
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def rotate_to_solid(rotation: Sequence[float], x: float, y: float, z: float) -> Vector3:
    """Return a vector of the world's axes in a solid's: the inverse of `rotate_to_world`."""
    a, b, c, d, e, f, g, h, i = rotation
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def trace(geometry: Geometry, origin: Sequence[float], direction: Sequence[float], reach: float) -> Hit:
    """Return the first hit within `reach` m along `direction` (a unit vector, NED) from `origin` (NED, m)."""
    distance, detail = intersect_seabed(geometry.terrain, geometry.depth, origin, direction, reach)
    best = Hit(distance, SEABED, detail) if distance < inf else Hit(inf, NOTHING, 0)
    solids = geometry.solids
    for number, start in enumerate(range(0, len(solids), ROW), 1):
        row = solids[start : start + ROW]
        if not _misses(row, origin, direction, reach):
            distance, detail = _intersect_solid(geometry, row, origin, direction, min(reach, best.distance))
            if distance < best.distance:
                best = Hit(distance, number, detail)
    return best


def cast(
    geometry: Geometry,
    origin: Sequence[float],
    rotation: Sequence[float],
    directions: Sequence[float],
    reach: float,
    distances: "array[float]",
    hits: Hits | None,
) -> None:
    """Fill `distances`, and `hits` if it is given, for all rays: see RayScene."""
    x, y, z = origin
    for ray in range(len(distances)):
        place = slice(3 * ray, 3 * ray + 3)
        along = rotate_to_world(rotation, *directions[place])
        hit = trace(geometry, origin, along, reach)
        distances[ray] = hit.distance
        if hits is None:
            continue
        hits.objects[ray] = _owner(geometry.solids, hit.object)
        point = out = (nan, nan, nan)
        if hit.object != NOTHING:
            point = x + hit.distance * along[0], y + hit.distance * along[1], z + hit.distance * along[2]
            out = normal(geometry, hit, along, point)
        hits.points[place], hits.normals[place] = array("d", point), array("d", out)


def _owner(solids: Sequence[float], number: int) -> int:
    """Return the object to which a solid belongs: itself, unless it is a part of another object."""
    if number > SEABED and solids[(number - 1) * ROW + KIND] != MESH and solids[(number - 1) * ROW + ROOT]:
        return int(solids[(number - 1) * ROW + ROOT])
    return number


def normal(geometry: Geometry, hit: Hit, direction: Sequence[float], point: Sequence[float]) -> Vector3:
    """Return the unit normal (NED) of the surface that a ray along `direction` has hit at `point`."""
    if hit.object == SEABED:
        if hit.detail == STEP_NORTH:
            return (-1.0 if direction[0] > 0.0 else 1.0), 0.0, 0.0
        if hit.detail == STEP_EAST:
            return 0.0, (-1.0 if direction[1] > 0.0 else 1.0), 0.0
        return geometry.terrain.normal(point[0], point[1]) if geometry.terrain else (0.0, 0.0, -1.0)
    row = geometry.solids[(hit.object - 1) * ROW : hit.object * ROW]
    if row[KIND] == HALF_SPACE:
        return row[SIZES], row[SIZES + 1], row[SIZES + 2]
    position, rotation = row[POSITION:ROTATION], row[ROTATION:SIZES]
    x, y, z = rotate_to_solid(rotation, point[0] - position[0], point[1] - position[1], point[2] - position[2])
    if row[KIND] == MESH:
        own = _triangle_normal(geometry.triangles, hit.detail, rotate_to_solid(rotation, *direction))
    else:
        own = _solid_normal(row, x, y, z)
    return rotate_to_world(rotation, *own)


def _misses(row: Sequence[float], origin: Sequence[float], direction: Sequence[float], reach: float) -> bool:
    """True if a ray, seen from above, misses the bounding circle of a solid, or does not reach it."""
    size, x, y = row[REACH], row[POSITION] - origin[0], row[POSITION + 1] - origin[1]
    dx, dy = direction[0], direction[1]
    across = dx * y - dy * x
    out_of_reach = x * x + y * y > (size + reach) * (size + reach)
    return out_of_reach or across * across > size * size * (dx * dx + dy * dy)


def _intersect_solid(
    geometry: Geometry, row: Sequence[float], origin: Sequence[float], direction: Sequence[float], reach: float
) -> tuple[float, int]:
    """Return the distance to a solid, inf if it is not within `reach`, and the detail of the hit."""
    kind, sizes = row[KIND], row[SIZES:ROOT]
    if kind == HALF_SPACE:
        return _intersect_half_space(sizes, origin, direction, reach), 0
    position, rotation = row[POSITION:ROTATION], row[ROTATION:SIZES]
    at = rotate_to_solid(rotation, origin[0] - position[0], origin[1] - position[1], origin[2] - position[2])
    along = rotate_to_solid(rotation, direction[0], direction[1], direction[2])
    if kind == MESH:
        return _intersect_mesh(geometry, int(row[ROOT]), sizes, at, along, reach)
    near, far = 0.0, reach
    if kind == SPHERE:
        near, far = _round(at, along, sizes[0], 3, near, far)
    elif kind == CYLINDER:
        near, far = _round(at, along, sizes[0], 2, near, far)
        near, far = slab(at[2], along[2], sizes[1], sizes[2], near, far)
    elif kind == BOX:
        for axis in range(3):
            near, far = slab(at[axis], along[axis], sizes[2 * axis], sizes[2 * axis + 1], near, far)
    return (near if near <= far else inf), 0


def _intersect_half_space(
    sizes: Sequence[float], origin: Sequence[float], direction: Sequence[float], reach: float
) -> float:
    x, y, z, offset = sizes[0], sizes[1], sizes[2], sizes[3]
    height = x * origin[0] + y * origin[1] + z * origin[2] - offset
    if height <= 0.0:
        return 0.0
    rate = x * direction[0] + y * direction[1] + z * direction[2]
    distance = -height / rate if rate < 0.0 else inf
    return distance if distance <= reach else inf


def _round(at: Vector3, along: Vector3, radius: float, axes: int, near: float, far: float) -> tuple[float, float]:
    """Return the part of `near` to `far` m inside a sphere (3 axes) or an infinite cylinder (2) about the origin."""
    (x, y, z), (dx, dy, dz) = at, along
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius * radius
    if axes == 3:
        a, b, c = a + dz * dz, b + z * dz, c + z * z
    if a <= TINY:
        return (near, far) if c <= 0.0 else MISSED
    root = b * b - a * c
    if root < 0.0:
        return MISSED
    half = sqrt(root)
    return max(near, (-b - half) / a), min(far, (-b + half) / a)


def _solid_normal(row: Sequence[float], x: float, y: float, z: float) -> Vector3:
    """Return the outward normal of a solid without triangles at its surface point nearest to (x, y, z), in its axes."""
    if row[KIND] == SPHERE:
        return _unit(x, y, z)
    low, high = row[SIZES], row[SIZES + 1]
    if row[KIND] == BOX:
        faces = [
            (abs(x - low), (-1.0, 0.0, 0.0)), (abs(x - high), (1.0, 0.0, 0.0)),
            (abs(y - row[SIZES + 2]), (0.0, -1.0, 0.0)), (abs(y - row[SIZES + 3]), (0.0, 1.0, 0.0)),
            (abs(z - row[SIZES + 4]), (0.0, 0.0, -1.0)), (abs(z - row[SIZES + 5]), (0.0, 0.0, 1.0)),
        ]  # fmt: skip
    else:
        side = abs(sqrt(x * x + y * y) - low)
        faces = [
            (side, _unit(x, y, 0.0)),
            (abs(z - high), (0.0, 0.0, -1.0)),
            (abs(z - row[SIZES + 2]), (0.0, 0.0, 1.0)),
        ]
    return min(faces, key=lambda face: face[0])[1]


def _unit(x: float, y: float, z: float) -> Vector3:
    length = sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 0.0 else (0.0, 0.0, -1.0)


# --- meshes


def _intersect_mesh(
    geometry: Geometry, root: int, net: Sequence[float], at: Vector3, along: Vector3, reach: float
) -> tuple[float, int]:
    """Return the distance to a mesh and the number of the triangle; of equally near ones, the lowest number.

    A hit counts if it is in the box of its group: rounding can move that of a triangle seen from its edge anywhere.
    So hits do not depend on the order of the search, nor on how many boxes are searched in vain.
    """
    best, nearest, waiting = inf, 0, [(0.0, inf, root)]
    inverse = [1.0 / (x if abs(x) > _FLAT else _FLAT) for x in along]
    while waiting:
        near, end, child = waiting.pop()
        if near > min(reach, best):
            continue
        if child >= 0:
            waiting += _children(geometry.nodes[child * NODE : (child + 1) * NODE], at, inverse, min(reach, best))
            continue
        for number in range(WIDTH * (-1 - child), WIDTH * -child):
            corner = triangle(geometry.triangles, number)
            distance = _intersect_triangle(corner, at, along)
            is_nearer = distance < best or (distance == best and number < nearest)
            is_hit = is_nearer and distance <= reach and near <= distance <= end
            if is_hit and not (net[0] and _is_open(corner, net, at, along, distance)):
                best, nearest = distance, number
    return best, nearest


def _children(
    node: Sequence[float], at: Vector3, inverse: Sequence[float], far: float
) -> list[tuple[float, float, int]]:
    """Return where a ray is in each child that it meets within `far` m (m), and its number; the nearest is the last."""
    met = []
    for lane in range(WIDTH):
        near, end = 0.0, far
        for axis in range(3):
            one, other = ((node[WIDTH * (axis + 3 * side) + lane] - at[axis]) * inverse[axis] for side in (0, 1))
            near, end = max(near, min(one, other)), min(end, max(one, other))
        if near <= end:
            met.append((near, end, int(node[WIDTH * 6 + lane])))
    return sorted(met, key=lambda child: -child[0])


def _intersect_triangle(corner: Sequence[float], at: Vector3, along: Vector3) -> float:
    """Return the distance to a triangle, inf if it is missed (Möller & Trumbore 1997, J. Graphics Tools 2(1))."""
    ax, ay, az, ex, ey, ez, fx, fy, fz = corner
    dx, dy, dz = along
    px, py, pz = dy * fz - dz * fy, dz * fx - dx * fz, dx * fy - dy * fx
    determinant = ex * px + ey * py + ez * pz
    if determinant == 0.0:
        return inf
    inverse = 1.0 / determinant
    tx, ty, tz = at[0] - ax, at[1] - ay, at[2] - az
    u = (tx * px + ty * py + tz * pz) * inverse
    if not 0.0 <= u <= 1.0:
        return inf
    qx, qy, qz = ty * ez - tz * ey, tz * ex - tx * ez, tx * ey - ty * ex
    v = (dx * qx + dy * qy + dz * qz) * inverse
    distance = (fx * qx + fy * qy + fz * qz) * inverse
    return distance if v >= 0.0 and u + v <= 1.0 and distance >= 0.0 else inf


def _is_open(corner: Sequence[float], net: Sequence[float], at: Vector3, along: Vector3, distance: float) -> bool:
    """True if a ray that meets the triangle of a net at this distance passes between its twines.

    The twines are parallel to the two perpendicular sides at the triangle's first corner.
    """
    mesh, twine = net[0], net[1]
    x, y, z = (at[axis] + distance * along[axis] - corner[axis] for axis in range(3))
    for side in (3, 6):
        ex, ey, ez = corner[side], corner[side + 1], corner[side + 2]
        place = (x * ex + y * ey + z * ez) / sqrt(ex * ex + ey * ey + ez * ez) / mesh
        if abs(place - floor(place) - 0.5) >= 0.5 - 0.5 * twine / mesh:
            return False
    return True


def _triangle_normal(triangles: "array[float]", number: int, along: Vector3) -> Vector3:
    """Return a triangle's normal on the side of the ray's origin."""
    _, _, _, ex, ey, ez, fx, fy, fz = triangle(triangles, number)
    x, y, z = _unit(ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx)
    return (-x, -y, -z) if x * along[0] + y * along[1] + z * along[2] > 0.0 else (x, y, z)

"""Solids that rays can hit besides the seabed: spheres, cylinders, boxes, half spaces and meshes, with poses.

A solid is stored as a row of numbers in one array, which C reads, too.
"""

from array import array
from collections.abc import Sequence
from math import inf, sqrt
from typing import TYPE_CHECKING, NamedTuple

from sim.environment.obstacles import Box, Cylinder, Obstacle, Wall
from sim.rotations import from_euler, matrix

if TYPE_CHECKING:
    from sim.vehicle.vehicle import Vehicle

Point = Sequence[float]

SPHERE, CYLINDER, BOX, HALF_SPACE, MESH = range(5)
# The indices at which the parts of a row begin, and the length of a row.
KIND, REACH, POSITION, ROTATION, SIZES, ROOT, ROW = 0, 1, 2, 5, 14, 20, 21

_UPRIGHT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


_NONE = array("d")


class Solid(NamedTuple):
    """One solid. `rotation` (row after row) converts its own axes to the world's, `position` (NED, m) is their origin.

    `reach` (m) is its greatest horizontal distance from there. `sizes` depend on `kind`; for a net they are the
    distance of its twines and their thickness. `triangles` are those of a mesh, in its own axes: nine numbers each.
    """

    kind: int
    reach: float
    position: Point
    rotation: Sequence[float]
    sizes: Sequence[float]
    triangles: "array[float]" = _NONE

    def numbers(self, root: int) -> list[float]:
        """Return the row. `root` is the root node of a mesh's tree; for other solids their object, 0 for itself."""
        sizes = [*self.sizes, *[0.0] * (ROOT - SIZES - len(self.sizes))]
        return [float(self.kind), self.reach, *self.position, *self.rotation, *sizes, float(root)]


def sphere(center: Point, radius: float) -> Solid:
    """Return a sphere; `center` in m, NED."""
    return Solid(SPHERE, radius, center, _UPRIGHT, (radius,))


ABSENT = sphere((1e9, 0.0, 0.0), 0.0)  # of a row without a solid: no ray goes there


def cylinder(center: Point, radius: float, half_length: float, rotation: Sequence[float] = _UPRIGHT) -> Solid:
    """Return a cylinder with flat ends along the z axis of its own axes."""
    reach = sqrt(radius * radius + half_length * half_length)
    return Solid(CYLINDER, reach, center, rotation, (radius, -half_length, half_length))


def box(center: Point, dimensions: Point, rotation: Sequence[float] = _UPRIGHT) -> Solid:
    """Return a cuboid of `dimensions` m along its own axes."""
    x, y, z = (0.5 * size for size in dimensions)
    return Solid(BOX, sqrt(x * x + y * y + z * z), center, rotation, (-x, x, -y, y, -z, z))


def half_space(normal: Point, offset: float) -> Solid:
    """Return the half space of points p (NED) with `normal` . p < `offset` m; `normal` is a unit vector outwards."""
    return Solid(HALF_SPACE, inf, (0.0, 0.0, 0.0), _UPRIGHT, (*normal, offset))


def hull(vehicle: "Vehicle") -> Solid:
    """Return the box of a vehicle's length, width and height about its origin."""
    return box((0.0, 0.0, 0.0), vehicle.dimensions)


def standing(obstacle: Obstacle) -> Solid:
    """Return the solid of a world's obstacle, from its top to its bottom (below the seabed if it stands on it)."""
    if isinstance(obstacle, Cylinder):
        position = (obstacle.north, obstacle.east, obstacle.top)
        length = obstacle.bottom - obstacle.top
        return Solid(CYLINDER, obstacle.radius, position, _UPRIGHT, (obstacle.radius, 0.0, length))
    if isinstance(obstacle, Box):
        x, y = 0.5 * obstacle.size_north, 0.5 * obstacle.size_east
        turned = matrix(from_euler(0.0, 0.0, obstacle.heading))
        position = (obstacle.north, obstacle.east, obstacle.top)
        return Solid(BOX, sqrt(x * x + y * y), position, turned, (-x, x, -y, y, 0.0, obstacle.bottom - obstacle.top))
    if isinstance(obstacle, Wall):
        return half_space((obstacle.inward_north, obstacle.inward_east, 0.0), obstacle.offset)
    from sim.environment.mesh import MeshObstacle  # imported here, because most worlds have none
    from sim.environment.things.pipelines import Pipeline

    if isinstance(obstacle, MeshObstacle):
        position = (obstacle.north, obstacle.east, obstacle.keys.depth)
        reach = obstacle.radius + 1e-6  # m: that was rounded
        return Solid(MESH, reach, position, obstacle.rotation, obstacle.net or (), obstacle.triangles)
    if isinstance(obstacle, Pipeline):  # has its number; its pieces come and go: see sim.rays.pipes
        return ABSENT
    raise TypeError(f"rays know no {type(obstacle).__name__}")

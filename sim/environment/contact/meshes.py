"""Find contacts of a vehicle with meshes and pipelines, by rays from its origin to points of its hull."""

from array import array
from collections.abc import Iterator, Sequence
from math import ceil, cos, pi, sin, sqrt
from typing import TYPE_CHECKING

from hil.common.vectors import Vector3
from sim.environment.world import World
from sim.rays.geometry import NOTHING
from sim.rays.scene import RayScene
from sim.rotations import Rotation
from sim.vehicle.collision_shape import HullShape

if TYPE_CHECKING:
    from sim.environment.mesh import MeshObstacle
    from sim.environment.things.pipelines import Pipeline

_RING_POINTS = 8  # of a ring around a rod with a radius
_EDGE_STEPS = 6  # along a rod without a radius
_MAX_RINGS = 16
_DEEP = 1e5  # m: deeper than any ray reaches, so that no ray hits the seabed


class MeshContact:
    """Finds where the hull `shape` penetrates a mesh or pipeline of `world`.

    Rays are cast from its origin to points of its surface: along edges, and in rings around rods with a radius. An
    object that is thinner than the distance of two such points may be missed.
    """

    def __init__(self, world: World, shape: HullShape) -> None:
        self._meshes: tuple[MeshObstacle | Pipeline, ...] = (*world.mesh, *world.pipeline)
        solid = tuple(mesh._replace(net=None) for mesh in world.mesh)  # a vehicle does not pass between twines
        bare = world._replace(mesh=solid, cylinder=(), box=(), walls=False, terrain=None, ocean=None, depth=_DEEP)
        self._scene = RayScene(bare, bed=world)
        self._points = [point for point in _surface_points(shape) if any(point)]
        self._lengths = [sqrt(x * x + y * y + z * z) for x, y, z in self._points]
        rays = zip(self._points, self._lengths, strict=True)
        self._directions = array("d", [x / length for point, length in rays for x in point])
        self._reach = max(self._lengths)

    def touches(self, position: Sequence[float], rotation: Rotation) -> Iterator[tuple[float, Vector3, Vector3, str]]:
        """Yield each contact: penetration (m, along the normal), normal, point, and the name of the object.

        Normal and point are along NED, the point in m from the vehicle's origin.
        """
        hits = self._scene.hits(position, self._directions, self._reach, rotation)
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        for ray, (distance, length) in enumerate(zip(hits.distances, self._lengths, strict=True)):
            if distance < length and hits.objects[ray] != NOTHING:
                a, b, c = hits.normals[3 * ray : 3 * ray + 3]
                x, y, z = self._points[ray]
                point = xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
                depth = (1.0 - distance / length) * abs(a * point[0] + b * point[1] + c * point[2])
                yield depth, (a, b, c), point, self._meshes[hits.objects[ray] - 1].label


def _surface_points(shape: HullShape) -> Iterator[Vector3]:
    """Yield points of the hull's surface (m, body axes)."""
    for x, y, z, radius in shape.points:  # rods with a radius are parallel to x
        if not radius:
            yield x, y, z
            continue
        yield x + radius, y, z
        yield x - radius, y, z
        yield from _ring(x, y, z, radius)
        yield from _ring(x + radius * sqrt(0.5), y, z, radius * sqrt(0.5))
        yield from _ring(x - radius * sqrt(0.5), y, z, radius * sqrt(0.5))
    for i, j in shape.rods:
        start, end = shape.points[i], shape.points[j]
        length, radius = sqrt(sum([(a - b) ** 2 for a, b in zip(start[:3], end[:3], strict=True)])), start[3]
        steps = min(_MAX_RINGS, max(2, ceil(length / (1.5 * radius)))) if radius else _EDGE_STEPS
        for k in range(1, steps):
            x, y, z = [a + k / steps * (b - a) for a, b in zip(start[:3], end[:3], strict=True)]
            if radius:
                yield from _ring(x, y, z, radius)
            else:
                yield x, y, z


def _ring(x: float, y: float, z: float, radius: float) -> Iterator[Vector3]:
    for k in range(_RING_POINTS):
        turn = 2.0 * pi * k / _RING_POINTS
        yield x, y + radius * cos(turn), z + radius * sin(turn)

"""Contact of a vehicle with the meshes and pipelines of a world, by rays from its middle to places of its hull."""

from array import array
from collections.abc import Sequence
from math import cos, inf, pi, sin, sqrt

from hil.common.vectors import Vector3
from sim.environment.mesh import MeshObstacle
from sim.environment.things.pipelines import Pipeline
from sim.environment.world import World
from sim.rays.geometry import NOTHING
from sim.rays.scene import RayScene

_AROUND = 24  # places of each rim
_DEEP = 1e5  # m: no seabed is met


class MeshContact:
    """Finds where an upright cylinder of `radius` m, `half_height` m each way, is in a mesh of `world`.

    Looked at are its middle's rays to three rims, above, at and below the middle, and to both ends. What is thinner
    than the distance of two such places may come between them.
    """

    def __init__(self, world: World, radius: float, half_height: float) -> None:
        self._meshes: tuple[MeshObstacle | Pipeline, ...] = (*world.mesh, *world.pipeline)
        tight = tuple(mesh._replace(net=None) for mesh in world.mesh)  # a vehicle does not pass between twines
        bare = world._replace(mesh=tight, cylinder=(), box=(), walls=False, terrain=None, ocean=None, depth=_DEEP)
        self._scene = RayScene(bare, bed=world)
        places = [(0.0, 0.0, half_height), (0.0, 0.0, -half_height)]
        for down in (-half_height, 0.0, half_height):
            turns = [2.0 * pi * k / _AROUND for k in range(_AROUND)]
            places += [(radius * cos(turn), radius * sin(turn), down) for turn in turns]
        self._lengths = [sqrt(x * x + y * y + z * z) for x, y, z in places]
        self._directions = array("d", [v / n for place, n in zip(places, self._lengths, strict=True) for v in place])
        self._reach = max(self._lengths)

    def away(self, north: float, east: float) -> float:
        """Return the distance (m) from a place to the nearest pipeline or upright cylinder around a mesh."""
        return min(mesh.separation(north, east)[0] for mesh in self._meshes)

    def deepest(self, position: Sequence[float]) -> tuple[float, Vector3, str]:
        """Return how far (m) a mesh reaches into the cylinder, across its surface, the normal there, and which mesh.

        -inf and no name where none does.
        """
        hits = self._scene.hits(position, self._directions, self._reach)
        found: tuple[float, Vector3, str] = (-inf, (0.0, 0.0, -1.0), "")
        for ray, (distance, length) in enumerate(zip(hits.distances, self._lengths, strict=True)):
            if distance < length and hits.objects[ray] != NOTHING:
                x, y, z = hits.normals[3 * ray : 3 * ray + 3]
                dx, dy, dz = self._directions[3 * ray : 3 * ray + 3]
                depth = (length - distance) * abs(x * dx + y * dy + z * dz)
                if depth > found[0]:
                    found = depth, (x, y, z), self._meshes[hits.objects[ray] - 1].label
        return found

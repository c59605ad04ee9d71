"""Records that every ray engine uses: the solids of a scene, and hits."""

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from array import array

    from sim.environment.terrain import Terrain

NOTHING, SEABED = -1, 0  # objects; the solids follow from 1


class Geometry(NamedTuple):
    """Surfaces that rays can hit: the seabed, flat at `depth` m where there is no terrain, and solids with meshes."""

    terrain: "Terrain | None"
    depth: float
    solids: "array[float]"
    nodes: "array[float]"
    triangles: "array[float]"


class Hits(NamedTuple):
    """The hit of each ray: distance (m, inf for none), point (NED, m), unit normal of the surface, and object.

    `points` and `normals` have three numbers a ray, nan without a hit. An object is NOTHING, SEABED or a number of the
    scene. The arrays are of doubles and of 32-bit integers; numpy.asarray uses them without copying.
    """

    distances: "array[float]"
    points: "array[float]"
    normals: "array[float]"
    objects: "array[int]"

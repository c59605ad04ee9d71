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
    """Hit of each ray: distance (m, inf for none), place (NED, m), the surface's unit normal there, and the object.

    Three numbers a ray in `points` and `normals`, nan for nothing. An object is NOTHING, SEABED or a number of the
    scene. Arrays of doubles (of a PictureScene numpy's of 32-bit floats) and of 32-bit integers; numpy.asarray takes
    them as they are.
    """

    distances: "array[float]"
    points: "array[float]"
    normals: "array[float]"
    objects: "array[int]"

"""The scene for a sensor's rays: the seabed, obstacles, and added solids."""

from array import array
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from hil.common.errors import ConfigError
from sim.environment.world import World
from sim.rays.geometry import NOTHING, SEABED, Geometry, Hits
from sim.rays.solids import POSITION, ROOT, ROW, Solid, standing
from sim.rotations import matrix
from sim.twins import make_caster

if TYPE_CHECKING:
    from sim.dynamics import State
    from sim.native._rays import Caster
    from sim.rays.boxes import Boxes
    from sim.rays.pipes import NearPipes

__all__ = ["ALONG_AXES", "NOTHING", "SEABED", "Engine", "Hits", "RayScene"]

ALONG_AXES = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)  # the identity, for directions in NED
Engine = Literal["", "C", "python"]


class RayScene:
    """The seabed and the obstacles of `world`, and added solids.

    Objects are SEABED, then the obstacles from 1 on in the order of `world.obstacles()`, then added solids. If `engine`
    is left out it is C if that is compiled, else Python; both give the same numbers to the last bit. Pipelines lie on
    the seabed of `bed`, or of `world` if it is left out. The terrain is not copied. Not modelled: the water's surface
    (add a half space for it), refraction.
    """

    def __init__(self, world: World, engine: Engine = "", *, bed: World | None = None) -> None:
        self._world = world
        self._standing = len(world.obstacles())
        self._added: list[Solid] = []
        self._pipes: NearPipes | None = None
        if world.pipeline:
            from sim.rays import pipes

            self._pipes = pipes.NearPipes(bed or world, self._standing - len(world.pipeline) + 1)
        self._moving: list[tuple[int, State]] = []
        self._geometry: Geometry | None = None
        self._caster: Caster | None = None
        self._engine = engine
        self._trees: dict[int, Any] = {}  # see `boxes`

    def add(self, solid: Solid, state: "State | None" = None) -> int:
        """Add a solid; return its number. With a `state` it moves with that vehicle: its axes are the body's."""
        self._added.append(solid)
        number = self._standing + len(self._added)
        if state is not None:
            self._moving.append((number, state))
        self._geometry = None
        return number

    def ranges(
        self,
        origin: Sequence[float],
        directions: Any,
        reach: float,
        rotation: Sequence[float] = ALONG_AXES,
    ) -> "array[float]":
        """Return the distance (m) along each ray from `origin` (NED, m); inf if there is no hit within `reach` m.

        `directions` are unit vectors, three doubles a ray, as a buffer (array("d"), numpy); `rotation` (3 x 3, row
        after row) converts them to NED, the identity if left out. A ray that starts inside a solid has distance 0.
        Raises ValueError for buffers of another type.
        """
        rays = _doubles(directions)
        distances = array("d", (0.0,)) * (len(rays) // 3)
        self._cast(origin, rays, reach, rotation, distances, None)
        return distances

    def hits(
        self,
        origin: Sequence[float],
        directions: Any,
        reach: float,
        rotation: Sequence[float] = ALONG_AXES,
    ) -> Hits:
        """Return `ranges`, and for each ray the point of the hit, the object, and its normal there."""
        rays = _doubles(directions)
        count = len(rays) // 3
        hits = Hits(
            array("d", (0.0,)) * count, array("d", (0.0,)) * (3 * count), array("d", (0.0,)) * (3 * count),
            array("i", (0,)) * count,
        )  # fmt: skip
        self._cast(origin, rays, reach, rotation, hits.distances, hits)
        return hits

    def boxes(self, centre: Sequence[float], reach: float) -> "Boxes":
        """Return the bounding boxes of solids within about `reach` m of `centre` (NED, m), at their present positions.

        Half spaces have none. Needs numpy.
        """
        from sim.rays.boxes import boxes_within

        return boxes_within(self._present(centre, reach), self._trees, centre, reach)

    def compiled(self, origin: Sequence[float], reach: float) -> object | None:
        """Return the geometry for sim.native._picture at the present positions; None without rays in C."""
        self._present(origin, reach)
        return self._caster.geometry() if self._caster else None

    def _cast(
        self,
        origin: Sequence[float],
        rays: "memoryview[float] | array[float]",
        reach: float,
        rotation: Sequence[float],
        distances: "array[float]",
        hits: Hits | None,
    ) -> None:
        geometry = self._present(origin, reach)
        if self._caster is not None:
            self._caster.cast(origin, rotation, rays, reach, distances, *(hits[1:] if hits else ()))
            return
        from sim.rays import single

        single.cast(geometry, origin, rotation, rays, reach, distances, hits)

    def _present(self, origin: Sequence[float], reach: float) -> Geometry:
        """Return the geometry at the present positions, with the pipelines within `reach` m."""
        if self._pipes is not None and self._pipes.update(origin, reach):
            self._replace_pipes(self._pipes.rows)
        if self._geometry is None:
            self._geometry = self._gather()
            self._caster = make_caster(self._geometry) if self._engine in ("", "C") else None
            if self._caster is None and self._engine == "C":
                from sim.native import REMEDY

                raise ConfigError(f"there are no rays in C: {REMEDY}")
        if self._moving:
            self._move(self._geometry.solids)
        return self._geometry

    def _move(self, solids: "array[float]") -> None:
        """Set all moving solids to their present poses."""
        for number, state in self._moving:
            first = (number - 1) * ROW + POSITION
            for place, value in enumerate((*state.position, *matrix(state.quaternion)), first):
                solids[place] = value

    def _replace_pipes(self, rows: "array[float]") -> None:
        """Replace the pieces of pipelines, which are the last rows of the scene."""
        first = ROW * (self._standing + len(self._added))
        if self._geometry is not None and len(self._geometry.solids) == first + len(rows):
            solids = memoryview(self._geometry.solids)  # the caster holds this memory, so its size must not change
            solids[first:] = memoryview(rows)
        else:
            self._geometry = None

    def _gather(self) -> Geometry:
        standing_numbers, standing_meshes = _standing(self._world)
        numbers, meshes = array("d", standing_numbers), dict(standing_meshes)
        for index, solid in enumerate(self._added, self._standing):
            numbers.extend(solid.numbers(0))
            if solid.triangles:
                meshes[index] = solid.triangles
        nodes, triangles = array("f"), array("d")
        if meshes:
            from sim.rays.tree import forest

            nodes, triangles, roots = forest(tuple(meshes.values()))
            for index, root in zip(meshes, roots, strict=True):
                numbers[index * ROW + ROOT] = root
        if self._pipes is not None:
            numbers.extend(self._pipes.rows)
        terrain = self._world.terrain
        return Geometry(terrain, terrain.outside if terrain else self._world.depth, numbers, nodes, triangles)


Standing = tuple["array[float]", "dict[int, array[float]]"]
_latest: "list[tuple[World, Standing]]" = []  # cache of the last world


def _standing(world: World) -> Standing:
    """Return the rows of a world's obstacles, and the triangles of its meshes by their row: once for all sensors."""
    if not _latest or _latest[0][0] is not world:
        solids = [standing(obstacle) for obstacle in world.obstacles()]
        numbers = array("d", [x for solid in solids for x in solid.numbers(0)])
        meshes = {index: solid.triangles for index, solid in enumerate(solids) if solid.triangles}
        _latest[:] = [(world, (numbers, meshes))]
    return _latest[0][1]


def _doubles(directions: Any) -> "memoryview[float] | array[float]":
    """Return the numbers of a buffer as a flat view. Raises ValueError if they are no doubles, or not three a ray."""
    if type(directions) is array and directions.typecode == "d" and not len(directions) % 3:
        return directions
    view = memoryview(directions)
    if view.format != "d" or view.nbytes % 24:
        raise ValueError(f"directions: three doubles a ray are needed, found {view.nbytes} bytes of {view.format!r}")
    is_plain = view.ndim == 1 and view.c_contiguous
    doubles: memoryview[float] = view if is_plain else view.cast("B").cast("d")  # type: ignore[assignment]
    return doubles

"""Cast all rays of a camera picture at once with OpenGL, by off-screen rasterisation.

It is meant for large pictures, on a graphics card or with Mesa's software renderer. The context is made by EGL, so no
window system is needed. Only the part of the seabed's grid that the camera may see is drawn; solids are drawn at their
present positions. Numbers are 32-bit floats: distances agree with those of the rays to a part in 10 000. At outlines of
objects a pixel may show the other side, and of two objects at the same distance it may show the other one. A visible
cell of the grid costs as much as ten pixels.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from math import ceil, floor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError, MissingExtraError
from sim.environment.terrain import Terrain
from sim.environment.world import World
from sim.rays import opengl_shaders as shaders
from sim.rays.geometry import NOTHING, SEABED, Geometry, Hits
from sim.rays.scene import ALONG_AXES, RayScene
from sim.rays.solids import BOX, CYLINDER, HALF_SPACE, KIND, MESH, POSITION, ROOT, ROTATION, ROW, SIZES, Solid

if TYPE_CHECKING:
    from moderngl import Context, VertexArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_KEY = 'sensors: camera: renderer = "opengl"'
MAX_WIDER = 6  # ratio of the pixels of an undistorted picture to those of the picture
MAX_STRETCH = 1.5  # ratio of distances within half a pixel
_UNKNOWN = -1e6  # m: the depth of a node without data
_SOLID = "3f 9f 3f 3f 3f/i"  # position, rotation, low, high; radius, kind, number


class PictureScene(RayScene):
    """A RayScene for one camera with `width` x `height` square pixels, a focal length of `focal` pixels, and its axis
    through the middle.

    For a distorting `lens`, given by its unit vectors (n x 3), an undistorted picture of its whole field of view is
    drawn; each ray of the lens then ends on the plane of the surface in the nearest pixel of that picture. Use it only
    in the thread that made it. Raises MissingExtraError without moderngl, ConfigError without OpenGL.
    """

    def __init__(self, world: World, width: int, height: int, focal: float, lens: Any = None) -> None:
        super().__init__(world)
        self._lens: Any = None
        if lens is not None:
            size, self._nearest = straightened(lens, width * height, focal)
            self._lens, (width, height) = np.ascontiguousarray(lens.T, np.float32), size
        self._size, self._focal = (float(width), float(height)), focal
        right, down = np.meshgrid(np.arange(width) - 0.5 * (width - 1), np.arange(height) - 0.5 * (height - 1))
        toward = np.stack([np.full(right.size, focal), right.ravel(), down.ravel()])
        self._toward = (toward / np.sqrt((toward * toward).sum(axis=0))).astype(np.float32)
        self._context = context = open_context()
        self._planes, self._seabed, self._primitive, self._mesh = (
            context.program(*program) for program in (shaders.PLANES, shaders.SEABED, shaders.SOLIDS, shaders.MESH)
        )
        size = width, height
        pictures = [context.texture(size, 4, dtype="f4"), context.texture(size, 1, dtype="i4")]
        self._frame = context.framebuffer(pictures, context.depth_renderbuffer(size))
        self._cube = context.buffer(_cube())
        self._meshes: dict[int, tuple[VertexArray, int]] = {}

    def hits(
        self, origin: Sequence[float], directions: Any, reach: float, rotation: Sequence[float] = ALONG_AXES
    ) -> Hits:
        """Return hits as RayScene.hits does, in 32-bit floats; `directions` must be those of the camera's pixels.

        Raises ConfigError if more of a terrain is within `reach` than fits in a texture.
        """
        geometry = self._present(origin, reach)
        terrain, at = geometry.terrain, np.array(origin)
        if (terrain.shallowest(at[0], at[1], 0.0) if terrain else geometry.depth) < at[2]:  # from under the triangles
            return super().hits(origin, directions, reach, rotation)
        axes = np.array(rotation).reshape(3, 3)
        self._draw(geometry, at, axes, reach)
        drawn: Any = np.empty((self._toward.shape[1], 4), np.float32)
        objects: Any = np.empty(len(drawn), np.int32)
        self._frame.read_into(drawn, components=4, attachment=0, dtype="f4")
        self._frame.read_into(objects, components=1, attachment=1, dtype="i4")
        toward = self._toward
        if self._lens is not None:
            toward, drawn, objects = self._lens, drawn[self._nearest], objects[self._nearest]
            drawn[:, 3] *= along_plane(drawn[:, :3] @ axes.astype(np.float32), self._toward[:, self._nearest], toward)
        distances = drawn[:, 3].copy()
        points: Any = axes.astype(np.float32) @ toward
        points *= np.where(objects == NOTHING, np.float32(np.nan), distances)
        points += at.astype(np.float32)[:, None]
        return Hits(distances, points.T, drawn[:, :3], objects)

    def _draw(self, geometry: Geometry, at: Floats, rotation: Floats, reach: float) -> None:
        """Draw the view from `at` into both textures of the frame; `rotation` is from camera to world axes."""
        context = self._context
        for program in (self._planes, self._seabed, self._primitive, self._mesh):
            program["rotation"], program["reach"] = tuple(rotation.T.ravel()), reach
            program["size"], program["focal"] = self._size, self._focal
        rows = np.frombuffer(geometry.solids).reshape(-1, ROW).copy()
        rows[:, POSITION:ROTATION] -= at
        self._frame.use()
        context.enable_only(context.DEPTH_TEST)
        context.depth_func = "1"  # the first pass covers all pixels
        self._draw_planes(geometry, rows, at)
        context.depth_func = "<"
        if geometry.terrain:
            self._draw_seabed(geometry, geometry.terrain, at, rotation, reach)
        self._draw_meshes(rows)
        chosen = np.flatnonzero((rows[:, KIND] != HALF_SPACE) & (rows[:, KIND] != MESH))
        owners = rows[chosen, ROOT].astype(np.int64)  # of pieces
        self._draw_solids(rows[chosen], np.where(owners > 0, owners, chosen + 1))

    def _draw_planes(self, geometry: Geometry, rows: Floats, at: Floats) -> None:
        chosen = np.flatnonzero(rows[:, KIND] == HALF_SPACE)
        planes, numbers = rows[chosen, SIZES : SIZES + 4], chosen + 1
        planes[:, 3] = planes[:, :3] @ at - planes[:, 3]
        if geometry.terrain is None:
            planes = np.vstack([[0.0, 0.0, -1.0, geometry.depth - at[2]], planes])
            numbers = np.insert(numbers, 0, SEABED)
        texels = np.zeros((2, len(planes) + 1, 4), np.float32)  # no ray hits the last one
        texels[:, -1, 3] = 1.0
        texels[0, :-1], texels[1, :-1, 0] = planes, numbers
        texture = self._context.texture((len(planes) + 1, 2), 4, texels, dtype="f4")  # exists while it is referenced
        texture.use()
        self._context.vertex_array(self._planes, []).render(vertices=3)

    def _draw_seabed(self, geometry: Geometry, terrain: Terrain, at: Floats, rotation: Floats, reach: float) -> None:
        """Draw the visible part of the grid and the flat seabed around it; cells without data are drawn as solids."""
        grid, context = terrain.grid, self._context
        low, high = self._bounds(rotation, reach)
        x, y = terrain.coordinates(at[0], at[1])
        rows, north = nodes(x, grid.rows, grid.resolution, low[0], high[0], 2.0 * reach)
        columns, east = nodes(y, grid.columns, grid.resolution, low[1], high[1], 2.0 * reach)
        most = context.info["GL_MAX_TEXTURE_SIZE"]
        if max(len(rows), len(columns)) > most:
            raise ConfigError(f"{_KEY} sees {most} nodes of a terrain at most: lower max_range")
        depths = window(terrain, geometry.depth, rows, columns)
        unknown = np.isnan(depths)
        depths = np.where(unknown, _UNKNOWN, depths - at[2]).astype(np.float32)
        texture = context.texture((len(columns), len(rows)), 1, depths, dtype="f4")
        texture.use()
        strips = np.stack([north[:-1], north[1:]], axis=1).astype(np.float32)
        cells = np.stack([east[:-1], east[1:]], axis=1).astype(np.float32).repeat(6, axis=0)
        content = [(context.buffer(cells), "2f", "east"), (context.buffer(strips), "2f/i", "north")]
        context.vertex_array(self._seabed, content).render(instances=len(strips))
        walls = columns_without_data(unknown, north, east, 2.0 * reach)
        self._draw_solids(walls, np.full(len(walls), SEABED))

    def _bounds(self, rotation: Floats, reach: float) -> tuple[Floats, Floats]:
        """Return the lower and upper bounds (m from the camera, NED) of the points that it may see."""
        right, down = 0.5 * self._size[0] / self._focal, 0.5 * self._size[1] / self._focal
        corners = [(1.0, x * right, y * down) for x, y in product((-1.0, 1.0), repeat=2)]
        places = reach * np.array([(0.0, 0.0, 0.0), *corners]) @ rotation.T
        return places.min(axis=0).clip(-reach), places.max(axis=0).clip(max=reach)

    def _draw_meshes(self, rows: Floats) -> None:
        for index in np.flatnonzero(rows[:, KIND] == MESH).tolist():
            if index not in self._meshes:
                self._meshes[index] = self._load(self._solid_at(index))
            mesh, vertices = self._meshes[index]
            self._mesh["position"] = tuple(rows[index, POSITION:ROTATION])
            self._mesh["turn"] = tuple(rows[index, ROTATION:SIZES].reshape(3, 3).T.ravel())
            self._mesh["number"] = index + 1
            self._mesh["net"] = tuple(rows[index, SIZES : SIZES + 2])
            mesh.render(vertices=vertices)

    def _load(self, solid: Solid) -> "tuple[VertexArray, int]":
        """Return the vertex array of a mesh (corner, normal, position in a net's lattice) and its number of corners."""
        corners = np.array(solid.triangles).reshape(-1, 3, 3)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.sqrt((across * across).sum(axis=1))
        some = length > 0.0
        normals = (across[some] / length[some, None])[:, None].repeat(3, axis=1)
        sides = np.linalg.norm(corners[some, 1:] - corners[some, :1], axis=2)
        along = sides[:, None] * np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
        data = np.concatenate([corners[some], normals, along], axis=2).astype(np.float32)
        content = [(self._context.buffer(data), "3f 3f 2f", "corner", "normal", "along")]
        return self._context.vertex_array(self._mesh, content), 3 * len(data)

    def _draw_solids(self, rows: Floats, numbers: NDArray[np.int64]) -> None:
        """Draw spheres, cylinders and boxes, by the far sides of the bounding box of each."""
        if not len(rows):
            return
        context = self._context
        context.enable_only(context.DEPTH_TEST | context.CULL_FACE)
        context.cull_face = "back"
        solids = context.buffer(instances(rows, numbers)), _SOLID, "position", "turn", "low", "high", "kind"
        context.vertex_array(self._primitive, [(self._cube, "3f", "corner"), solids]).render(instances=len(rows))
        context.enable_only(context.DEPTH_TEST)


def straightened(lens: Floats, pixels: int, focal: float) -> tuple[tuple[int, int], Integers]:
    """Return the size of an undistorted picture with the field of view of a lens, and its nearest pixel for each ray.

    `lens` are the unit vectors (n x 3) of the `pixels`. Raises ConfigError for a too wide field of view.
    """
    ends = lens[:, 1:] / np.maximum(lens[:, :1], 1e-3) * focal
    half = np.ceil(np.abs(ends).max(axis=0)).astype(int) + 1
    width, height = (2 * half + 1).tolist()
    if width * height > MAX_WIDER * pixels or lens[:, 0].min() <= 0.0:
        raise ConfigError(f'{_KEY}: this lens sees too far to the sides; take renderer = "rays", or less distortion')
    columns, rows = np.rint(ends + half).astype(np.int64).T
    return (width, height), rows * width + columns


def along_plane(normals: Any, ray: Any, other_ray: Any) -> Any:
    """Return the ratio of lengths of `other_ray` (3 x n) to `ray` (3 x n) up to planes with `normals` (n x 3).

    1 where the plane is nearly parallel to the ray, because the surface may end before.
    """
    down, across = np.einsum("ri,ir->r", normals, ray), np.einsum("ri,ir->r", normals, other_ray)
    with np.errstate(all="ignore"):
        ratio = down / across
    return np.where((ratio > 1.0 / MAX_STRETCH) & (ratio < MAX_STRETCH), ratio, np.float32(1.0))


def nodes(at: float, count: int, spacing: float, low: float, high: float, far: float) -> tuple[Integers, Floats]:
    """Return the nodes of an axis that are about `low` to `high` m from the camera, and their distances from it (m).

    The camera is at node `at` (not rounded) of `count` nodes with `spacing` m between them. At each end of the grid two
    nodes are added, one at the edge and one `far` m away: the step to the flat seabed, and the flat seabed.
    """
    first = min(max(floor(at + low / spacing), -2), count)
    last = max(min(ceil(at + high / spacing), count + 1), -1)
    numbers = np.arange(first, last + 1)
    distances = (numbers.clip(0, count - 1) - at) * spacing
    if first == -2:
        distances[0] = min(-far, distances[0])
    if last == count + 1:
        distances[-1] = max(far, distances[-1])
    return numbers, distances


def window(terrain: Terrain, outside: float, rows: Integers, columns: Integers) -> Floats:
    """Return the depths (m) at these nodes, `outside` beyond the grid, nan without data."""
    grid = terrain.grid
    depths = np.asarray(terrain.depths).reshape(grid.rows, grid.columns)
    nodes: Floats = depths[np.ix_(rows.clip(0, grid.rows - 1), columns.clip(0, grid.columns - 1))].astype(np.float64)
    nodes[(rows < 0) | (rows >= grid.rows)] = outside
    nodes[:, (columns < 0) | (columns >= grid.columns)] = outside
    return nodes


def columns_without_data(unknown: NDArray[np.bool_], north: Floats, east: Floats, far: float) -> Floats:
    """Return rows of boxes, from `far` m above to below, on cells with an `unknown` node; without the inner cells."""
    cells = unknown[:-1, :-1] | unknown[:-1, 1:] | unknown[1:, :-1] | unknown[1:, 1:]
    cells &= (np.diff(north) > 0.0)[:, None] & (np.diff(east) > 0.0)
    around = np.pad(cells, 1, mode="edge")
    row, column = np.nonzero(cells & ~(around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:]))
    boxes = np.zeros((len(row), ROW))
    boxes[:, KIND], boxes[:, ROTATION:SIZES] = BOX, ALONG_AXES
    boxes[:, SIZES : SIZES + 4] = np.stack([north[row], north[row + 1], east[column], east[column + 1]], axis=1)
    boxes[:, SIZES + 4 : SIZES + 6] = -far, far
    return boxes


def instances(rows: Floats, numbers: Integers) -> NDArray[np.float32]:
    """Return the input of the program for solids: position, rotation, bounding box, radius, kind, number of each."""
    sizes, kind = rows[:, SIZES:ROOT], rows[:, KIND : KIND + 1]
    low = np.where(kind == BOX, sizes[:, 0::2], -sizes[:, :1])
    high = np.where(kind == BOX, sizes[:, 1::2], sizes[:, :1])
    upright = rows[:, KIND] == CYLINDER
    low[upright, 2], high[upright, 2] = sizes[upright, 1], sizes[upright, 2]
    return np.hstack([rows[:, POSITION:SIZES], low, high, sizes[:, :1], kind, numbers[:, None]]).astype(np.float32)


def _cube() -> NDArray[np.float32]:
    """Return the twelve triangles of a unit cube, with corners clockwise as seen from outside."""
    corners = []
    for axis, side in product(range(3), (0.0, 1.0)):
        square = [np.insert(np.array(pair), axis, side) for pair in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))]
        corners += [square[i] for i in ((0, 1, 2, 0, 2, 3) if (side == 1.0) == (axis != 1) else (3, 2, 1, 3, 1, 0))]
    return np.array(corners, np.float32)


@lru_cache(maxsize=1)
def open_context() -> "Context":
    """Return the OpenGL context that all cameras of the process share. Raises MissingExtraError, ConfigError."""
    try:
        import moderngl
    except ImportError:
        raise MissingExtraError(f"{_KEY} needs moderngl: pip install 'uuv-hil[opengl]'") from None
    try:
        context = moderngl.create_context(require=330, standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # noqa: BLE001 - moderngl raises a plain Exception
        remedy = 'apt install libegl1 libgl1 libgl1-mesa-dri, or renderer = "rays"'
        raise ConfigError(f"{_KEY}: no OpenGL 3.3 by EGL here ({error}): {remedy}") from None
    context.gc_mode = "auto"
    return context

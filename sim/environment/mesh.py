"""Meshes that stand, lie or hang in a world: `[[mesh]]` of its file, an OBJ, STL, DAE, GLB, PLY or OFF.

[[mesh]]
file = "wreck.glb"             # beside the world's file
north = 20.0
east = 5.0
depth = 17.5                   # of the mesh's origin
orientation = ["0 deg", "5 deg", "120 deg"]   # roll, pitch and yaw
scale = 0.001                  # its coordinates are in millimetres

A file's axes are x forward, y left and z up, as in ROS; with `up = "y"` z is forward, x left and y up, as in glTF; this
is the default for .glb and .gltf. Without roll, pitch and yaw, forward is north. A mesh is only a surface: a vehicle
that starts inside of it is in free water.
"""

import os
import sys
from array import array
from collections.abc import Iterator, Sequence
from functools import lru_cache
from math import sqrt
from typing import Annotated, Any, Literal, NamedTuple

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.schema import Range, parse_rows, read_each
from hil.common.tables import check_file
from hil.common.vectors import Vector3
from sim.environment.obstacles import Coordinate, Heading, Separation
from sim.rotations import from_euler, matrix
from sim.vehicle.mesh_files import MAX_BYTES, load_parts

MAX_TRIANGLES = 5_000_000
MIN_SIZE = 1e-3  # m
_FEW_NUMBERS = 1000  # which numpy does not transform faster
Share = Annotated[float, Range(0.0, 1.0)]
Triangle = tuple[Vector3, Vector3, Vector3]


class MeshKeys(NamedTuple):
    """The keys of a `[[mesh]]`: see the top of this module.

    `colour` is its reflectance for red, green and blue (white: 1). If left out, it is the mean of the file's materials,
    textures and colours of corners, or a common paint if there are none. `echo` (dB) is how much stronger than other
    objects it reflects a sonar's sound. If `hidden` it is not on any planner's map; `name` is for reports.
    """

    file: str
    north: Coordinate
    east: Coordinate
    depth: Annotated[float, Range(-100.0, 11_000.0, "m")] = 0.0
    orientation: tuple[Heading, Heading, Heading] = (0.0, 0.0, 0.0)
    scale: Annotated[float, Range(1e-6, 1e6)] = 1.0
    up: Literal["", "y", "z"] = ""
    colour: tuple[Share, Share, Share] | None = None
    echo: Annotated[float, Range(-60.0, 60.0, "dB")] = 0.0
    hidden: bool = False
    name: str = ""


class MeshObstacle(NamedTuple):
    """A mesh at its position in a world.

    `triangles` are in its own axes (m; forward, right, down), nine numbers each, and `rotation` (3 x 3, row after row)
    converts these to NED. `radius` (m) is its greatest horizontal distance from `north`, `east`. `net` is
    None, or, for a net, the distance of twines along the sides at a triangle's first corner, and their thickness (m).
    """

    keys: MeshKeys
    triangles: "array[float]"
    rotation: Sequence[float]
    radius: float
    top: float
    bottom: float
    net: tuple[float, float] | None = None

    @property
    def north(self) -> float:
        """North of its origin, m."""
        return self.keys.north

    @property
    def east(self) -> float:
        """East of its origin, m."""
        return self.keys.east

    @property
    def hidden(self) -> bool:
        """True if it is not on any planner's map."""
        return self.keys.hidden

    @property
    def label(self) -> str:
        """Name for messages."""
        return self.keys.name or f"the mesh at ({self.north:g}, {self.east:g})"

    def separation(self, north: float, east: float) -> Separation:
        """Return the distance (m) from its bounding cylinder, negative inside, and the direction away from its axis."""
        x, y = north - self.north, east - self.east
        distance = sqrt(x * x + y * y)
        out = (x / distance, y / distance) if distance else (1.0, 0.0)
        return distance - self.radius, *out

    @property
    def placed(self) -> "array[float]":
        """The triangles in NED (m), nine numbers each. They are computed each time."""
        return place(self.keys, self.rotation, self.triangles)

    def corners(self) -> Iterator[Vector3]:
        """Return the corners of its triangles (NED, m)."""
        placed = self.placed
        return zip(placed[0::3], placed[1::3], placed[2::3], strict=True)

    def between(self, highest: float, lowest: float) -> Iterator[Triangle]:
        """Yield the triangles (NED) that are at least partly between two depths (m)."""
        corners = self.corners()
        for triangle in zip(corners, corners, corners, strict=True):
            a, b, c = triangle[0][2], triangle[1][2], triangle[2][2]
            if (a < lowest or b < lowest or c < lowest) and (a > highest or b > highest or c > highest):
                yield triangle


def read_meshes(rows: Any, where: str) -> tuple[MeshObstacle, ...]:
    """Return the meshes of an array of tables of a world at `where`, its file and key.

    Raises ConfigError, MissingExtraError.
    """
    folder = os.path.dirname(where.rpartition(": ")[0])
    places = [(keys, f"{where}[{i}]") for i, keys in enumerate(parse_rows(rows, MeshKeys, where))]
    return tuple(read_each(places, lambda keys, place: load_obstacle(keys, folder, place)))


def load_obstacle(keys: MeshKeys, folder: str, where: str = "mesh") -> MeshObstacle:
    """Return the mesh of a file in `folder` at its position. Raises ConfigError that begins with `where`."""
    file = os.path.join(folder, keys.file)
    check_file(file, MAX_BYTES)
    up = keys.up or ("y" if file.lower().endswith((".glb", ".gltf")) else "z")
    triangles, colour = _read(file, os.stat(file).st_mtime_ns, keys.scale, up, where, keys.colour is None)
    return place_triangles(keys._replace(colour=keys.colour or colour), triangles)


def place_triangles(keys: MeshKeys, triangles: "array[float]", net: tuple[float, float] | None = None) -> MeshObstacle:
    """Return the obstacle of `triangles` (in their own axes) at the position of `keys`; `net` as in MeshObstacle."""
    rotation = matrix(from_euler(*keys.orientation))
    placed = place(keys, rotation, triangles)
    norths, easts, depths = (placed[axis::3] for axis in range(3))
    if numpy := _numpy():
        away: Any = ((numpy.asarray(norths) - keys.north) ** 2 + (numpy.asarray(easts) - keys.east) ** 2).max()
    else:
        away = max((n - keys.north) ** 2 + (e - keys.east) ** 2 for n, e in zip(norths, easts, strict=True))
    return MeshObstacle(keys, triangles, rotation, sqrt(away), min(depths), max(depths), net)


def place(keys: MeshKeys, rotation: Sequence[float], triangles: "array[float]") -> "array[float]":
    """Return triangles at the position of `keys` (NED, m)."""
    numpy, placed, columns = _numpy(), triangles[:], [triangles[axis::3] for axis in range(3)]
    for axis, origin in enumerate((keys.north, keys.east, keys.depth)):
        a, b, c = rotation[3 * axis : 3 * axis + 3]
        if numpy and len(triangles) > _FEW_NUMBERS:
            x, y, z = map(numpy.asarray, columns)
            placed[axis::3] = array("d", (origin + a * x + b * y + c * z).tobytes())
        else:
            placed[axis::3] = array("d", [origin + a * x + b * y + c * z for x, y, z in zip(*columns, strict=True)])
    return placed


def _numpy() -> Any:
    """Return numpy if it is loaded: it is with a mesh's file, but shapes do without its 0.1 s."""
    return sys.modules.get("numpy")


@lru_cache(maxsize=32)
def _read(
    file: str, _mtime_ns: int, scale: float, up: str, where: str, with_colour: bool
) -> tuple["array[float]", tuple[float, float, float] | None]:
    """Return the triangles of a file in m, forward, right and down, and its colour: None without, or if not wanted."""
    try:
        import numpy as np
        import trimesh  # noqa: F401 - imported here to name the missing extra
    except ImportError:
        raise MissingExtraError(f"{where}: file: meshes need trimesh: pip install 'uuv-hil[mesh]'") from None
    ending = os.path.splitext(file)[1]
    _check_count(_declared_count(file), file, where)  # before reading takes seconds and a gigabyte
    try:
        parts = [part for part in load_parts(file, with_colour) if hasattr(part, "triangles")]  # also lines and points
        triangles = np.concatenate([np.empty((0, 3, 3)), *(np.asarray(part.triangles, float) for part in parts)])
        triangles *= scale
        colour = _colour(parts, file) if with_colour else None
        del parts
    except ConfigError:
        raise
    except Exception as error:  # noqa: BLE001 - readers raise any exception for damaged files
        raise ConfigError(
            f"{where}: file: {file}: no mesh that can be read ({type(error).__name__}): damaged, or no {ending}"
        ) from None
    if not len(triangles) or not np.isfinite(triangles).all():
        raise ConfigError(
            f"{where}: file: {file}: no triangles, or corners that are no numbers: look whether it is a whole {ending}"
        )
    _check_count(len(triangles), file, where)
    size = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    if size < MIN_SIZE:
        raise ConfigError(f"{where}: file: {file}: is {size:.3g} m large, less than {MIN_SIZE:g} m: set scale")
    order, signs = ([2, 0, 1], (1.0, -1.0, -1.0)) if up == "y" else ([0, 1, 2], (1.0, -1.0, -1.0))
    own = array("d")
    own.frombytes(np.ascontiguousarray(triangles[..., order] * signs).data.cast("B"))
    return own, colour


def _colour(parts: Sequence[Any], file: str) -> tuple[float, float, float] | None:
    """Return the mean colour of the meshes of a file; None if it has none, or damaged textures."""
    from sim.vehicle.mesh_materials import mean_reflectance

    try:
        return mean_reflectance(parts, is_linear=file.lower().endswith((".glb", ".gltf")))
    except Exception:  # noqa: BLE001 - readers of images raise any exception for damaged ones
        return None


def _check_count(count: int, file: str, where: str) -> None:
    if count > MAX_TRIANGLES:
        raise ConfigError(f"{where}: file: {file}: {count} triangles are more than {MAX_TRIANGLES}: simplify the mesh")


def _declared_count(file: str) -> int:
    """Return the number of triangles in the header of a binary STL; 0 for other files."""
    if not file.lower().endswith(".stl"):
        return 0
    with open(file, "rb") as stream:
        count = int.from_bytes(stream.read(84)[80:], "little")
    return count if os.stat(file).st_size == 84 + 50 * count else 0

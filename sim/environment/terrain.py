"""A seabed with relief: depths at the nodes of a regular grid, and a bilinear surface in each cell.

[terrain]                      # depths in a file
file = "bay.f32"               # beside the world's file
north_min = -200.0
east_min = -150.0
resolution = 2.0
rows = 201
columns = 151

[terrain]                      # generated depths (sim/environment/relief.py), over the whole extent of the world
kind = "slope"
depth = 12.0
slope = 0.1

The file is row after row of little-endian 32-bit floats: row i lies at north = north_min + i resolution, column j at
east = east_min + j resolution, each value is the depth of the seabed in m, land negative. The file is memory-mapped, so
that a chart of any size takes only the memory of the pages in use.

Beyond the grid the seabed is flat, at the world's `depth`. A node without data is NaN; the cells around it are a wall
from the seabed to `NO_DATA` m, because it is unknown whether a vehicle can pass there.
"""

import os
import sys
from contextlib import suppress
from math import ceil, isnan, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import parse, parse_kind
from hil.common.tables import check_file
from hil.common.vectors import Vector3
from sim.environment.terrain_grid import Count, Edge, Grid, Resolution

if TYPE_CHECKING:
    from array import array

    Depths = memoryview[float] | array[float]

Extent = tuple[float, float, float, float]

NO_DATA = -100.0  # m: the upper end of a wall, 100 m above the water as that of an obstacle by default
_MAX_NODES = 1 << 22  # of a generated relief: some seconds, 16 MiB


class Terrain:
    """Depths in m at the nodes of `grid`, row after row, as a buffer of 32-bit floats; `outside` m beyond the grid."""

    def __init__(self, grid: Grid, depths: "Depths", outside: float) -> None:
        if len(depths) != grid.rows * grid.columns:
            raise ValueError(f"{len(depths)} depths for {grid.rows} x {grid.columns} nodes")
        self.grid = grid
        self.depths = depths
        self.outside = outside
        self.scale = 1.0 / grid.resolution

    def depth(self, north: float, east: float) -> float:
        """Return the depth (m) of the seabed at a position."""
        corners = self._corners(north, east)
        if corners is None:
            return self.outside
        u, v, a, b, c, d = corners
        depth = a + (c - a) * u + (b - a) * v + (a - b - c + d) * u * v
        return NO_DATA if isnan(depth) else depth

    def gradient(self, north: float, east: float) -> tuple[float, float]:
        """Return the increase of depth per m to the north and to the east; 0 beyond the grid and in a wall."""
        corners = self._corners(north, east)
        if corners is None:
            return 0.0, 0.0
        u, v, a, b, c, d = corners
        twist = a - b - c + d
        to_north, to_east = ((c - a) + twist * v) * self.scale, ((b - a) + twist * u) * self.scale
        return (0.0, 0.0) if isnan(to_north + to_east) else (to_north, to_east)

    def normal(self, north: float, east: float) -> Vector3:
        """Return the unit normal of the seabed, into the water (NED)."""
        to_north, to_east = self.gradient(north, east)
        scale = 1.0 / sqrt(to_north * to_north + to_east * to_east + 1.0)
        return to_north * scale, to_east * scale, -scale

    def shallowest(self, north: float, east: float, around: float) -> float:
        """Return a lower bound of the depth in a square of half side `around` m: the least depth of its nodes."""
        rows, columns = self.grid.rows, self.grid.columns
        (x, y), size = self.coordinates(north, east), around * self.scale
        top, bottom, left, right = int(x - size), ceil(x + size), int(y - size), ceil(y + size)
        least = self.outside if x < size or y < size or bottom >= rows or right >= columns else 1e9
        for row in range(max(top, 0), min(bottom + 1, rows)):
            for depth in self.depths[row * columns + max(left, 0) : row * columns + min(right + 1, columns)]:
                if not depth >= least:
                    least = NO_DATA if isnan(depth) else min(least, depth)
        return least

    def unmap(self) -> None:
        """Release the memory pages of a mapped file; the operating system reads them again when they are needed.

        It maps 64 KiB around each access, so accesses all over a large world need much memory together.
        """
        if isinstance(self.depths, memoryview):
            import mmap

            file: object = self.depths.obj
            if isinstance(file, mmap.mmap) and hasattr(file, "madvise"):  # not on Windows
                with suppress(OSError):  # fails if the pages are locked in memory
                    file.madvise(mmap.MADV_DONTNEED)

    def coordinates(self, north: float, east: float) -> tuple[float, float]:
        """Return row and column of a position, not rounded."""
        return (north - self.grid.north_min) * self.scale, (east - self.grid.east_min) * self.scale

    def _corners(self, north: float, east: float) -> tuple[float, float, float, float, float, float] | None:
        """Return the position in its cell (0 to 1 north, east), and the depths of the cell's four nodes.

        The nodes are the south-west, south-east, north-west and north-east one. None beyond the grid.
        """
        _, _, _, rows, columns = self.grid
        x, y = self.coordinates(north, east)
        if not (0.0 <= x <= rows - 1 and 0.0 <= y <= columns - 1):
            return None
        row, column = min(int(x), rows - 2), min(int(y), columns - 2)
        first, depths = row * columns + column, self.depths
        second = first + columns
        return x - row, y - column, depths[first], depths[first + 1], depths[second], depths[second + 1]


class StoredKeys(NamedTuple):
    """The keys of a `[terrain]` in a file: see the top of this module."""

    file: str
    north_min: Edge
    east_min: Edge
    resolution: Resolution
    rows: Count
    columns: Count


def parse_terrain(section: Any, where: str) -> Any:
    """Return the keys of a world's `[terrain]`: StoredKeys, or those of a relief. Raises ConfigError at `where`."""
    if not isinstance(section, dict) or ("file" in section) == ("kind" in section):
        raise ConfigError(f'{where}: expected a table with either file = "NAME.f32" or kind = "slope"')
    if "file" in section:
        return parse(section, StoredKeys, where)
    from sim.environment.relief import KINDS

    return parse_kind(section, KINDS, where)


def make_terrain(keys: Any, path: str, extent: Extent, depth: float) -> Terrain:
    """Return the terrain of the `keys` in the world's file `path`; beyond it the seabed is at `depth` m.

    Raises ConfigError for a file that is missing or whose size does not match rows and columns, and for a relief of too
    many nodes.
    """
    if isinstance(keys, StoredKeys):
        grid = Grid(*keys[1:])
        return Terrain(grid, _mapped(os.path.join(os.path.dirname(path), keys.file), grid), depth)
    grid = covering(extent, keys.resolution)
    if grid.rows * grid.columns > _MAX_NODES:
        problem = f"{grid.rows} x {grid.columns} nodes are too many: make it coarser"
        raise ConfigError(f"{path}: terrain: resolution: {problem}")
    return Terrain(grid, keys.depths(grid), depth)


def covering(extent: Extent, resolution: float) -> Grid:
    """Return the grid from the south-west corner of `extent` to its north-east corner, or at most a cell beyond."""
    north_min, north_max, east_min, east_max = extent
    rows, columns = (
        ceil((high - low) / resolution) + 1 for low, high in ((north_min, north_max), (east_min, east_max))
    )
    return Grid(north_min, east_min, resolution, rows, columns)


def _mapped(path: str, grid: Grid) -> "memoryview[float]":
    from mmap import ACCESS_READ, mmap

    expected = 4 * grid.rows * grid.columns
    check_file(path, sys.maxsize)
    try:
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size != expected:
                raise ConfigError(f"{path}: {size} bytes, but {grid.rows} x {grid.columns} depths are {expected}")
            return memoryview(mmap(file.fileno(), 0, access=ACCESS_READ)).cast("f")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None

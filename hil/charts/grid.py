"""The seabed as a grid of depths."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from errno import EISDIR
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from sim.environment.world import World

Array = NDArray[np.float64]
Depths = NDArray[np.float32]
Extent = tuple[float, float, float, float]  # north_min, north_max, east_min, east_max, m

STRIP_ROWS = 64  # rows read before the pages of a memory-mapped file are released
FLAT_CELLS = 100  # along the longer side of the grid of a world without relief


class Grid(NamedTuple):
    """Depths of the seabed at the nodes of a square grid.

    `depths`: (rows, columns) float32, m, positive down; land is negative, unknown is nan. Row i lies at
    `north_min` + i `resolution`, column j at `east_min` + j `resolution` (m from the world's origin).
    """

    depths: Depths
    north_min: float
    east_min: float
    resolution: float

    @property
    def north(self) -> Array:
        """North of each row, m."""
        return np.asarray(self.north_min + self.resolution * np.arange(self.depths.shape[0]))

    @property
    def east(self) -> Array:
        """East of each column, m."""
        return np.asarray(self.east_min + self.resolution * np.arange(self.depths.shape[1]))

    @property
    def extent(self) -> Extent:
        """Least and greatest north and east of the nodes, m."""
        north, east = self.north, self.east
        return float(north[0]), float(north[-1]), float(east[0]), float(east[-1])

    @property
    def deepest(self) -> float:
        """The greatest depth, m."""
        return float(np.nanmax(self.depths))

    def at(self, points: Array) -> Array:
        """Return the depths at `points` (n, 2) north, east by bilinear interpolation; nan outside or next to a nan."""
        rows, columns = self.depths.shape
        scaled = (points - (self.north_min, self.east_min)) / self.resolution
        cell = np.clip(np.floor(scaled).astype(np.intp), 0, (rows - 2, columns - 2))
        (i, j), (u, v) = cell.T, (scaled - cell).T
        d = self.depths
        with np.errstate(invalid="ignore"):  # depths may be nan
            depth = (1 - u) * ((1 - v) * d[i, j] + v * d[i, j + 1]) + u * ((1 - v) * d[i + 1, j] + v * d[i + 1, j + 1])
        outside = ((scaled < 0.0) | (scaled > (rows - 1, columns - 1))).any(axis=1)
        return np.where(outside, np.nan, depth)


def grid_of(world: World, resolution: float | None = None) -> Grid:
    """Return the seabed of `world`: the grid of its terrain, or a flat one, at `resolution` (m) if given."""
    frame = frame_of(world, resolution)
    if world.terrain is not None and frame.resolution == world.terrain.grid.resolution:
        return frame
    depths = np.empty(frame.depths.shape, np.float32)
    for first in range(0, len(depths), STRIP_ROWS):
        depths[first : first + STRIP_ROWS] = read_rows(world, frame, slice(first, first + STRIP_ROWS))
    return frame._replace(depths=depths)


def frame_of(world: World, resolution: float | None = None) -> Grid:
    """Return the grid that `grid_of` returns, but without memory for its depths, to be read by `read_rows`.

    The depths are read-only: those of the terrain (a mapped file), or one constant.
    """
    terrain = world.terrain
    if terrain is not None and resolution in (None, terrain.grid.resolution):
        place = terrain.grid
        depths = np.asarray(terrain.depths, np.float32).reshape(place.rows, place.columns)
        return Grid(depths, place.north_min, place.east_min, place.resolution)
    south, north, west, east = world.extent
    step = resolution or max(north - south, east - west) / FLAT_CELLS
    rows, columns = (max(2, int((high - low) / step + 1e-9) + 1) for low, high in ((south, north), (west, east)))
    return Grid(np.broadcast_to(np.float32(world.depth), (rows, columns)), south, west, step)


def read_rows(world: World, frame: Grid, rows: slice) -> Depths:
    """Return the depths of some rows of the grid of `world`; `frame`: its `frame_of`. Releases mapped pages."""
    if world.terrain is None:
        return frame.depths[rows]
    whole_grid, columns = frame_of(world), frame.depths.shape[1]
    if frame.resolution == whole_grid.resolution:
        depths = np.array(frame.depths[rows])
    else:
        places = (np.column_stack([np.full(columns, north), frame.east]) for north in frame.north[rows])
        depths = np.array([whole_grid.at(row) for row in places], np.float32)
    world.terrain.unmap()
    return depths


def thinning_step(grid: Grid, most: int) -> int:
    """Return the least step by which a grid has at most `most` nodes along its longer side."""
    return -(-int(max(grid.depths.shape)) // most)


def overview(world: World, most: int, resolution: float | None = None) -> Grid:
    """Return the grid of `world`, thinned by an integer step if it has more than `most` nodes along a side.

    Only the rows that are needed are read, and the pages of a mapped file are released.
    """
    south, north, west, east = world.extent
    terrain = world.terrain
    if terrain is None or resolution not in (None, terrain.grid.resolution):
        return grid_of(world, resolution and max(resolution, max(north - south, east - west) / (most - 1)))
    whole_grid = grid_of(world)
    step = thinning_step(whole_grid, most)
    if step == 1:
        return whole_grid
    thin = np.empty(whole_grid.depths[::step, ::step].shape, np.float32)
    for row in range(len(thin)):
        thin[row] = whole_grid.depths[row * step, ::step]
        if row % STRIP_ROWS == 0:
            terrain.unmap()
    terrain.unmap()
    return whole_grid._replace(depths=thin, resolution=whole_grid.resolution * step)


def round_up(value: float, slack: float = 1e-9) -> float:
    """Return `value` rounded up to two significant digits; an excess below `slack` of the last digit is ignored."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 1.0)
    return float(f"{np.ceil(value / digit - slack) * digit:.6g}")


def write_file(path: str, data: bytes) -> None:
    """Write a file atomically: an old file is replaced when all of the new one is written. Raises ConfigError."""
    write_files({path: data})


def write_files(contents: Mapping[str, bytes]) -> None:
    """Write several files, given by path, which replace old ones when all are written. Raises ConfigError."""
    with written_whole(*contents) as names:
        for name, data in zip(names, contents.values(), strict=True):
            with open(name, "wb") as file:
                file.write(data)


@contextmanager
def written_whole(*paths: str) -> Iterator[list[str]]:
    """Return a context with temporary names for files, which are renamed to `paths` at its end, or removed on an error.

    Makes the folders of `paths`. Raises ConfigError for an OSError.
    """
    fresh = {f"{path}.{os.getpid()}": path for path in paths}
    path = paths[0]
    try:
        for path in paths:
            os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
            if os.path.isdir(path):
                raise IsADirectoryError(EISDIR, os.strerror(EISDIR), path)
        yield list(fresh)
        for name, path in fresh.items():
            os.replace(name, path)
    except OSError as error:
        path = fresh.get(str(error.filename), path)
        raise ConfigError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        for left in filter(os.path.exists, fresh):
            os.remove(left)

"""Occupancy grids: maps of cells that a vehicle must avoid, and their ROS map files."""

import os
import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import ceil, floor, hypot
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.curves import Position
from hil.common.errors import ConfigError
from hil.common.tables import read_bytes
from hil.common.text import clean

Point = tuple[float, float]  # north, east in m
Cell = tuple[int, int]  # row, column; rows count to the north, columns to the east

LARGEST_YAML = 1 << 20  # bytes; a map_server file has some hundred
LARGEST_IMAGE = 1 << 28  # bytes: 16,384 x 16,384 cells
STRIP = 1 << 17  # cells that are processed together, to limit intermediate results to some MB
LONGEST_HEADER = 1 << 16  # bytes, most of which may be comments
FINEST, COARSEST = 1e-3, 1e3  # m, limits of the cell size
MAX_ORIGIN = 1e5  # m north and east, as for a world
_PGM_HEADER = re.compile(rb"P5" + 2 * rb"(?:\s|#[^\n]*\n)+([0-9]{1,9})" + rb"(?:\s|#[^\n]*\n)+255\s")

_GREY = np.array((254, 0), np.uint8)  # values of free and occupied cells, as written by ROS map_saver
# A line is checked with this half width (in cells), so that it cannot pass between two cells at a corner.
_HALF_WIDTH = 1e-6


class Extent(NamedTuple):
    """A rectangle of the map, in m north and east of the world's origin."""

    south: float
    west: float
    north: float
    east: float


class OccupancyGrid:
    """Square cells, each free or occupied. Points off the map count as occupied.

    `cells`: bool array, True for occupied; row 0 is the southernmost, column 0 the westernmost. `resolution`: size of a
    cell, m. `origin`: north and east (m) of the map's south-west corner. `is_open`: the
    water goes on beyond the map's edges, for a vehicle that needs room to turn.
    """

    def __init__(self, cells: NDArray[np.bool_], resolution: float, origin: Point) -> None:
        self.cells = cells
        self.resolution = resolution
        self.origin = origin
        self.is_open = False

    @classmethod
    def empty(cls, extent: Extent, resolution: float) -> "OccupancyGrid":
        """Return a map of `extent` (m) without obstacles. Raises ConfigError."""
        return cls.rasterise(lambda north, east: np.inf + 0.0 * north, extent, resolution)

    @classmethod
    def rasterise(
        cls,
        clearance: Callable[[Any, Any], Any],
        extent: Extent,
        resolution: float,
    ) -> "OccupancyGrid":
        """Return a map of `extent`; a cell is occupied if there is no clearance at its centre.

        `clearance(norths, easts)` returns the distances (m) to the nearest obstacle, negative inside. An obstacle
        smaller than a cell may be missed between centres. Raises ConfigError if the extent contains no cell or too
        many.
        """
        rows = ceil((extent.north - extent.south) / resolution - 1e-9)
        columns = ceil((extent.east - extent.west) / resolution - 1e-9)
        if rows < 1 or columns < 1:
            raise ConfigError(f"map: an extent of {extent} m holds no cell of {resolution} m")
        if rows * columns > LARGEST_IMAGE:
            fits = resolution * (rows * columns / LARGEST_IMAGE) ** 0.5
            raise ConfigError(
                f"map: {rows} x {columns} cells of {resolution:g} m are more than {LARGEST_IMAGE}: "
                f"make the resolution {ceil(100.0 * fits) / 100.0:g} m or coarser"
            )
        north = extent.south + resolution * (np.arange(rows) + 0.5)
        east = extent.west + resolution * (np.arange(columns) + 0.5)
        cells = np.empty((rows, columns), bool)
        for part in _strips(rows, columns):
            free = clearance(*np.meshgrid(north[part], east, indexing="ij")) > 0.0
            cells[part] = ~free
        return cls(cells, resolution, (extent.south, extent.west))

    def inflate(self, radius: float) -> "OccupancyGrid":
        """Return a map with every cell occupied whose centre is within `radius` m of an occupied cell's centre."""
        reach = radius / self.resolution + 1e-9
        rows, columns = self.cells.shape
        grown = self.cells.copy()
        # number of occupied cells west of each column: a disc is a stack of runs, each a difference of two sums
        sums = np.zeros((rows, columns + 1), np.int32)
        np.cumsum(self.cells, axis=1, out=sums[:, 1:])
        index = np.arange(columns)
        for shift in range(-min(floor(reach), rows - 1), min(floor(reach), rows - 1) + 1):
            run = floor((reach * reach - shift * shift) ** 0.5)
            hit = sums[:, np.minimum(index + run + 1, columns)] > sums[:, np.maximum(index - run, 0)]
            grown[max(shift, 0) : rows + min(shift, 0)] |= hit[max(-shift, 0) : rows + min(-shift, 0)]
        inflated = OccupancyGrid(grown, self.resolution, self.origin)
        inflated.is_open = self.is_open
        return inflated

    def cell(self, point: Point) -> Cell:
        """Return the cell that contains `point`; it may be off the map."""
        north, east = self._scaled(point)
        return floor(north), floor(east)

    def centre(self, cell: Cell) -> Point:
        """Return the centre of `cell`."""
        return (
            self.origin[0] + (cell[0] + 0.5) * self.resolution,
            self.origin[1] + (cell[1] + 0.5) * self.resolution,
        )

    def contains(self, point: Point) -> bool:
        """Return whether `point` is on the map."""
        row, column = self.cell(point)
        rows, columns = self.cells.shape
        return bool(0 <= row < rows and 0 <= column < columns)

    def is_free(self, point: Point) -> bool:
        """Return whether `point` is on the map and in a free cell."""
        return self.contains(point) and not bool(self.cells[self.cell(point)])

    def are_free(self, points: Sequence[Sequence[float]]) -> bool:
        """Return whether none of these points is occupied. Points off the map are free if the map `is_open`."""
        cells = np.floor((np.asarray(points)[:, :2] - self.origin) / self.resolution).astype(np.intp)
        on_map = ((cells >= 0) & (cells < self.cells.shape)).all(axis=1)
        rows, columns = cells[on_map].T
        return not self.cells[rows, columns].any() and (self.is_open or bool(on_map.all()))

    def nearest_free(self, point: Point) -> Point | None:
        """Return the centre of the free cell nearest to `point`; None if there is none."""
        least, nearest_cell = np.inf, None
        for part in _strips(*self.cells.shape):
            free = np.argwhere(~self.cells[part]) + np.array((part.start, 0))
            if not len(free):
                continue
            distances = np.hypot(*(free + 0.5 - self._scaled(point)).T)
            nearest = int(np.argmin(distances))
            if distances[nearest] < least:
                least, nearest_cell = distances[nearest], (int(free[nearest][0]), int(free[nearest][1]))
        return self.centre(nearest_cell) if nearest_cell else None

    def line_is_free(self, start: Point, end: Point) -> bool:
        """Return whether the straight line touches only free cells; corners of occupied cells count."""
        (north, east), (to_north, to_east) = self._scaled(start), self._scaled(end)
        d_north, d_east = to_north - north, to_east - east
        length = hypot(d_north, d_east)
        if length == 0.0:
            return self.is_free(start)
        side_north, side_east = -d_east / length * _HALF_WIDTH, d_north / length * _HALF_WIDTH
        return all(
            self._strip_is_free(north + side * side_north, east + side * side_east, d_north, d_east)
            for side in (-1.0, 1.0)
        )

    def _strip_is_free(self, north: float, east: float, d_north: float, d_east: float) -> bool:
        """Return `line_is_free` in units of cells; between two crossings of grid lines the line is in one cell."""
        cuts = np.sort(np.concatenate(([0.0, 1.0], _crossings(north, d_north), _crossings(east, d_east))))
        middles = 0.5 * (cuts[1:] + cuts[:-1])
        rows = np.floor(north + middles * d_north).astype(np.intp)
        columns = np.floor(east + middles * d_east).astype(np.intp)
        height, width = self.cells.shape
        if rows.min() < 0 or columns.min() < 0 or rows.max() >= height or columns.max() >= width:
            return False
        return not self.cells[rows, columns].any()

    def _scaled(self, point: Point) -> Point:
        return (point[0] - self.origin[0]) / self.resolution, (point[1] - self.origin[1]) / self.resolution

    def write_pgm(self, path: str) -> None:
        """Write the map for ROS `map_server`: a P5 image at `path` ("x.pgm") and "x.yaml" beside it.

        ROS has x to the east and y to the north (REP 103): the first row of the image is the north edge, the origin the
        south-west corner. Raises ConfigError if the files cannot be written.
        """
        rows, columns = self.cells.shape
        north, east = self.origin
        description = (
            f"image: {os.path.basename(path)}\n"
            f"mode: trinary\n"
            f"resolution: {self.resolution:.9f}\n"
            f"origin: [{east:.9f}, {north:.9f}, 0.0]\n"
            f"negate: 0\n"
            f"occupied_thresh: 0.65\n"
            f"free_thresh: 0.196\n"
        )
        try:
            with open(path, "wb") as file:
                file.write(b"P5\n%d %d\n255\n" % (columns, rows))
                for part in reversed(_strips(rows, columns)):
                    file.write(_GREY[self.cells[part][::-1].view(np.uint8)].tobytes())
            with open(os.path.splitext(path)[0] + ".yaml", "w", encoding="utf-8") as text:
                text.write(description)
        except OSError as error:
            raise ConfigError(f"{path}: the map cannot be written: {error.strerror}") from None

    @classmethod
    def read(cls, path: str) -> "OccupancyGrid":
        """Read the map of the map_server YAML file at `path`; unknown cells count as occupied.

        Raises ConfigError unless the image is an 8-bit P5 and the origin is not rotated.
        """
        settings = _read_settings(path)
        try:
            resolution, negate = float(settings["resolution"]), settings.get("negate", "0") not in ("0", "false")
            east, north, yaw = (float(word) for word in settings["origin"].strip("[]").split(","))
            threshold = float(settings["free_thresh"])
            image = _read_pgm(os.path.join(os.path.dirname(path), settings["image"].strip("\"'")))
        except (KeyError, ValueError) as error:
            raise ConfigError(f"{path}: not a map of map_server: {clean(str(error))}") from None
        if yaw != 0.0 or not FINEST <= resolution <= COARSEST:
            raise ConfigError(
                f"{path}: a turned map or a resolution of {resolution} m cannot be used; give an origin without a turn "
                f"and a resolution of {FINEST:g} to {COARSEST:g} m"
            )
        if not (abs(north) <= MAX_ORIGIN and abs(east) <= MAX_ORIGIN and 0.0 <= threshold <= 1.0):
            raise ConfigError(
                f"{path}: an origin beyond {MAX_ORIGIN:g} m or a free_thresh that is no share: {threshold}"
            )
        occupancy = (image if negate else 255.0 - image) / 255.0
        return cls(np.ascontiguousarray(occupancy[::-1] >= threshold), resolution, (north, east))


def depths_near(course: Sequence[Position], north: Any, east: Any) -> Any:
    """Return the depths (m) of the places of a `course` (m, NED) that are nearest, seen from above, to positions.

    The positions (m) are numbers or arrays. If the course has one depth, that number is returned.
    """
    if len({depth for _, _, depth in course}) == 1:
        return course[0][2]
    least: Any = np.inf
    depths: Any = 0.0
    for (from_north, from_east, depth), end in pairwise(course):
        x, y, dive = end[0] - from_north, end[1] - from_east, end[2] - depth
        square = x * x + y * y
        share = np.clip(((north - from_north) * x + (east - from_east) * y) / square, 0.0, 1.0) if square else 1.0
        distance = np.hypot(north - from_north - share * x, east - from_east - share * y)
        depths = np.where(distance < least, depth + share * dive, depths)
        least = np.minimum(distance, least)
    return depths


def _crossings(start: float, change: float) -> NDArray[np.float64]:
    """Return where a coordinate from `start` to `start + change` crosses integers, as shares of the line."""
    if change == 0.0:
        return np.empty(0)
    low, high = min(start, start + change), max(start, start + change)
    return (np.arange(ceil(low), floor(high) + 1, dtype=np.float64) - start) / change


def _read_settings(path: str) -> dict[str, str]:
    try:
        text = read_bytes(path, LARGEST_YAML).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: the map cannot be read: {error}") from None
    lines = [line.split("#")[0].partition(":") for line in text.splitlines()]
    return {key.strip(): value.strip() for key, colon, value in lines if colon}


def _read_pgm(path: str) -> NDArray[np.uint8]:
    """Return the grey levels of a P5 file, with the top row first. Raises ConfigError or ValueError."""
    data = read_bytes(path, LARGEST_IMAGE)
    header = _PGM_HEADER.match(data, 0, LONGEST_HEADER)
    if not header:
        raise ValueError("the image is not an 8-bit P5")
    columns, rows = int(header[1]), int(header[2])
    return np.frombuffer(data, np.uint8, rows * columns, header.end()).reshape(rows, columns)


def _strips(rows: int, columns: int) -> list[slice]:
    """Return the rows divided into strips of at least two rows, if there are as many."""
    step = max(2, STRIP // columns)
    starts = [0, *range(step, rows - 1, step)]
    return [slice(start, end) for start, end in zip(starts, [*starts[1:], rows], strict=True)]

"""Choose the part of a world that a planner's map shows, and its cell size, if a map of all would be too large."""

from collections.abc import Sequence
from math import ceil, floor
from typing import NamedTuple

from hil.autonomy.paths.occupancy import Extent, Point

MAX_CELLS = 1_000_000  # limit of a map that shows the whole world; a path search takes some 25 bytes a cell
MAX_GROWN = 2_500_000  # limit of cells for a part that is enlarged in search of a path
MIN_MARGIN_CELLS = 100
MARGIN = 0.25  # margin around the places, as a share of their distance


class MapPart(NamedTuple):
    """The rectangle that a map shows, and its cell size in m: 1, 2, 4 ... times the requested one."""

    extent: Extent
    resolution: float


def map_parts(extent: Extent, resolution: float, points: Sequence[Point]) -> list[MapPart]:
    """Return the parts of `extent` (m) that a map with cells of `resolution` m may show, smallest first; at least one.

    A map of up to MAX_CELLS shows everything. Otherwise the first part contains `points` (north, east) with a margin,
    and each further part has twice the margin, up to the whole extent or MAX_GROWN cells. A part with more cells has
    cells that are 2, 4 ... times as large; this concerns the first part if the places are far apart, and the last one,
    which is the whole extent.
    """
    if _cells(extent, resolution) <= MAX_CELLS:
        return [MapPart(extent, resolution)]
    parts: list[MapPart] = []
    if points:
        norths, easts = zip(*points, strict=True)
        box = Extent(min(norths), min(easts), max(norths), max(easts))
        margin = max(MIN_MARGIN_CELLS * resolution, MARGIN * max(box.north - box.south, box.east - box.west))
        while not parts or (parts[-1].extent != extent and parts[-1].resolution == resolution):
            parts.append(_fitting(extent, resolution, box, margin))
            margin *= 2.0
        while len(parts) > 1 and parts[-1].resolution > resolution:  # the whole extent in such cells shows more
            parts.pop()
    if not parts or parts[-1].extent != extent:
        parts.append(MapPart(extent, _coarsened(extent, resolution)))
    return parts


def _fitting(extent: Extent, resolution: float, box: Extent, margin: float) -> MapPart:
    """Return the part with a margin around `box`, in the smallest cells that are few enough."""
    size = _coarsened(_cut(extent, resolution, box, margin), resolution)
    return MapPart(_cut(extent, size, box, margin), size)


def _coarsened(extent: Extent, resolution: float) -> float:
    """Return the smallest cell size, 1, 2, 4 ... times `resolution`, with which `extent` has few enough cells."""
    while _cells(extent, resolution) > MAX_GROWN:
        resolution *= 2.0
    return resolution


def _cut(extent: Extent, resolution: float, box: Extent, margin: float) -> Extent:
    """Return `box` with a margin, within `extent`, enlarged to whole cells of the map of `extent`."""
    south, north = _axis(extent.south, extent.north, resolution, box.south - margin, box.north + margin)
    west, east = _axis(extent.west, extent.east, resolution, box.west - margin, box.east + margin)
    return Extent(south, west, north, east)


def _axis(first: float, last: float, resolution: float, low: float, high: float) -> tuple[float, float]:
    """Return `low` and `high` limited to `first` and `last`, enlarged to whole cells counted from `first`."""
    before = max(0, floor((min(low, last - resolution) - first) / resolution))
    after = max(before + 1, ceil((high - first) / resolution))
    return first + before * resolution, min(last, first + after * resolution)


def _cells(extent: Extent, resolution: float) -> float:
    return (extent.north - extent.south) / resolution * ((extent.east - extent.west) / resolution)

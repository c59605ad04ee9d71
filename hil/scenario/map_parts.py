"""Choose the part of a world that a planner's map shows, and its cells, where a map of all of it would be too large."""

from collections.abc import Sequence
from math import ceil, floor
from typing import NamedTuple

from hil.autonomy.paths.occupancy import Extent, Point

MOST_CELLS = 1_000_000  # of a map that shows all of a world; a path search takes some 25 bytes a cell
MOST_GROWN = 2_500_000  # cells to which a part may grow in search of a path
LEAST_MARGIN_CELLS = 100
MARGIN = 0.25  # of the distance between the places, around them


class MapPart(NamedTuple):
    """The rectangle that a map shows and the side of its cells, m: 1, 2, 4 ... times what was asked for."""

    extent: Extent
    resolution: float


def map_parts(extent: Extent, resolution: float, places: Sequence[Point]) -> list[MapPart]:
    """Return the parts of `extent` (m) that a map in cells of `resolution` m may show, growing; at least one.

    A map of up to MOST_CELLS shows all. Otherwise a part holds `places` (north, east) with a margin, and the next ones
    are twice as wide, until they are all or more than MOST_GROWN cells. What has more cells than that, as the first
    part where places are far apart, and at last all of it, is shown in cells twice as large, four times and so on.
    """
    if _cells(extent, resolution) <= MOST_CELLS:
        return [MapPart(extent, resolution)]
    parts: list[MapPart] = []
    if places:
        norths, easts = zip(*places, strict=True)
        box = Extent(min(norths), min(easts), max(norths), max(easts))
        margin = max(LEAST_MARGIN_CELLS * resolution, MARGIN * max(box.north - box.south, box.east - box.west))
        while not parts or (parts[-1].extent != extent and parts[-1].resolution == resolution):
            parts.append(_fitting(extent, resolution, box, margin))
            margin *= 2.0
        while len(parts) > 1 and parts[-1].resolution > resolution:  # all of it in cells of that size is more
            parts.pop()
    if not parts or parts[-1].extent != extent:
        parts.append(MapPart(extent, _coarsened(extent, resolution)))
    return parts


def _fitting(extent: Extent, resolution: float, box: Extent, margin: float) -> MapPart:
    """Return the part with a margin around `box`, in the least cells of which it has not too many."""
    size = _coarsened(_cut(extent, resolution, box, margin), resolution)
    return MapPart(_cut(extent, size, box, margin), size)


def _coarsened(extent: Extent, resolution: float) -> float:
    """Return the least multiple of `resolution`, 1, 2, 4 or more times as large, of which `extent` has few cells."""
    while _cells(extent, resolution) > MOST_GROWN:
        resolution *= 2.0
    return resolution


def _cut(extent: Extent, resolution: float, box: Extent, margin: float) -> Extent:
    """Return `box` with a margin within `extent`, moved out to whole cells of the map of `extent`."""
    south, north = _axis(extent.south, extent.north, resolution, box.south - margin, box.north + margin)
    west, east = _axis(extent.west, extent.east, resolution, box.west - margin, box.east + margin)
    return Extent(south, west, north, east)


def _axis(first: float, last: float, resolution: float, low: float, high: float) -> tuple[float, float]:
    """Return `low` and `high` between `first` and `last`, the lower one a whole number of cells from `first`."""
    before = max(0, floor((min(low, last - resolution) - first) / resolution))
    after = max(before + 1, ceil((high - first) / resolution))
    return first + before * resolution, min(last, first + after * resolution)


def _cells(extent: Extent, resolution: float) -> float:
    return (extent.north - extent.south) / resolution * ((extent.east - extent.west) / resolution)

"""Choose the part of a world that a planner's map shows, where the map of all of it would be too large."""

from collections.abc import Sequence
from math import ceil, floor

from hil.autonomy.paths.occupancy import Extent, Point

MOST_CELLS = 1_000_000  # of a map that shows all of a world; a path search takes some 50 bytes a cell
MOST_GROWN = 4_000_000  # cells to which a part may grow in search of a path
LEAST_MARGIN_CELLS = 100
MARGIN = 0.25  # of the distance between the places, around them


def map_parts(extent: Extent, resolution: float, places: Sequence[Point]) -> list[Extent]:
    """Return the parts of `extent` (m) that a map in cells of `resolution` m may show, growing; at least one.

    A map of up to MOST_CELLS shows all. Otherwise a part holds `places` (north, east) with a margin, and the next ones
    are twice as wide, until they are all or more than MOST_GROWN cells. Without places all is the only part.
    """
    if not places or _cells(extent, resolution) <= MOST_CELLS:
        return [extent]
    norths, easts = zip(*places, strict=True)
    box = Extent(min(norths), min(easts), max(norths), max(easts))
    margin = max(LEAST_MARGIN_CELLS * resolution, MARGIN * max(box.north - box.south, box.east - box.west))
    parts: list[Extent] = []
    while not parts or parts[-1] != extent:
        part = _cut(extent, resolution, box, margin)
        if parts and _cells(part, resolution) > MOST_GROWN:
            break
        parts.append(part)
        margin *= 2.0
    return parts


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

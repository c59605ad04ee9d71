"""The regular grid of a terrain's nodes."""

from typing import Annotated, NamedTuple

from hil.common.schema import Range

Edge = Annotated[float, Range(-1e6, 1e6, "m")]
Resolution = Annotated[float, Range(0.01, 1e4, "m")]
Count = Annotated[int, Range(2, 100_000)]


class Grid(NamedTuple):
    """The nodes of a grid: position of the first one (m), distance between nodes (m) to north and east, and counts."""

    north_min: Edge
    east_min: Edge
    resolution: Resolution
    rows: Count
    columns: Count

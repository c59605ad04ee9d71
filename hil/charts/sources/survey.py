"""The data of a seabed before gridding, on the world's local plane, from all kinds of sources."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges
from hil.charts.charted_objects import ChartedObjects
from hil.charts.gridding import Indices
from sim.environment.obstacles import STANDING

Array = NDArray[np.float64]


class DepthArea(NamedTuple):
    """An area whose bed lies between the depths `low` and `high` (m). Negative: it dries; infinite: unknown."""

    edges: Edges
    low: float
    high: float


class Sheet(NamedTuple):
    """The areas of one chart, which is valid inside `coverage`. The bed is unknown in `unsurveyed`."""

    name: str
    coverage: Edges
    areas: tuple[DepthArea, ...]
    land: tuple[Edges, ...]
    unsurveyed: tuple[Edges, ...] = ()


class Hazard(NamedTuple):
    """Possible obstacle: a point (a `line` of one position), a line, or an area (with `edges`).

    `radius`: m, of a point, and half the width of a line. `top`: depth (m) of its upper end, None if not known.
    `bottom`: depth (m) of the lower end of a floating object. With `needs_water_both_sides` only the segments of a line
    that have water on both sides become obstacles, and of a line that `is_wall` those with deep water on one. An area
    on the bed raises the bed inside its edges.
    """

    kind: str
    line: Array
    radius: float
    top: float | None
    edges: Edges = ()
    bottom: float = STANDING
    needs_water_both_sides: bool = False
    is_wall: bool = False


# A function that returns depths (m, nan if unknown) at the crossings of increasing arrays of norths and easts (m)
Bed = Callable[[Array, Array], Array]


class Survey(NamedTuple):
    """All data of a seabed.

    - `source`: description of the files.
    - `origin`: latitude and longitude (degrees) of (0, 0), None if it is not known.
    - `soundings`: (n, 3) north, east, depth in m.
    - `detail`: m, the resolution of the data, and so of a grid of them.
    - `guides`: (n, 3), as `soundings`, for points on contours and coasts.
    - `strikes`: (k, 4) segments of contours and coasts: centres and vectors, m.
    - `sheets`: the areas of each chart, from the coarsest to the finest.
    - `hazards`: possible obstacles.
    - `contours` (with their depths), `shore`, `bridges`: lines to draw.
    - `reach`: m around soundings in which the bed counts as known outside all sheets; 0 for none.
    - `notes`: assumptions made when reading, for the user.
    - `beds`: names and depths of rasters that come before all other data, in order of precedence.
    - `fillers`: names and depths of rasters that are used only where no other data are, in order of precedence.
    - `charted`: other charted objects.
    - `is_cropped`: whether it is a part of the area that the files cover.
    """

    source: str
    origin: tuple[float, float] | None
    soundings: Array
    detail: float = 5.0
    guides: Array = np.empty((0, 3))
    strikes: Array = np.empty((0, 4))
    sheets: tuple[Sheet, ...] = ()
    hazards: tuple[Hazard, ...] = ()
    contours: tuple[tuple[Array, float], ...] = ()
    shore: tuple[Array, ...] = ()
    bridges: tuple[Array, ...] = ()
    reach: float = 0.0
    notes: tuple[str, ...] = ()
    beds: tuple[tuple[str, Bed], ...] = ()
    fillers: tuple[tuple[str, Bed], ...] = ()
    charted: ChartedObjects = ChartedObjects()
    is_cropped: bool = False


def resample(line: Array, step: float) -> Array:
    """Return evenly spaced points along `line` (n, 2), including both ends, at most `step` m apart."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    wanted = np.linspace(0.0, along[-1], int(np.ceil(along[-1] / step)) + 1)
    return np.column_stack([np.interp(wanted, along, line[:, k]) for k in (0, 1)])


def shoalest_in_cell(points: Array, size: float) -> Array:
    """Return the shoalest of the soundings (n, 3) in each square cell of `size` m, at its own position."""
    ordered = points[np.argsort(points[:, 2], kind="stable")]
    return np.asarray(ordered[first_in_cell(ordered, size)])


def first_in_cell(points: Array, size: float) -> Indices:
    """Return the indices, in increasing order, of the first point in each square cell of `size` m."""
    cells = np.floor(points[:, :2] / size)
    _, first = np.unique(cells[:, 0] + 1j * cells[:, 1], return_index=True)  # ten times as fast as of rows
    return np.sort(first)

"""The survey of a seabed before gridding, on the world's local plane, for every kind of source."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Edges
from hil.charts.charted import Charted
from hil.charts.gridding import Indices
from sim.environment.obstacles import STANDING

Array = NDArray[np.float64]


class DepthArea(NamedTuple):
    """An area whose bed lies between `low` and `high` m of depth; negative dries, inf means unknown."""

    edges: Edges
    low: float
    high: float


class Sheet(NamedTuple):
    """The areas of one chart. `coverage` bounds where it is valid; nothing is known in `unsurveyed`."""

    name: str
    coverage: Edges
    areas: tuple[DepthArea, ...]
    land: tuple[Edges, ...]
    unsurveyed: tuple[Edges, ...] = ()


class Hazard(NamedTuple):
    """Object on the seabed. `top` is the depth of its upper end in m, None if only known to be there.

    What floats reaches down to `bottom` m. With `banks` it counts only where water is on both sides of it.

    A point (`line` with one place) stands with `radius` m around it, a line is as wide; an area rises from the
    bed inside its edges.
    """

    kind: str
    line: Array
    radius: float
    top: float | None
    edges: Edges = ()
    bottom: float = STANDING
    banks: bool = False


# Depths (m, nan where none is known) at the crossings of growing norths and easts (m)
Bed = Callable[[Array, Array], Array]


class Survey(NamedTuple):
    """Soundings, contours, shore lines, areas and hazards of a survey.

    `soundings`: (n, 3) north, east, depth in m. `guides`: the same for places on contours and coasts, `shore` lines to
    draw. `strikes`: (k, 4) pieces of contours and coasts, their middles and vectors. `detail` (m): what the data
    resolve, and so a grid of them.
    `sheets` go from the coarsest to the finest. `reach`: how far in m the bed is known around soundings where no
    sheet says so; 0 nowhere. `origin`: latitude and longitude in degrees of (0, 0), None where there is none.
    `beds`: depths that are known everywhere, as rasters have them, the first before the next and before all else, each
    with its name; `fillers` are the same where nothing else is known.
    `charted`: what charts have beside that.
    `notes`: what a person should know of how the files were read.
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
    charted: Charted = Charted()


def resample(line: Array, step: float) -> Array:
    """Return places along `line` (n, 2), both ends among them, at most `step` m apart."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    wanted = np.linspace(0.0, along[-1], int(np.ceil(along[-1] / step)) + 1)
    return np.column_stack([np.interp(wanted, along, line[:, k]) for k in (0, 1)])


def first_in_cell(points: Array, size: float) -> Indices:
    """Return the indices, growing, of the first point in each square cell of `size` m."""
    cells = np.floor(points[:, :2] / size).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return np.sort(first)


def block_means(points: Array, size: float) -> Array:
    """Return the mean of the points (n, k) in each square cell of `size` m, (m, k)."""
    cells = np.floor(points[:, :2] / size).astype(np.int64)
    _, where, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sums = [np.bincount(where.ravel(), points[:, k]) for k in range(points.shape[1])]
    return np.asarray(np.column_stack(sums) / counts[:, None])

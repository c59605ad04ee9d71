"""Find sites for a short dive on a seabed: straight paths over relief, near enough to the bed for a camera."""

from collections.abc import Iterator
from math import cos, hypot, pi, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.grid import Grid
from hil.common.errors import ConfigError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Point = tuple[float, float]  # north, east in m

COURSES = 8  # over half a turn: a path is equally good in both directions
PATH_SAMPLES = 25  # points along a path
SIDE_DISTANCES = (-24.0, -12.0, 12.0, 24.0)  # m abeam of a path: within the range of a laser
MIN_DEPTH = 2.0  # m of water above the vehicle
MIN_ALTITUDE = 2.5  # m above the highest point of the bed below the path
MAX_ALTITUDE = 8.0  # m, unless the user sets a depth: the camera still shows the bed
MAX_DEPTH = 12.0  # m, unless the user sets a depth: there is still daylight
MAX_RELIEF = 3.0  # m of standard deviation; more does not improve the score
MAX_SITES = 20
MAX_MIDDLES = 20_000  # of paths that are scored; on a larger chart half of them are steep places, half spread evenly
SITE_SPACING = 100.0  # m, least distance between two sites


class Site(NamedTuple):
    """A straight path from `start` to `goal` (m north, m east) at `depth` m."""

    start: Point
    goal: Point
    depth: float


def find_sites(grid: Grid, length: float, depth: float | None = None) -> Iterator[Site]:
    """Yield paths of `length` m, the best first, at `depth` m if given. Raises ConfigError if there is none.

    A path is good where the bed below has relief, and where ground beside it rises to the vehicle's depth, so that
    laser and sonar detect it. All of it is in known water. Paths below MAX_DEPTH are used only if there are no others.
    """
    is_found = False
    for deepest in (MAX_DEPTH, np.inf) if depth is None else (np.inf,):
        for site in _sites_above(grid, length, depth, deepest):
            is_found = True
            yield site
        if is_found:
            return
    deep = f" at {depth:g} m" if depth is not None else ""
    raise ConfigError(
        f"no straight path of {length:g} m{deep} here with known water {SIDE_DISTANCES[-1]:g} m to both sides; "
        "try another --depth or --length"
    )


def _sites_above(grid: Grid, length: float, depth: float | None, deepest: float) -> Iterator[Site]:
    """Yield paths at depths of at most `deepest` m, the best first; may be none."""
    known = (grid.depths > MIN_DEPTH + MIN_ALTITUDE) & (grid.depths < deepest + MAX_ALTITUDE)
    rows, columns = np.nonzero(known)
    chosen_nodes = _select_middles(grid, rows, columns)
    rows, columns = rows[chosen_nodes], columns[chosen_nodes]
    middles = np.column_stack([grid.north[rows], grid.east[columns]])
    judged = [_score_paths(grid, middles, pi * i / COURSES, length, depth, deepest) for i in range(COURSES)]
    scores, depths = (np.concatenate(each) for each in zip(*judged, strict=True))
    chosen: list[Point] = []
    for index in np.argsort(-scores):
        if not np.isfinite(scores[index]) or len(chosen) == MAX_SITES:
            break
        north, east = middles[index % len(middles)]
        if all(hypot(north - n, east - e) > SITE_SPACING for n, e in chosen):
            chosen.append((float(north), float(east)))
            course = pi * int(index // len(middles)) / COURSES
            ahead = np.array([cos(course), sin(course)]) * 0.5 * length
            start, goal = (tuple((middles[index % len(middles)] + end).tolist()) for end in (-ahead, ahead))
            yield Site(start, goal, float(depths[index]))


def depth_between(grid: Grid, start: Point, goal: Point) -> float:
    """Return the depth (m) of a dive on the straight path between two positions.

    Raises ConfigError where the water is too shallow or unknown.
    """
    shares = np.linspace(0.0, 1.0, PATH_SAMPLES)[:, None]
    least = float(np.min(grid.at(np.array(start) + shares * (np.array(goal) - np.array(start)))))
    if not least > MIN_DEPTH + MIN_ALTITUDE:
        raise ConfigError(
            "the straight path from --start to --goal leads through shallow or unknown water: choose other places"
        )
    return float(_rounded(least - MIN_ALTITUDE))


def _select_middles(grid: Grid, rows: Indices, columns: Indices) -> Indices:
    """Return the indices of the nodes to score as middles of paths, about MAX_MIDDLES at most."""
    if len(rows) <= MAX_MIDDLES:
        return np.arange(len(rows))
    slopes = np.zeros(len(rows))
    for row, column in ((0, 1), (1, 0)):
        far = np.minimum(rows + row, grid.depths.shape[0] - 1), np.minimum(columns + column, grid.depths.shape[1] - 1)
        slopes += np.abs(np.nan_to_num(grid.depths[far] - grid.depths[rows, columns]))
    half = MAX_MIDDLES // 2
    spread = np.linspace(0, len(rows) - 1, half).astype(np.intp)
    return np.union1d(np.argpartition(-slopes, half)[:half], spread)


def _score_paths(
    grid: Grid, middles: Array, course: float, length: float, depth: float | None, deepest: float
) -> tuple[Array, Array]:
    """Return the score (-inf: not possible) and the depth (m) of a path through each of `middles` (n, 2)."""
    ahead, abeam = np.array([cos(course), sin(course)]), np.array([-sin(course), cos(course)])
    along = np.linspace(-0.5 * length, 0.5 * length, PATH_SAMPLES)
    under = np.stack([grid.at(middles + x * ahead) for x in along])
    swath = np.stack([grid.at(middles + x * ahead + y * abeam) for x in along[::3] for y in SIDE_DISTANCES])
    least = under.min(axis=0)
    deep = np.full(len(middles), depth) if depth is not None else _rounded(least - MIN_ALTITUDE)
    relief = np.minimum(under.std(axis=0), MAX_RELIEF)
    rising = (swath < deep).mean(axis=0)
    score = relief + 4.0 * np.minimum(rising, 0.4) - 0.2 * (under.mean(axis=0) - deep)
    possible = (deep >= MIN_DEPTH) & (least - deep >= MIN_ALTITUDE) & np.isfinite(swath).all(axis=0)
    if depth is None:
        possible &= (under.max(axis=0) - deep <= MAX_ALTITUDE) & (deep <= deepest)
    return np.where(possible, score, -np.inf), deep


def _rounded(depths: Any) -> Any:
    """Return depths rounded up to shallower multiples of half a metre."""
    return np.floor(2.0 * depths) / 2.0

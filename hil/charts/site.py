"""Find the place on a chart for a short dive: with relief, and near enough to the bed for a camera."""

from collections.abc import Iterator
from math import cos, hypot, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.grid import Grid
from hil.common.errors import ConfigError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Point = tuple[float, float]  # north, east in m

COURSES = 8  # half a turn of them; a way is as good in either direction
PLACES = 25  # along a way
ABEAM = (-24.0, -12.0, 12.0, 24.0)  # m: as far as a laser sees
LEAST_DEPTH = 2.0  # m of water above
LEAST_ALTITUDE = 2.5  # m under the keel at the highest place of the way
MOST_ALTITUDE = 8.0  # m, unless another depth is asked for: the bed is still seen
MOST_DEPTH = 12.0  # m, unless another is asked for: daylight comes so far
MOST_RELIEF = 3.0  # m of standard deviation, beyond which more is no better
TRIES = 20
MOST_MIDDLES = 20_000  # looked at: of a large chart the steeper half of them, and others spread over all of it
APART = 100.0  # m between two sites


class Site(NamedTuple):
    """A straight way from `start` to `goal` (m north, m east), `depth` m down."""

    start: Point
    goal: Point
    depth: float


def sites(grid: Grid, length: float, depth: float | None = None) -> Iterator[Site]:
    """Return ways of `length` m, the best first, at `depth` m if that is given. Raises ConfigError when there is none.

    A way is good where the bed under it goes up and down, and the ground beside it comes up to the vehicle, for the
    laser and the sonar to see; all of it lies in known water. Where all of that is too deep for daylight, deeper.
    """
    found = False
    for deepest in (MOST_DEPTH, np.inf) if depth is None else (np.inf,):
        for site in _sites(grid, length, depth, deepest):
            found = True
            yield site
        if found:
            return
    deep = f" at {depth:g} m" if depth is not None else ""
    raise ConfigError(
        f"no straight way of {length:g} m{deep} in known water here, which must reach {ABEAM[-1]:g} m to both sides; "
        "try --depth or --length"
    )


def _sites(grid: Grid, length: float, depth: float | None, deepest: float) -> Iterator[Site]:
    """Return ways at most `deepest` m down, none or more."""
    known = (grid.depths > LEAST_DEPTH + LEAST_ALTITUDE) & (grid.depths < deepest + MOST_ALTITUDE)
    rows, columns = np.nonzero(known)
    chosen_nodes = _promising(grid, rows, columns)
    rows, columns = rows[chosen_nodes], columns[chosen_nodes]
    middles = np.column_stack([grid.north[rows], grid.east[columns]])
    judged = [_judge(grid, middles, pi * i / COURSES, length, depth, deepest) for i in range(COURSES)]
    scores, depths = (np.concatenate(each) for each in zip(*judged, strict=True))
    chosen: list[Point] = []
    for index in np.argsort(-scores):
        if not np.isfinite(scores[index]) or len(chosen) == TRIES:
            break
        north, east = middles[index % len(middles)]
        if all(hypot(north - n, east - e) > APART for n, e in chosen):
            chosen.append((float(north), float(east)))
            yield _site(chosen[-1], pi * int(index // len(middles)) / COURSES, length, float(depths[index]))


def depth_between(grid: Grid, start: Point, goal: Point) -> float:
    """Return how deep to dive on the straight way between two places.

    Raises ConfigError where there is too little water.
    """
    shares = np.linspace(0.0, 1.0, PLACES)[:, None]
    least = float(np.min(grid.at(np.array(start) + shares * (np.array(goal) - np.array(start)))))
    if not least > LEAST_DEPTH + LEAST_ALTITUDE:
        raise ConfigError("too little water, or none that is known, on the straight way from --start to --goal")
    return _rounded(least - LEAST_ALTITUDE)


def _promising(grid: Grid, rows: Indices, columns: Indices) -> Indices:
    """Return which of the nodes to look at, no more than MOST_MIDDLES."""
    if len(rows) <= MOST_MIDDLES:
        return np.arange(len(rows))
    slopes = np.zeros(len(rows))
    for row, column in ((0, 1), (1, 0)):
        far = np.minimum(rows + row, grid.depths.shape[0] - 1), np.minimum(columns + column, grid.depths.shape[1] - 1)
        slopes += np.abs(np.nan_to_num(grid.depths[far] - grid.depths[rows, columns]))
    half = MOST_MIDDLES // 2
    spread = np.linspace(0, len(rows) - 1, half).astype(np.intp)
    return np.union1d(np.argpartition(-slopes, half)[:half], spread)


def _judge(
    grid: Grid, middles: Array, course: float, length: float, depth: float | None, deepest: float
) -> tuple[Array, Array]:
    """Return how good a way through each of `middles` is (-inf: none), and how deep it is: at most `deepest` m."""
    ahead, abeam = np.array([cos(course), sin(course)]), np.array([-sin(course), cos(course)])
    along = np.linspace(-0.5 * length, 0.5 * length, PLACES)
    under = np.stack([grid.at(middles + x * ahead) for x in along])
    swath = np.stack([grid.at(middles + x * ahead + y * abeam) for x in along[::3] for y in ABEAM])
    least = under.min(axis=0)
    deep = np.full(len(middles), depth) if depth is not None else np.floor(2.0 * (least - LEAST_ALTITUDE)) / 2.0
    relief = np.minimum(under.std(axis=0), MOST_RELIEF)
    rising = (swath < deep).mean(axis=0)
    score = relief + 4.0 * np.minimum(rising, 0.4) - 0.2 * (under.mean(axis=0) - deep)
    possible = (deep >= LEAST_DEPTH) & (least - deep >= LEAST_ALTITUDE) & np.isfinite(swath).all(axis=0)
    if depth is None:
        possible &= (under.max(axis=0) - deep <= MOST_ALTITUDE) & (deep <= deepest)
    return np.where(possible, score, -np.inf), deep


def _site(middle: Point, course: float, length: float, depth: float) -> Site:
    north, east = 0.5 * length * cos(course), 0.5 * length * sin(course)
    return Site((middle[0] - north, middle[1] - east), (middle[0] + north, middle[1] + east), depth)


def _rounded(depth: float) -> float:
    """Return a depth rounded to half a metre, to the shallower one."""
    return float(np.floor(2.0 * depth) / 2.0)

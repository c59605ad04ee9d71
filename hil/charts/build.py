"""Make a grid from a survey, and estimate its error."""

import time
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.bounds import allowance, clamp, keep_shoals, limits_at, paint, raise_land
from hil.charts.grid import Extent, Grid
from hil.charts.gridding import Indices, Progress, Surface
from hil.charts.hazards import Placed, place
from hil.charts.sources.survey import Survey, first_in_cell
from hil.common.errors import ConfigError, MissingExtraError

Array = NDArray[np.float64]

MOST_NODES = 40_000_000
FOLDS = 10
MANY = 20_000  # soundings, from which on one fold is held out instead of ten
SAME_PLACE = 0.05  # m


class Report(NamedTuple):
    """Quality of a grid. `rmse` and `linear_rmse` (m): of soundings held out, over those the linear one reaches.

    `held_out` says how many those are, `rmse_all` the error over all that were held out. Shares of the nodes:
    `water`, `land` (what dries is land here), `unknown`; `clamped` of the water was held by the areas' limits.
    `off_limits` soundings are deeper than their area says. `seconds`: what gridding and holding out took.
    """

    soundings: int
    guides: int
    rmse: float
    linear_rmse: float
    rmse_all: float
    held_out: int
    water: float
    land: float
    unknown: float
    clamped: float
    off_limits: int
    seconds: float


class Built(NamedTuple):
    """A world's seabed, what stands on it, and the report."""

    placed: Placed
    report: Report


def build(survey: Survey, extent: Extent, resolution: float, progress: Progress = lambda share: None) -> Built:
    """Grid `survey` over `extent` (m) at `resolution` (m). Raises ConfigError, MissingExtraError."""
    missing = [name for name in ("scipy", "pygeomag") if find_spec(name) is None]  # the latter to write the world
    if missing:
        raise MissingExtraError(f"a world of charts needs {' and '.join(missing)}: pip install 'uuv-hil[chart]'")
    begin = time.perf_counter()
    north, east = _axes(extent, resolution)
    bounds = paint(survey, north, east)
    water = bounds.known & ~bounds.land
    if not water.any():
        raise ConfigError(f"{survey.source}: no water in the area: move or widen it with --area")
    points, soundings = _data(survey, north, east, resolution)
    surface = Surface(points[:, :2], points[:, 2])
    smooth = surface.evaluate(north, east, water, lambda share: progress(0.8 * share))
    limits = limits_at(survey, soundings[:, :2])
    depths = clamp(smooth, bounds, allowance(soundings, limits[1], north, east, 2.0 * resolution))
    clamped = float((np.abs(depths - smooth) > 0.01)[water].mean())
    grid = Grid(depths.astype(np.float32), float(north[0]), float(east[0]), resolution)
    grid = grid._replace(depths=raise_land(grid.depths, bounds.land, water, resolution))
    grid = keep_shoals(grid, soundings, limits[0], np.where(water, bounds.low, -np.inf))
    placed = place(survey.hazards, grid, np.where(bounds.land, -np.inf, bounds.low))
    progress(0.85)
    errors = cross_validate(surface, points, soundings, limits)
    progress(1.0)
    report = Report(
        len(soundings), len(points) - len(soundings), *errors, float((placed.grid.depths > 0.0).mean()),
        float((placed.grid.depths <= 0.0).mean()), float((~bounds.known).mean()), clamped,
        int((soundings[:, 2] > limits[1]).sum()), time.perf_counter() - begin,
    )  # fmt: skip
    return Built(placed, report)


def _axes(extent: Extent, resolution: float) -> tuple[Array, Array]:
    """Return the whole multiples of `resolution` in `extent`, to the north and to the east."""
    first = [int(np.ceil(low / resolution - 1e-9)) for low in (extent[0], extent[2])]
    rows, columns = (int(np.floor(extent[k + 1] / resolution + 1e-9)) - first[k // 2] + 1 for k in (0, 2))
    if rows < 2 or columns < 2:
        raise ConfigError(
            f"--resolution: {resolution:g} m is larger than the area: take a finer one, or a larger --area"
        )
    if rows * columns > MOST_NODES:
        raise ConfigError(
            f"--resolution: {resolution:g} m makes {rows} x {columns} nodes, more than {MOST_NODES}: "
            "take a coarser one, or a smaller --area"
        )
    north, east = (np.asarray(resolution * (k + np.arange(n))) for k, n in zip(first, (rows, columns), strict=True))
    return north, east


def _data(survey: Survey, north: Array, east: Array, resolution: float) -> tuple[Array, Array]:
    """Return what the surface goes through (soundings first), and the soundings among it.

    A margin around the grid counts.
    """
    margin = 0.1 * max(north[-1] - north[0], east[-1] - east[0])
    low, high = np.array([north[0], east[0]]) - margin, np.array([north[-1], east[-1]]) + margin
    soundings, guides = (
        points[((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)]
        for points in (survey.soundings, survey.guides)
    )
    soundings = soundings[np.argsort(soundings[:, 2], kind="stable")]  # of two in one place the shoaler is kept
    soundings = soundings[first_in_cell(soundings, SAME_PLACE)]
    if len(soundings) < 3:
        raise ConfigError(f"{survey.source}: {len(soundings)} soundings in the area; three are the least: widen --area")
    guides = guides[first_in_cell(guides, resolution)]
    both = np.concatenate([soundings, guides])
    kept = first_in_cell(both, SAME_PLACE)
    return both[kept], soundings


def cross_validate(
    surface: Surface, points: Array, soundings: Array, limits: tuple[Array, Array]
) -> tuple[float, float, float, int]:
    """RMSE in m of ours and of linear interpolation where the latter reaches, of ours everywhere; how many it reaches.

    A tenth of the soundings is held out at a time, contours are kept; ours is held between the areas' limits as
    the grid is. Linear is the triangulation of the soundings alone.
    """
    folds = np.random.default_rng(0).permutation(len(soundings)) % FOLDS
    if len(soundings) > MANY:
        folds = np.where(folds == 0, 0, -1)
    ours = surface.held_out(np.concatenate([folds, np.full(len(points) - len(soundings), -1)]))[: len(soundings)]
    ours = np.maximum(np.minimum(ours, limits[1]), limits[0])
    linear = _linear(soundings, folds)
    held, reached = folds >= 0, np.isfinite(linear)
    return (
        _rmse(ours[reached] - soundings[reached, 2]),
        _rmse(linear[reached] - soundings[reached, 2]),
        _rmse(ours[held] - soundings[held, 2]),
        int(reached.sum()),
    )


def _rmse(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")


def _linear(soundings: Array, folds: Indices) -> Array:
    """Soundings as the triangles of the others have them; nan outside of those, and where nothing is held out."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError

    estimates = np.full(len(soundings), np.nan)
    for fold in np.unique(folds[folds >= 0]):
        out, rest = folds == fold, soundings[folds != fold]
        try:
            estimates[out] = LinearNDInterpolator(rest[:, :2], rest[:, 2])(soundings[out, :2])
        except QhullError:  # all in one line
            continue
    return estimates

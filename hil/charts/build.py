"""Make a grid from a survey, and estimate its error."""

import time
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.bounds import Bounds, allowance, keep_shoals, limits_at, paint, raise_land, relaxed, settle
from hil.charts.charted import paint_natures, within
from hil.charts.expected import Limits, from_borders, known_nodes, leave_limits
from hil.charts.grid import Extent, Grid, rounded_up
from hil.charts.gridding import Progress, Surface
from hil.charts.hazards import Placed, beds_under, place
from hil.charts.held_out import HeldOut, hold_out
from hil.charts.sources.survey import Bed, Survey, first_in_cell
from hil.common.errors import ConfigError, MissingExtraError

Array = NDArray[np.float64]

MOST_NODES = 40_000_000
MOST_OWN_NODES = 4_000_000  # of a grid whose resolution nobody asked for
SAME_PLACE = 0.05  # m


class Report(NamedTuple):
    """Quality of a grid. `rmse`, `linear_rmse` and `bias` (m): of soundings held out, over those the linear reaches.

    Linear is through the same soundings and contours, held by the same limits; a `bias` above zero is too deep.
    `held_out` is how many soundings those are, `rmse_all` the error over all that were held out. Shares of the nodes:
    `water`, `land` (what dries is land here), `unknown`; `clamped` of the water was held by the areas' limits.
    `off_limits` soundings are deeper than their area says, `beds_under` obstacles of known depth keep the bed below
    them. `seconds`: what gridding and holding out took. `beds`: the name of each raster, and the share of the nodes
    that are as it says. `notes`: what was assumed of the files.
    """

    soundings: int
    guides: int
    rmse: float
    linear_rmse: float
    bias: float
    rmse_all: float
    held_out: int
    water: float
    land: float
    unknown: float
    clamped: float
    off_limits: int
    beds_under: int
    seconds: float
    beds: tuple[tuple[str, float], ...] = ()
    notes: tuple[str, ...] = ()


class Built(NamedTuple):
    """A world's seabed, what stands on it, and the report."""

    placed: Placed
    report: Report


class _Data(NamedTuple):
    """Data that a surface goes through: `points` (n, 3) are soundings first, then beds below hazards, then guides.

    The first `soundings` of them are soundings, the first `measured` are those with the beds. `limits` are at what is
    measured, and `borders` is how far, m, that is from the borders of areas.
    """

    points: Array
    soundings: int
    measured: int
    limits: Limits
    borders: Array
    surface: Surface


def build(
    survey: Survey, extent: Extent, resolution: float | None = None, progress: Progress = lambda share: None
) -> Built:
    """Grid `survey` over `extent` (m) at `resolution` (m), at what the data resolve if None.

    The bed goes through all that the survey holds, so that a part of it has the same bed as the whole. Raises
    ConfigError, MissingExtraError.
    """
    missing = [name for name in ("scipy", "pygeomag") if find_spec(name) is None]  # the latter to write the world
    if missing:
        raise MissingExtraError(f"a world of charts needs {' and '.join(missing)}: pip install 'uuv-hil[chart]'")
    begin = time.perf_counter()
    resolution = resolution or own_resolution(survey, extent)
    north, east = _axes(extent, resolution)
    bounds = paint(survey, north, east)
    water = bounds.known & ~bounds.land
    known, shares = _with_beds(np.full((len(north), len(east)), np.nan), survey.beds, north, east)
    if not (water.any() or survey.fillers or np.nanmax(known, initial=0.0) > 0.0):
        hint = "; if its values are depths, say --positive down" if (known <= 0.0).any() else ""
        raise ConfigError(f"{survey.source}: no water in the area: move or widen it (uuv-hil world build --area){hint}")
    grid, clamped = Grid(known.astype(np.float32), float(north[0]), float(east[0]), resolution), 0.0
    data = _data(survey) if water.any() else None
    if data is not None:
        surface, clamped = _settled(survey, data, bounds, grid, progress)
        grid = grid._replace(depths=np.where(np.isfinite(known), grid.depths, surface.depths))
    filled, more = _with_beds(grid.depths, survey.fillers, north, east)
    grid = grid._replace(depths=filled.astype(np.float32))
    placed = place(survey.hazards, grid, np.where(bounds.land, -np.inf, bounds.low))
    placed = placed._replace(
        charted=within(survey.charted, grid.extent)._replace(natures=()),
        bottom=paint_natures(survey.charted.natures, grid, survey.detail),
    )
    progress(0.85)
    report = _report(placed.grid, data, clamped, begin)._replace(beds=(*shares, *more), notes=survey.notes)
    progress(1.0)
    return Built(placed, report)


def _with_beds(
    depths: NDArray[np.floating[Any]], beds: Sequence[tuple[str, Bed]], north: Array, east: Array
) -> tuple[NDArray[np.floating[Any]], tuple[tuple[str, float], ...]]:
    """Return depths with what rasters have where these are nan, the first before the next, and the share of each."""
    shares, before = [], float(np.isfinite(depths).mean())
    for name, bed in beds:
        if np.isnan(depths).any():
            depths = np.where(np.isfinite(depths), depths, bed(north, east))
        share = float(np.isfinite(depths).mean())
        shares.append((name, share - before))
        before = share
    return depths, tuple(shares)


def _settled(survey: Survey, data: _Data, bounds: Bounds, empty: Grid, progress: Progress) -> tuple[Grid, float]:
    """Return the grid of the surface within its limits, with land, and the share of the water that was held by them."""
    water, measured = bounds.known & ~bounds.land, data.points[: data.measured]
    north, east, resolution = empty.north, empty.east, empty.resolution
    smooth = data.surface.evaluate(north, east, water, lambda share: progress(0.8 * share))
    low = relaxed(np.where(water, bounds.low, np.inf), survey.detail, resolution)
    high = bounds.high + allowance(measured, data.limits.high, north, east, 2.0 * max(resolution, survey.detail))
    grid = empty._replace(depths=smooth.astype(np.float32))
    grid = grid._replace(depths=settle(grid, low, high, measured))
    clamped = float((np.abs(grid.depths - smooth) > 0.01)[water].mean())
    if survey.sheets:
        known = known_nodes(bounds, grid, data.points)
        grid = grid._replace(depths=leave_limits(grid, Limits(low, high), data.surface, known, survey.detail))
    grid = grid._replace(depths=raise_land(grid.depths, bounds, resolution))
    np.minimum(low, grid.depths, out=low)  # shoaler at a shore
    low[~water] = -np.inf
    return keep_shoals(grid, measured, data.limits.low, low), clamped


def _report(grid: Grid, data: _Data | None, clamped: float, begin: float) -> Report:
    """Return how good `grid` is; `begin`: when it was begun, s."""
    errors, counts, off_limits = HeldOut(np.nan, np.nan, np.nan, np.nan, 0), [0, 0, 0], 0
    if data is not None:
        count = data.soundings
        inside = _inside(data.points, grid.extent)
        limits = Limits(*(part[:count] for part in data.limits))
        errors = hold_out(data.surface, data.points, inside[:count], limits, data.borders[:count])
        off_limits = int((inside[:count] & (data.points[:count, 2] > limits.high)).sum())
        counts = [int(part.sum()) for part in np.split(inside, [count, data.measured])]
    water, land, unknown = (
        float(share.mean()) for share in (grid.depths > 0.0, grid.depths <= 0.0, np.isnan(grid.depths))
    )
    soundings, beds, guides = counts
    return Report(
        soundings, guides, *errors, water, land, unknown, clamped, off_limits, beds, time.perf_counter() - begin
    )


def own_resolution(survey: Survey, extent: Extent) -> float:
    """Return the distance of nodes, m, that the data resolve, coarser where those were too many; of two digits."""
    return rounded_up(max(survey.detail, (_size(extent) / MOST_OWN_NODES) ** 0.5), 0.05)


def _size(extent: Extent) -> float:
    return (extent[1] - extent[0]) * (extent[3] - extent[2])


def _axes(extent: Extent, resolution: float) -> tuple[Array, Array]:
    """Return the whole multiples of `resolution` in `extent`, to the north and to the east."""
    first = [int(np.ceil(low / resolution - 1e-9)) for low in (extent[0], extent[2])]
    rows, columns = (int(np.floor(extent[k + 1] / resolution + 1e-9)) - first[k // 2] + 1 for k in (0, 2))
    if rows < 2 or columns < 2:
        fits = rounded_up(min(extent[1] - extent[0], extent[3] - extent[2]) / 20.0)
        raise ConfigError(
            f"--resolution: {resolution:g} m is larger than the area: take a finer one, {fits:g} m, or a larger area"
        )
    if rows * columns > MOST_NODES:
        fits = rounded_up((_size(extent) / MOST_NODES) ** 0.5 * 1.001)
        raise ConfigError(
            f"--resolution: {resolution:g} m makes {rows} x {columns} nodes, more than {MOST_NODES}: "
            f"take {fits:g} m or a coarser one, or a smaller area"
        )
    north, east = (np.asarray(resolution * (k + np.arange(n))) for k, n in zip(first, (rows, columns), strict=True))
    return north, east


def _data(survey: Survey) -> _Data:
    soundings = survey.soundings[np.argsort(survey.soundings[:, 2], kind="stable")]  # of two in one place the shoaler
    soundings = soundings[first_in_cell(soundings, SAME_PLACE)]
    both = np.concatenate([soundings, survey.guides])
    points = both[first_in_cell(both, SAME_PLACE)]
    surface = Surface(points[:, :2], points[:, 2], survey.strikes)
    beds = beds_under(survey, soundings, surface)
    measured = np.concatenate([soundings, beds])
    if len(beds):
        both = np.concatenate([measured, survey.guides])
        points = both[first_in_cell(both, SAME_PLACE)]
        surface = Surface(points[:, :2], points[:, 2], survey.strikes)
    limits = Limits(*limits_at(survey, measured[:, :2]))
    return _Data(points, len(soundings), len(measured), limits, from_borders(survey, measured[:, :2]), surface)


def _inside(points: Array, extent: Extent) -> NDArray[np.bool_]:
    south, north, west, east = extent
    return np.asarray(
        (points[:, 0] >= south) & (points[:, 0] <= north) & (points[:, 1] >= west) & (points[:, 1] <= east)
    )

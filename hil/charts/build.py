"""Interpolate a survey to a grid of depths, and estimate its error."""

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.bounds import (
    Bounds,
    deep_limit_allowance,
    limits_at,
    move_within_limits,
    raise_land,
    raise_to_soundings,
    rasterise_bounds,
    relax_shoal_limits,
    steps_of,
)
from hil.charts.charted_objects import clip_charted, rasterise_natures
from hil.charts.expected_depths import Limits, distance_to_borders, known_nodes, move_off_limits
from hil.charts.grid import Extent, Grid, round_up
from hil.charts.gridding import Progress, Surface
from hil.charts.hazards import OUT_OF_WATER, SeabedModel, beds_under, place_hazards
from hil.charts.held_out import HeldOut, choose_model, hold_out
from hil.charts.quays import BESIDE
from hil.charts.sources.survey import Bed, Survey, first_in_cell, shoalest_in_cell
from hil.common.errors import ConfigError

Array = NDArray[np.float64]

MAX_NODES = 40_000_000
MAX_OWN_NODES = 4_000_000  # of a grid whose resolution the user did not set
DUPLICATE_DISTANCE = 0.05  # m: of points nearer than this to each other one is used


class Report(NamedTuple):
    """Quality of a grid, from soundings that were held out: not used in the fit, then compared with it.

    - `soundings`, `guides`: numbers of soundings, and of points on contours and coasts.
    - `rmse`, `linear_rmse`, `bias`: m, over the `held_out` soundings that linear interpolation reaches. Linear
      interpolation uses the same soundings, contours and limits. `bias` is positive if the grid is too deep.
    - `rmse_all`: m, over all soundings that were held out.
    - `water`, `land`, `unknown`: shares of the nodes; land includes what dries at low water.
    - `clamped`: share of the water nodes that the limits of depth areas changed.
    - `off_limits`: number of soundings deeper than the limit of their area.
    - `beds_under`: number of obstacles of known depth for which the bed was set below their top.
    - `seconds`: duration of gridding and validation.
    - `beds`: name of each raster, and the share of the nodes that has its depth.
    - `notes`: assumptions made on the input files.
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


class BuiltSeabed(NamedTuple):
    """A world's seabed with its obstacles, and the report on its quality."""

    model: SeabedModel
    report: Report


class _SurfaceData(NamedTuple):
    """A surface and the `points` (n, 3) it passes through: soundings, then points below hazards, then guides.

    The first `soundings` points are soundings. The first `measured` points are soundings and points below hazards.
    `limits` are the depth limits at the measured points, `borders` their distances (m) from the borders of areas.
    """

    points: Array
    soundings: int
    measured: int
    limits: Limits
    borders: Array
    surface: Surface


def build(
    survey: Survey, extent: Extent, resolution: float | None = None, progress: Progress = lambda share: None
) -> BuiltSeabed:
    """Grid `survey` over `extent` (m) at `resolution` (m), by default the resolution of the data.

    The surface is fitted to all data of the survey, not only to those in `extent`, so that any part has the same bed
    as the whole. Raises ConfigError.
    """
    begin = time.perf_counter()
    resolution = resolution or default_resolution(survey, extent)
    north, east = _node_axes(extent, resolution)
    bounds = rasterise_bounds(survey, north, east)
    water = bounds.known & ~bounds.land
    known, shares = _fill_from_rasters(np.full((len(north), len(east)), np.nan), survey.beds, north, east)
    if not (water.any() or survey.fillers or np.nanmax(known, initial=0.0) > 0.0):
        hint = "; if its values are depths, use --positive down" if (known <= 0.0).any() else ""
        raise ConfigError(f"{survey.source}: no water in the area: move or widen it (uuv-hil world build --area){hint}")
    grid, clamped = Grid(known.astype(np.float32), float(north[0]), float(east[0]), resolution), 0.0
    data = _surface_data(_without_guides(survey, bounds.opposite)) if water.any() else None
    if data is not None:
        surface, clamped = _fit_within_limits(survey, data, bounds, grid, progress)
        grid = grid._replace(depths=np.where(np.isfinite(known), grid.depths, surface.depths))
    filled, filler_shares = _fill_from_rasters(grid.depths, survey.fillers, north, east)
    grid = grid._replace(depths=filled.astype(np.float32))
    blocks = [(ring, OUT_OF_WATER) for ring in bounds.blocks] + steps_of(bounds.strips, grid)
    model = place_hazards(survey.hazards, grid, np.where(bounds.land, -np.inf, bounds.low), blocks)
    model = model._replace(
        charted=clip_charted(survey.charted, grid.extent)._replace(natures=()),
        bottom=rasterise_natures(survey.charted.natures, grid, survey.detail),
    )
    progress(0.85)
    report = _report(model.grid, data, clamped, begin)._replace(beds=(*shares, *filler_shares), notes=survey.notes)
    progress(1.0)
    return BuiltSeabed(model, report)


def _fill_from_rasters(
    depths: NDArray[np.floating[Any]], beds: Sequence[tuple[str, Bed]], north: Array, east: Array
) -> tuple[NDArray[np.floating[Any]], tuple[tuple[str, float], ...]]:
    """Return `depths` with each nan replaced by the first raster that has a value, and each raster's share of nodes."""
    shares, before = [], float(np.isfinite(depths).mean())
    for name, bed in beds:
        if np.isnan(depths).any():
            depths = np.where(np.isfinite(depths), depths, bed(north, east))
        share = float(np.isfinite(depths).mean())
        shares.append((name, share - before))
        before = share
    return depths, tuple(shares)


def _fit_within_limits(
    survey: Survey, data: _SurfaceData, bounds: Bounds, empty: Grid, progress: Progress
) -> tuple[Grid, float]:
    """Return the surface's grid within its limits, with land, and the share of the water that the limits changed."""
    water, measured = bounds.known & ~bounds.land, data.points[: data.measured]
    north, east, resolution = empty.north, empty.east, empty.resolution
    smooth = data.surface.evaluate(north, east, water, lambda share: progress(0.8 * share))
    low = relax_shoal_limits(np.where(water, bounds.low, np.inf), survey.detail, resolution)
    high = bounds.high + deep_limit_allowance(
        measured, data.limits.high, north, east, 2.0 * max(resolution, survey.detail)
    )
    grid = empty._replace(depths=smooth.astype(np.float32))
    grid = grid._replace(depths=move_within_limits(grid, low, high, measured))
    clamped = float((np.abs(grid.depths - smooth) > 0.01)[water].mean())
    if survey.sheets:
        known = known_nodes(bounds, grid, data.points)
        grid = grid._replace(depths=move_off_limits(grid, Limits(low, high), data.surface, known, survey.detail))
    grid = grid._replace(depths=raise_land(grid, bounds, data.points))
    np.minimum(low, grid.depths, out=low)  # near a shore raise_land made the bed shoaler than its limit
    low[~water] = -np.inf
    return raise_to_soundings(grid, measured, data.limits.low, low), clamped


def _report(grid: Grid, data: _SurfaceData | None, clamped: float, begin: float) -> Report:
    """Return the quality of `grid`; `begin`: start time of the build, s of time.perf_counter."""
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


def default_resolution(survey: Survey, extent: Extent) -> float:
    """Return the node spacing (m) that the data resolve, rounded to two digits; coarser if it needs too many nodes."""
    return round_up(max(survey.detail, (size_of(extent) / MAX_OWN_NODES) ** 0.5), 0.05)


def size_of(extent: Extent) -> float:
    """Return the area of `extent`, m^2."""
    return (extent[1] - extent[0]) * (extent[3] - extent[2])


def _node_axes(extent: Extent, resolution: float) -> tuple[Array, Array]:
    """Return the multiples of `resolution` in `extent`, north and east. Raises ConfigError for too few or too many."""
    first = [int(np.ceil(low / resolution - 1e-9)) for low in (extent[0], extent[2])]
    rows, columns = (int(np.floor(extent[k + 1] / resolution + 1e-9)) - first[k // 2] + 1 for k in (0, 2))
    if rows < 2 or columns < 2:
        width = min(extent[1] - extent[0], extent[3] - extent[2])
        if width == 0.0:
            raise ConfigError("all soundings lie on one line along a meridian or parallel, or at one place: add others")
        suggested = round_up(width / 20.0)
        raise ConfigError(
            f"--resolution: {resolution:g} m is larger than the area: use {suggested:g} m or a larger area"
        )
    if rows * columns > MAX_NODES:
        suggested = round_up((size_of(extent) / MAX_NODES) ** 0.5 * 1.001)
        raise ConfigError(
            f"--resolution: {resolution:g} m makes {rows} x {columns} nodes, more than {MAX_NODES}: "
            f"use {suggested:g} m or coarser, or a smaller area"
        )
    north, east = (np.asarray(resolution * (k + np.arange(n))) for k, n in zip(first, (rows, columns), strict=True))
    return north, east


def _without_guides(survey: Survey, coasts: list[Array]) -> Survey:
    """Return `survey` without the guides on `coasts`, (2, 2) m each: they would raise the bed behind their mole."""
    import shapely

    if not coasts:
        return survey
    is_on = shapely.dwithin(shapely.points(survey.guides[:, :2]), shapely.multilinestrings(coasts), BESIDE)
    return survey._replace(guides=survey.guides[~is_on])


def _surface_data(survey: Survey) -> _SurfaceData:
    soundings = shoalest_in_cell(survey.soundings, DUPLICATE_DISTANCE)
    points = _with_guides(soundings, survey)
    surface = Surface(points[:, :2], points[:, 2], survey.strikes, len(soundings))
    limits, borders = Limits(*limits_at(survey, soundings[:, :2])), distance_to_borders(survey, soundings[:, :2])
    surface.model = choose_model(surface, soundings[:, 2], limits, borders)
    beds = beds_under(survey, soundings, surface)
    measured = np.concatenate([soundings, beds])
    if len(beds):
        points = _with_guides(measured, survey)
        surface = Surface(points[:, :2], points[:, 2], survey.strikes, len(soundings), surface.model)
        limits, borders = Limits(*limits_at(survey, measured[:, :2])), distance_to_borders(survey, measured[:, :2])
    return _SurfaceData(points, len(soundings), len(measured), limits, borders, surface)


def _with_guides(measured: Array, survey: Survey) -> Array:
    """Return the points (m, 3) a surface passes through: `measured` (n, 3), then the guides that are not on them."""
    points = np.concatenate([measured, survey.guides])
    return points[first_in_cell(points, DUPLICATE_DISTANCE)]


def _inside(points: Array, extent: Extent) -> NDArray[np.bool_]:
    south, north, west, east = extent
    return np.asarray(
        (points[:, 0] >= south) & (points[:, 0] <= north) & (points[:, 1] >= west) & (points[:, 1] <= east)
    )

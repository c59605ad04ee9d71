"""Read seabed files of all supported formats, and combine them into one survey."""

import os
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.chart_survey import GeoBox, coverage_box, survey_charts
from hil.charts.grid import Extent
from hil.charts.projection import LocalPlane
from hil.charts.sources.points import Points, is_points, read_points
from hil.charts.sources.priority import OTHER, RASTER, remove_outranked, require_named
from hil.charts.sources.rasters import Raster, is_raster, open_raster
from hil.charts.sources.s57 import Cell, read_cell
from hil.charts.sources.sign import Declared
from hil.charts.sources.survey import Survey, shoalest_in_cell
from hil.common.errors import ConfigError

Array = NDArray[np.float64]

THINNED = 0.5  # share of the soundings that are used, below which the others are reported
POINTS_DETAIL = 0.5  # detail of soundings, as a multiple of their mean spacing
CROP_TRIALS = 500  # number of soundings around which the number of others is counted
MAX_SIZE = 1.7  # degrees of latitude: greatest width of a world, whose coordinates are up to 100 km from its origin
POINTS_REACH = 4.0  # distance around soundings in which the bed counts as known, as a multiple of their mean spacing


class ReadOptions(NamedTuple):
    """Options of reading and combining files of depths.

    - `declared`: what the user says of soundings and rasters.
    - `updates`: apply the updates of S-57 charts.
    - `reach`: m around single soundings in which the bed counts as known.
    - `priorities`: of files, where sources overlap (hil.charts.sources.priority).
    - `crop`: of an area that is too large for a world, use the part around `near` (latitude, longitude in degrees), by
      default where most soundings are, or around its centre; the survey's notes say so.
    """

    declared: Declared = Declared()
    updates: bool = True
    reach: float | None = None
    priorities: Mapping[str, int] = MappingProxyType({})
    crop: bool = False
    near: tuple[float, float] | None = None


class _Files(NamedTuple):
    """The content of the files by kind, each with its priority in `ranks`: cells, loose soundings, rasters."""

    cells: list[Cell]
    loose: list[Points]
    rasters: list[Raster]
    ranks: dict[str, list[int]]


def read_sources(
    paths: list[str], area: GeoBox | None, resolution: float | None = None, options: ReadOptions = ReadOptions()
) -> tuple[Survey, Extent]:
    """Return the combined data of the files, and the extent of `area` on their plane (m).

    `area` is by default the coverage of all files, `resolution` (m) of the grid that will be made by default that of
    the data. Raises ConfigError, MissingExtraError.
    """
    cells, loose, rasters, ranks = _read_files(paths, options)
    reach = options.reach
    order = sorted(range(len(rasters)), key=lambda k: -ranks["rasters"][k])
    if any(not points.geographic for points in loose):
        return _on_a_plane(loose, bool(cells or rasters or area), resolution, reach)
    boxes = [*([coverage_box(cells)] if cells else []), *map(_box, loose), *(raster.box for raster in rasters)]
    if area and not any(_overlap(area, box) for box in boxes):
        raise ConfigError(f"--area: {_text(area)} is outside the data, which cover {_text(_around(boxes))}")
    area = area or _around(boxes)
    near = options.near or _most_sounded(area, _positions(cells, loose))
    whole_box, area = area, _cropped(area, near) if options.crop else area
    _require_local(area, near)
    plane = LocalPlane(*_origin(area.centre))
    parts = [survey_charts(cells, plane)] if cells else []
    parts += [_survey(points, _local(points, plane), resolution, reach) for points in loose]
    surface = [*([max(ranks["cells"])] if cells else []), *ranks["loose"]]
    parts = remove_outranked(parts, surface)
    parts += [Survey(r.name, None, np.empty((0, 3)), detail=r.spacing, notes=_notes(r)) for r in rasters]
    beds = [(rasters[k].name, partial(rasters[k].depths, plane)) for k in order]
    first = sum(ranks["rasters"][k] >= max(surface, default=OTHER) for k in order)
    together = _combine(parts, _origin(area.centre))
    if area != whole_box:
        together = _around_crop(together, _extent(area, plane))
        together = together._replace(notes=(*together.notes, _crop_note(whole_box, area)), is_cropped=True)
    return together._replace(beds=tuple(beds[:first]), fillers=tuple(beds[first:])), _extent(area, plane)


def _read_files(paths: list[str], options: ReadOptions) -> _Files:
    files = _Files([], [], [], {"cells": [], "loose": [], "rasters": []})
    priorities, declared = options.priorities, options.declared
    require_named(priorities, paths)
    for path in paths:
        rank = priorities.get(path, OTHER)
        if path.lower().endswith(".000"):
            files.cells.append(read_cell(path, options.updates))
            files.ranks["cells"].append(rank)
        elif is_points(path):
            files.loose.append(read_points(path, declared))
            files.ranks["loose"].append(rank)
        else:
            files.rasters.append(_open(path, declared))
            files.ranks["rasters"].append(priorities.get(path, RASTER))
    return files


def _open(path: str, declared: Declared) -> Raster:
    ending = os.path.splitext(path)[1].lower()
    if is_raster(path):
        return open_raster(path, declared)
    if ending[1:].isdigit():
        raise ConfigError(f"{path}: is an update; give the cell (.000), whose updates are found beside it")
    raise ConfigError(
        f"{path}: unknown format {ending or 'without an ending'}: use .000 (S-57), .tif, .bag, .nc, .grd, .asc, "
        ".h5 (S-102), .las, .laz, .xyz or .csv"
    )


def _on_a_plane(
    loose: list[Points], has_others: bool, resolution: float | None, reach: float | None
) -> tuple[Survey, Extent]:
    """Return the survey of soundings in metres from an origin with unknown position on the earth. Raises ConfigError.

    It cannot be combined with an area or with files that have positions on the earth.
    """
    if has_others or any(points.geographic for points in loose):
        raise ConfigError(
            f"{loose[0].name}: has positions in metres without a coordinate system, so it cannot be combined with "
            "--area or with files in degrees: name the coordinate system, for example --crs EPSG:32605"
        )
    survey = _combine([_survey(points, points.positions, resolution, reach) for points in loose], None)
    north, east = survey.soundings[:, 0], survey.soundings[:, 1]
    return survey, (float(north.min()), float(north.max()), float(east.min()), float(east.max()))


def _box(points: Points) -> GeoBox:
    latitudes, longitudes = points.positions.T
    if np.ptp(longitudes) > 180.0:  # on both sides of the 180th meridian
        longitudes = longitudes % 360.0
    return GeoBox(*map(float, (latitudes.min(), longitudes.min(), latitudes.max(), longitudes.max())))


def _origin(position: tuple[float, float]) -> tuple[float, float]:
    """Return a position (latitude, longitude) with its longitude from -180 to 180."""
    return position[0], (position[1] + 180.0) % 360.0 - 180.0


def _around(boxes: list[GeoBox]) -> GeoBox:
    corners = np.array(boxes)
    if np.ptp(corners[:, [1, 3]]) > 180.0:  # on both sides of the 180th meridian
        turns = 360.0 * np.floor(corners[:, 1] / 360.0)
        corners[:, [1, 3]] -= turns[:, None]
    return GeoBox(*corners[:, :2].min(axis=0).tolist(), *corners[:, 2:].max(axis=0).tolist())


def _overlap(one: GeoBox, other: GeoBox) -> bool:
    """Return whether two areas have a part in common, also across the 180th meridian."""
    shift = (one.west - other.west) % 360.0
    in_longitude = shift <= other.east - other.west or shift + one.east - one.west >= 360.0
    return in_longitude and one.south <= other.north and other.south <= one.north


def _size(area: GeoBox) -> tuple[float, float]:
    """Return height and width in degrees of latitude."""
    return area.north - area.south, (area.east - area.west) * float(np.cos(np.radians(area.centre[0])))


def _positions(cells: list[Cell], loose: list[Points]) -> Array:
    """Return latitude and longitude of all soundings, (n, 2)."""
    charted = [feature.points[:, 1::-1] for cell in cells for feature in cell.select("SOUNDG")]
    return np.concatenate([np.empty((0, 2)), *charted, *(points.positions for points in loose)])


def _most_sounded(area: GeoBox, positions: Array) -> tuple[float, float]:
    """Return the sounding of `area` that has most others around it in a world; without soundings its centre.

    The centre of a general chart may be far inland.
    """
    turned = np.column_stack([positions[:, 0], area.west + (positions[:, 1] - area.west) % 360.0])
    inside = turned[(turned[:, 0] >= area.south) & (turned[:, 0] <= area.north) & (turned[:, 1] <= area.east)]
    if not len(inside) or max(_size(area)) <= MAX_SIZE:
        return area.centre
    some = inside[:: 1 + len(inside) // CROP_TRIALS]
    half = np.stack([np.full(len(some), 0.5 * MAX_SIZE), 0.5 * MAX_SIZE / np.cos(np.radians(some[:, 0]))], axis=1)
    counts = [(np.abs(inside - place) < reach).all(axis=1).sum() for place, reach in zip(some, half, strict=True)]
    best = some[int(np.argmax(counts))]
    return float(best[0]), float(best[1])


def _cropped(area: GeoBox, near: tuple[float, float]) -> GeoBox:
    """Return `area`, or of one that is too large for a world the part around `near`."""
    if max(_size(area)) <= MAX_SIZE:
        return area
    latitude, longitude = near
    longitude = area.west + (longitude - area.west) % 360.0
    half = 0.49 * MAX_SIZE, 0.49 * MAX_SIZE / float(np.cos(np.radians(latitude)))
    south, west = max(area.south, latitude - half[0]), max(area.west, longitude - half[1])
    north, east = min(area.north, latitude + half[0]), min(area.east, longitude + half[1])
    if south >= north or west >= east:
        place = ",".join(f"{value:g}" for value in near)
        raise ConfigError(f"--start {place}: is not on the chart, which covers {_text(area)}")
    return GeoBox(south, west, north, east)


def _around_crop(survey: Survey, extent: Extent) -> Survey:
    """Return `survey` with only the depths in a rectangle twice as wide as `extent`: a chart may cover an ocean."""
    low, high = np.array(extent).reshape(2, 2).T
    reach, middle = high - low, 0.5 * (low + high)
    near = {
        key: rows[(np.abs(rows[:, :2] - middle) < reach).all(axis=1)]
        for key in ("soundings", "guides", "strikes")
        if len(rows := getattr(survey, key))
    }
    return survey._replace(**near)


def _crop_note(survey_box: GeoBox, cropped_box: GeoBox) -> str:
    cropped = f"{_text(cropped_box)} is used; choose another part with --start and --goal"
    return f"too large for a world ({_text(survey_box)}): {cropped}"


def _text(area: GeoBox) -> str:
    west, east = (area.west + 180.0) % 360.0 - 180.0, 180.0 - (180.0 - area.east) % 360.0
    texts = [f"{round(degrees, 4):.7g}" for degrees in (area.south, area.north, west, east)]  # within 10 m
    return "{} to {} N, {} to {} E".format(*texts)


def _require_local(area: GeoBox, near: tuple[float, float]) -> None:
    if max(_size(area)) > MAX_SIZE:
        south, west = (np.floor(10.0 * value) / 10.0 for value in _origin(near))
        raise ConfigError(
            f"the area is {area.north - area.south:.0f} x {area.east - area.west:.0f} degrees, too large for a "
            f"world: give a part of at most {MAX_SIZE:g} degrees of latitude ({MAX_SIZE * 111.2:.0f} km), for example "
            f"--area={south:.1f},{west:.1f},{south + 0.1:.1f},{west + 0.1:.1f}"
        )


def _local(points: Points, plane: LocalPlane) -> Array:
    return np.column_stack(plane.to_local(points.positions[:, 0], points.positions[:, 1]))


def _survey(points: Points, positions: Array, resolution: float | None, reach: float | None) -> Survey:
    """Return the survey of soundings; of several in one cell of the grid the shoalest is used."""
    detail = max(0.01, POINTS_DETAIL * _mean_spacing(positions))
    cell = resolution or detail
    soundings = shoalest_in_cell(np.column_stack([positions, points.depths]), cell)
    notes = _notes(points)
    if len(soundings) < THINNED * len(positions):
        rise = float(points.depths.mean() - soundings[:, 2].mean())
        notes += (
            f"{points.name}: the shoalest sounding in each {cell:g} m is used, {rise:.2g} m above the mean of all",
        )
    reach = POINTS_REACH * _mean_spacing(soundings) if reach is None else reach
    return Survey(points.name, None, soundings, detail=detail, reach=reach, notes=notes)


def _notes(source: Points | Raster) -> tuple[str, ...]:
    return (source.note,) if source.note else ()


def _mean_spacing(points: Array) -> float:
    """Return the mean spacing (m) of `points` (n, 2 or more): the root of the area per point."""
    return float(np.sqrt(np.ptp(points[:, :2], axis=0).prod() / len(points)))


def _combine(parts: list[Survey], origin: tuple[float, float] | None) -> Survey:
    """Return one survey of all parts; areas and hazards are those of the charts, which are the first part if any."""
    return parts[0]._replace(
        source="; ".join(part.source for part in parts),
        origin=origin,
        soundings=np.concatenate([part.soundings for part in parts]),
        detail=min(part.detail for part in parts),
        reach=max(part.reach for part in parts),
        notes=tuple(note for part in parts for note in part.notes),
    )


def _extent(area: GeoBox, plane: LocalPlane) -> Extent:
    """Return the rectangle on the plane around an area, m. Around a pole an area reaches all sides of it."""
    south, west, north, east = area
    latitude, across = area.centre[0], np.linspace(west, east, 9)
    border = [*((side, x) for side in (south, north) for x in across), (latitude, west), (latitude, east)]
    norths, easts = plane.to_local(*np.array(border).T)
    return float(norths.min()), float(norths.max()), float(easts.min()), float(easts.max())

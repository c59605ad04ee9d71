"""Read any supported file of a seabed, and combine all that are given into one survey."""

import os
from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hil.charts.chart_survey import Box, covered, survey_charts
from hil.charts.grid import Extent
from hil.charts.projection import LocalPlane
from hil.charts.sources.points import Points, is_points, read_points
from hil.charts.sources.priority import OTHER, RASTER, require_named, without_outranked
from hil.charts.sources.rasters import DRIVERS, Raster, open_raster
from hil.charts.sources.s57 import Cell, read_cell
from hil.charts.sources.sign import Positive
from hil.charts.sources.survey import Survey, block_means
from hil.common.errors import ConfigError

Array = NDArray[np.float64]

POINTS_DETAIL = 0.5  # of what soundings are apart in the mean: a grid of them
WIDEST = 20.0  # degrees of the earth that a world may be wide: a plane of more is no map of it
POINTS_REACH = 4.0  # the seabed is known around soundings, in what they are apart in the mean


def read_sources(
    paths: list[str], area: Box | None, resolution: float | None = None, updates: bool = True,
    positive: Positive = "auto", reach: float | None = None, crs: str | None = None, newest: bool = False,
    priorities: Mapping[str, int] | None = None,
) -> tuple[Survey, Extent]:  # fmt: skip
    """Return the contents of the files in `area` (all they cover if None), and where that is on the plane, m.

    `resolution` (m) of the grid that is wanted, what the data resolve if None; `updates` and `positive` as in the
    readers, as `crs`; `reach` (m): how far from loose soundings the seabed is known. Where sources overlap,
    `priorities` of files decide which count (hil.charts.sources.priority), and of rasters with the same one the
    first, or the `newest` if that is asked for, those without a date last. Raises ConfigError, MissingExtraError.
    """
    cells: list[Cell] = []
    loose: list[Points] = []
    rasters: list[Raster] = []
    ranks: dict[str, list[int]] = {"cells": [], "loose": [], "rasters": []}
    priorities = priorities or {}
    require_named(priorities, paths)
    for path in paths:
        rank = priorities.get(path, OTHER)
        if path.lower().endswith(".000"):
            cells.append(read_cell(path, updates))
            ranks["cells"].append(rank)
        elif is_points(path):
            loose.append(read_points(path, positive, crs))
            ranks["loose"].append(rank)
        else:
            rasters.append(_open(path, positive, crs))
            ranks["rasters"].append(priorities.get(path, RASTER))
    order = sorted(range(len(rasters)), key=lambda k: rasters[k].date, reverse=True) if newest else range(len(rasters))
    order = sorted(order, key=lambda k: -ranks["rasters"][k])
    if any(not points.geographic for points in loose):
        return _on_a_plane(loose, bool(cells or rasters or area), resolution, reach)
    boxes = [*([covered(cells)] if cells else []), *map(_box, loose), *(raster.box for raster in rasters)]
    area = area or _around(boxes)
    _require_local(area)
    plane = LocalPlane(*_origin(area.centre))
    parts = [survey_charts(cells, plane)] if cells else []
    parts += [_survey(points, _local(points, plane), resolution, reach) for points in loose]
    surface = [*([max(ranks["cells"])] if cells else []), *ranks["loose"]]
    parts = without_outranked(parts, surface)
    parts += [Survey(r.name, None, np.empty((0, 3)), detail=r.spacing, notes=_notes(r)) for r in rasters]
    beds = [(rasters[k].label, partial(rasters[k].depths, plane)) for k in order]
    first = sum(ranks["rasters"][k] >= max(surface, default=OTHER) for k in order)
    together = _together(parts, _origin(area.centre))
    return together._replace(beds=tuple(beds[:first]), fillers=tuple(beds[first:])), _extent(area, plane)


def _open(path: str, positive: Positive, crs: str | None) -> Raster:
    ending = os.path.splitext(path)[1].lower()
    if ending in DRIVERS:
        return open_raster(path, positive, crs)
    if ending[1:].isdigit():
        raise ConfigError(f"{path}: is an update; name the cell itself (.000), updates beside it are found")
    raise ConfigError(
        f"{path}: what is {ending or 'a file without an ending'}? There are .000 (S-57), .tif, .bag, .nc, "
        ".h5 (S-102), .xyz and .csv"
    )


def _on_a_plane(
    loose: list[Points], has_others: bool, resolution: float | None, reach: float | None
) -> tuple[Survey, Extent]:
    """Return soundings in metres from an origin whose place on the earth is unknown."""
    if has_others or any(points.geographic for points in loose):
        raise ConfigError(
            f"{loose[0].name}: has metres, which neither --area nor files in degrees can be put to: "
            "name their coordinate system, as --crs EPSG:32605"
        )
    survey = _together([_survey(points, points.places, resolution, reach) for points in loose], None)
    north, east = survey.soundings[:, 0], survey.soundings[:, 1]
    return survey, (float(north.min()), float(north.max()), float(east.min()), float(east.max()))


def _box(points: Points) -> Box:
    latitudes, longitudes = points.places.T
    if np.ptp(longitudes) > 180.0:  # on both sides of the 180th meridian
        longitudes = longitudes % 360.0
    return Box(*map(float, (latitudes.min(), longitudes.min(), latitudes.max(), longitudes.max())))


def _origin(place: tuple[float, float]) -> tuple[float, float]:
    """Return a place with its longitude from -180 to 180."""
    return place[0], (place[1] + 180.0) % 360.0 - 180.0


def _around(boxes: list[Box]) -> Box:
    corners = np.array(boxes)
    if np.ptp(corners[:, [1, 3]]) > 180.0:  # on both sides of the 180th meridian
        turns = 360.0 * np.floor(corners[:, 1] / 360.0)
        corners[:, [1, 3]] -= turns[:, None]
    return Box(*corners[:, :2].min(axis=0).tolist(), *corners[:, 2:].max(axis=0).tolist())


def _require_local(area: Box) -> None:
    size = area.north - area.south, (area.east - area.west) * np.cos(np.radians(area.centre[0]))
    if max(size) > WIDEST:
        south, west = (np.floor(10.0 * value) / 10.0 for value in _origin(area.centre))
        raise ConfigError(
            f"the area is {area.north - area.south:.0f} x {area.east - area.west:.0f} degrees large, too large for a "
            f"world: name a part of at most {WIDEST:g}, as "
            f"--area={south:.1f},{west:.1f},{south + 0.1:.1f},{west + 0.1:.1f}"
        )


def _local(points: Points, plane: LocalPlane) -> Array:
    return np.column_stack(plane.to_local(points.places[:, 0], points.places[:, 1]))


def _survey(points: Points, places: Array, resolution: float | None, reach: float | None) -> Survey:
    """Return single soundings, or their mean where several are nearer to each other than the grid's nodes."""
    detail = max(0.01, POINTS_DETAIL * _apart(places))
    soundings = block_means(np.column_stack([places, points.depths]), resolution or detail)
    reach = POINTS_REACH * _apart(soundings) if reach is None else reach
    return Survey(points.name, None, soundings, detail=detail, reach=reach, notes=_notes(points))


def _notes(source: Points | Raster) -> tuple[str, ...]:
    return (source.note,) if source.note else ()


def _apart(places: Array) -> float:
    """Return the side of the square, m, that each of `places` (n, 2 or more) has for itself in the mean."""
    return float(np.sqrt(np.ptp(places[:, :2], axis=0).prod() / len(places)))


def _together(parts: list[Survey], origin: tuple[float, float] | None) -> Survey:
    """Return one survey of all: areas and hazards are the charts', of which there is one part at most."""
    return parts[0]._replace(
        source="; ".join(part.source for part in parts),
        origin=origin,
        soundings=np.concatenate([part.soundings for part in parts]),
        detail=min(part.detail for part in parts),
        reach=max(part.reach for part in parts),
        notes=tuple(note for part in parts for note in part.notes),
    )


def _extent(area: Box, plane: LocalPlane) -> Extent:
    """Return the rectangle on the plane around an area's corners and the middles of its sides."""
    south, west, north, east = area
    latitude, longitude = area.centre
    corners = np.array([
        (south, west), (south, east), (north, west), (north, east),
        (south, longitude), (north, longitude), (latitude, west), (latitude, east),
    ])  # fmt: skip
    norths, easts = plane.to_local(corners[:, 0], corners[:, 1])
    return float(norths.min()), float(norths.max()), float(easts.min()), float(easts.max())

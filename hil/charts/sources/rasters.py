"""Depths from rasters: GeoTIFF, BAG, GEBCO's NetCDF, and whatever else GDAL reads, through rasterio."""

import os
import sys
import warnings
from math import ceil, floor
from typing import Any

import numpy as np

from hil.charts.chart_survey import Box
from hil.charts.projection import LocalPlane
from hil.charts.sources.points import Points, Positive, downwards
from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import check_file

WGS84 = "EPSG:4326"
ENDINGS = (".tif", ".tiff", ".bag", ".nc", ".asc", ".vrt")
MOST_PIXELS = 4_000_000  # a larger raster is averaged down to that while it is read


def read_raster(path: str, area: Box | None = None, positive: Positive = "auto") -> Points:
    """Return the known pixels of the first band of `path`, only those in `area`; positions in WGS 84.

    A raster without a coordinate system is taken as longitude and latitude. A shift between vertical datums is not
    applied. Raises ConfigError, MissingExtraError.
    """
    try:
        import rasterio
        from rasterio.errors import NotGeoreferencedWarning, RasterioError
    except ImportError:
        raise MissingExtraError(f"{path}: rasters need rasterio: pip install 'uuv-hil[raster]'") from None
    check_file(path, sys.maxsize)  # of any size: only what is asked for is read
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)  # of a NetCDF as a whole; and see _window
            with rasterio.open(path) as source:
                name = _depths_of(path, source.subdatasets) if source.subdatasets else path
            with rasterio.open(name) as source:
                return _read(path, source, area, positive)
    except (RasterioError, OSError) as error:
        raise ConfigError(f"{path}: cannot be read as a raster: {error}") from None


def _depths_of(path: str, parts: list[str]) -> str:
    """Return which of a NetCDF's variables has the depths, as GDAL names it."""
    for part in parts:
        if part.rpartition(":")[2].strip('"/').lower() in ("elevation", "depth", "z", "bathymetry"):
            return part
    raise ConfigError(f"{path}: holds {', '.join(part.rpartition(':')[2] for part in parts)}, and none is elevation")


def _read(path: str, source: Any, area: Box | None, positive: Positive) -> Points:
    from rasterio.enums import Resampling

    rows, columns = _window(path, source, area)
    high, wide = rows[1] - rows[0], columns[1] - columns[0]
    thinning = max(1.0, (high * wide / MOST_PIXELS) ** 0.5)
    shape = max(1, int(high / thinning)), max(1, int(wide / thinning))
    band = source.read(1, window=(rows, columns), out_shape=shape, masked=True, resampling=Resampling.average)
    known = ~np.ma.getmaskarray(band) & np.isfinite(np.ma.getdata(band))
    at_row, at_column = np.nonzero(known)
    if not len(at_row):
        raise ConfigError(f"{path}: not one pixel with a depth in it: take another file, or move the area with --area")
    x = source.transform.c + source.transform.a * (columns[0] + (at_column + 0.5) * wide / shape[1])
    y = source.transform.f + source.transform.e * (rows[0] + (at_row + 0.5) * high / shape[0])
    if source.crs is not None:
        from rasterio.warp import transform

        x, y = (np.asarray(axis) for axis in transform(source.crs, WGS84, x, y))
    places = np.column_stack([y, x])
    depths = downwards(np.ma.getdata(band)[known].astype(float), positive)
    return Points(os.path.basename(path), places, depths, True, _spacing(places, known))


def _window(path: str, source: Any, area: Box | None) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the rows and the columns, from and to, of the pixels in `area`."""
    place = source.transform
    if place.is_identity or place.b != 0.0 or place.d != 0.0:
        raise ConfigError(f"{path}: says not where on the earth it is, or is turned: warp it to longitude and latitude")
    if area is None:
        return (0, source.height), (0, source.width)
    sides = area.west, area.south, area.east, area.north
    if source.crs is not None:
        from rasterio.warp import transform_bounds

        sides = transform_bounds(WGS84, source.crs, *sides)
    west, south, east, north = sides
    columns = _clipped((west - place.c) / place.a, (east - place.c) / place.a, source.width)
    rows = _clipped((south - place.f) / place.e, (north - place.f) / place.e, source.height)
    if rows[0] >= rows[1] or columns[0] >= columns[1]:
        raise ConfigError(f"{path}: no pixel of it is in the area: move or widen it with --area")
    return rows, columns


def _clipped(one: float, other: float, size: int) -> tuple[int, int]:
    return max(0, floor(min(one, other))), min(size, ceil(max(one, other)))


def _spacing(places: Any, known: Any) -> float:
    """Return the side of a pixel in m: the root of the area of the box around all of them, per pixel."""
    plane = LocalPlane(*places.mean(axis=0))
    north, east = plane.to_local(places[:, 0], places[:, 1])
    rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    steps = [float(np.ptp(axis)) / max(1, int(np.ptp(index))) for axis, index in ((north, rows), (east, columns))]
    return max(steps)

"""Depths from rasters: GeoTIFF, BAG, GEBCO's NetCDF, S-102 and Esri's ASCII grid, read and resampled by GDAL."""

import os
import re
import sys
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.chart_survey import Box
from hil.charts.projection import LocalPlane
from hil.charts.sources.s102 import with_uncertainty
from hil.charts.sources.sign import Positive, direction, is_of_depths, metres_in, metres_of, require_possible
from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import check_file

Array = NDArray[np.float64]

WGS84 = "EPSG:4326"
# Without a driver GDAL goes by what a file holds; a WMS, a VRT and others name more files and hosts to be read.
DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".bag": "BAG", ".nc": "netCDF", ".asc": "AAIGrid", ".h5": "S102"}
# Where a format has a survey's day: S-102's issue, BAG's and TIFF's time, NetCDF's by the CF and ACDD conventions.
DATES = ("issuedate", "bag_datetime", "time_coverage_end", "date_issued", "date_created", "tifftag_datetime")
FINEST = {"MODE": "RESAMPLED_GRID"}  # of a BAG of variable resolution, whose own band is its coarse overview
SAMPLED = 512  # pixels along a side, from which the sign of a raster without a name is seen
COARSER = 1.5  # nodes farther apart than so many pixels get the mean of their pixels, others are interpolated


class Raster(NamedTuple):
    """A raster on the earth. `file` and `driver` are GDAL's names of it and of its format, `crs` is of its positions.

    `options` are GDAL's for opening it. `band` has the depths. `box`: where it lies, degrees, east beyond 180 where it
    crosses that; `spacing`: the side of a pixel, m; `scale` and `offset` make depths in m of its numbers. `date`: the
    day of the survey or of its issue, as 2024-03-01, "" where the file names none. `note`: what was assumed of its
    values, "" for nothing.
    """

    name: str
    file: str
    driver: str
    crs: Any
    box: Box
    spacing: float
    scale: float
    offset: float
    date: str = ""
    band: int = 1
    note: str = ""
    options: Mapping[str, str] = {}
    memory: Any = None  # that `file` names, where it does not name one on disk

    @property
    def label(self) -> str:
        """Its name, with its date."""
        return f"{self.name} of {self.date}" if self.date else self.name

    def depths(self, plane: LocalPlane, north: Array, east: Array) -> Array:
        """Return depths (m) at the crossings of evenly growing `north` and `east` (m on `plane`), nan where none is.

        GDAL resamples: bilinear, or the mean of the pixels of a node. Raises ConfigError.
        """
        import rasterio
        from rasterio.vrt import WarpedVRT
        from rasterio.warp import Resampling

        step = float(north[1] - north[0])
        # The ellipsoid's points dropped onto the plane that touches it: what LocalPlane does.
        local = f"+proj=ortho +lat_0={plane.latitude!r} +lon_0={plane.longitude!r} +datum=WGS84 +units=m"
        where = rasterio.Affine(step, 0.0, east[0] - 0.5 * step, 0.0, -step, north[-1] + 0.5 * step)
        how = Resampling.average if step > COARSER * self.spacing else Resampling.bilinear
        try:
            with (
                rasterio.open(self.file, driver=self.driver, **self.options) as source,
                WarpedVRT(
                    source, src_crs=self.crs, crs=local, transform=where, width=len(east), height=len(north),
                    resampling=how, src_nodata=source.nodata, nodata=np.nan, dtype="float32",
                    UNIFIED_SRC_NODATA="NO",  # or a depth of none counts where the file says how sure it is of it
                ) as warped,
            ):  # fmt: skip
                found = warped.read(self.band)
        except (rasterio.errors.RasterioError, OSError) as error:
            raise ConfigError(f"{self.name}: cannot be resampled: {error}") from None
        depths = self.scale * found[::-1].astype(float) + self.offset
        require_possible(self.name, depths[~np.isnan(depths)])
        return np.asarray(depths)


def open_raster(path: str, positive: Positive = "auto", crs: str | None = None) -> Raster:
    """Return the band of `path` that is named as depths or heights, else the first.

    `crs` (as EPSG:32605) is of its positions if it says none itself. Without either, positions in degrees are taken as
    WGS 84. A shift between vertical datums is not applied. The ending of its name, one of DRIVERS, says its format.
    Raises ConfigError, MissingExtraError.
    """
    try:
        import rasterio.io
        from rasterio._err import CPLE_BaseError  # of a coordinate system that is not one of the earth
        from rasterio.errors import NotGeoreferencedWarning, RasterioError
    except ImportError:
        raise MissingExtraError(f"{path}: rasters need rasterio: pip install 'uuv-hil[raster]'") from None
    driver = DRIVERS[os.path.splitext(path)[1].lower()]
    check_file(path, sys.maxsize)  # of any size: only what is asked for is read
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)  # of a NetCDF as a whole; and see _placed
            memory = _readable_s102(path) if driver == "S102" else None
            whole = memory.name if memory else path
            with rasterio.open(whole, driver=driver) as source:
                # BAG and S-102 have the depths in their own bands, and in parts how they were measured
                parts = () if source.count else source.subdatasets
                file = _depths_of(path, driver, parts) if parts else whole
                options = FINEST if float(source.tags().get("MIN_RESOLUTION_X", 0.0)) > 0.0 else {}
            with rasterio.open(file, driver=driver, **options) as source:
                return _placed(path, file, source, positive, crs)._replace(options=options, memory=memory)
    except (RasterioError, CPLE_BaseError, OSError) as error:
        raise ConfigError(f"{path}: cannot be read as a raster: {error}") from None


def _readable_s102(path: str) -> Any:
    """Return a file in memory to read instead of an S-102 file that this GDAL does not know as one, else None."""
    import rasterio

    with suppress(rasterio.errors.RasterioIOError), rasterio.open(path, driver="S102"):
        return None
    made = with_uncertainty(path)
    return rasterio.io.MemoryFile(made, ext=".h5") if made else None


def _depths_of(path: str, driver: str, parts: Sequence[str]) -> str:
    """Return which of a file's variables has the depths, as GDAL names it, by their names, else by what these mean."""
    import rasterio

    names = [part.rpartition(":")[2].strip('"/') for part in parts]
    for part, name in zip(parts, names, strict=True):
        if is_of_depths(name):
            return part
    for part in parts:
        with rasterio.open(part, driver=driver) as source:
            tags = source.tags(1)
        if any(is_of_depths(tags.get(key, "")) for key in ("standard_name", "long_name")):
            return part
    raise ConfigError(
        f"{path}: holds {', '.join(names)}, and none is named as depth or elevation: make a GeoTIFF of the one that "
        f"is, as gdal_translate {driver.upper()}:{path}:{names[0]} bed.tif"
    )


def _placed(path: str, file: str, source: Any, positive: Positive, crs: str | None) -> Raster:
    from rasterio.crs import CRS
    from rasterio.warp import transform, transform_bounds

    if source.transform.is_identity:
        raise ConfigError(f"{path}: says not where on the earth it is: warp it to longitude and latitude")
    bounds = source.bounds
    where = source.crs or (known_crs(crs) if crs else None)
    if where is None and max(abs(bounds.top), abs(bounds.bottom)) > 90.0:
        raise ConfigError(f"{path}: has metres and no coordinate system: name it, as --crs EPSG:32605")
    where = where or CRS.from_string(WGS84)
    west, south, east, north = bounds if where.is_geographic else transform_bounds(where, WGS84, *bounds)
    box = Box(min(south, north), west, max(south, north), east + 360.0 if east < west else east)
    middle = source.height // 2, source.width // 2
    if where.is_geographic and max(-west, east) >= 180.0:  # else GDAL finds nothing of it beyond the meridian
        where = CRS.from_dict({**where.to_dict(), "lon_wrap": 0.5 * (west + east)})
    a, b, c, d, e, f = source.transform[:6]  # of the positions of pixels
    pixels = [(middle[1] + column, middle[0] + row) for row, column in ((0, 0), (1, 0), (0, 1))]
    corners = [(a * column + b * row + c, d * column + e * row + f) for column, row in pixels]
    longitude, latitude = (np.array(axis) for axis in transform(where, WGS84, *zip(*corners, strict=True)))
    local = np.column_stack(LocalPlane(float(latitude[0]), float(longitude[0])).to_local(latitude, longitude))
    spacing = float(np.hypot(*(local[1:] - local[0]).T).max())
    band = _band(source)
    unit = _unit(path, source, band)
    is_upwards, note = _direction(path, file, source, positive, band, unit)
    sign = -unit if is_upwards else unit
    scale, offset = sign * source.scales[band - 1], sign * source.offsets[band - 1]
    date = _date({**source.tags(), **source.tags(band)})
    return Raster(os.path.basename(path), file, source.driver, where, box, spacing, scale, offset, date, band, note)


def _band(source: Any) -> int:
    """Return which of a raster's bands has the depths: the first with a name of such, else the first."""
    for band, name in enumerate(source.descriptions, 1):
        if name and is_of_depths(name):
            return band
    return 1


def _unit(path: str, source: Any, band: int) -> float:
    """Return the metres of the unit that a band's values have; those without one are in metres. Raises ConfigError."""
    name = source.units[band - 1] or source.tags(band).get("units") or ""
    return metres_of(path, name) if name else metres_in(source.descriptions[band - 1] or "")


def _date(tags: dict[str, str]) -> str:
    """Return the day that a raster's metadata name, as 2024-03-01; "" if they name none."""
    words = {key.rpartition("#")[2].lower(): str(value) for key, value in tags.items()}
    for key in DATES:
        match = re.match(r"(\d{4})[-:]?(\d{2})[-:]?(\d{2})", words.get(key, ""))
        if match:
            return "-".join(match.groups())
    return ""


def known_crs(name: str) -> Any:
    """Return the coordinate system that a person names. Raises ConfigError."""
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    try:
        return CRS.from_user_input(name)
    except CRSError as error:
        raise ConfigError(f"--crs: {name}: no such coordinate system ({error}); name one as EPSG:32605") from None


def _direction(path: str, file: str, source: Any, positive: Positive, band: int, unit: float) -> tuple[bool, str]:
    """Return whether the values of a band count upwards, and what was assumed for that."""
    tags = {key.rpartition("#")[2].lower(): str(value) for key, value in source.tags(band).items()}
    counted = tags.get("positive", "").strip().lower()
    if positive == "auto" and counted in ("up", "down"):
        return counted == "up", ""
    if positive == "auto" and source.driver in ("BAG", "S102"):  # elevations by definition; GDAL gives depths of S-102
        return bool(source.driver == "BAG"), ""
    named = [tags.get("standard_name"), tags.get("long_name"), source.descriptions[band - 1], file.rpartition(":")[2]]
    shape = min(SAMPLED, source.height), min(SAMPLED, source.width)
    values = source.read(band, out_shape=shape, masked=True)
    known = unit * (values.compressed() * source.scales[band - 1] + source.offsets[band - 1])
    known = known[~np.isnan(known)]
    if not len(known):
        raise ConfigError(f"{path}: not one pixel with a depth in it: take another file")
    require_possible(path, known)
    return direction(path, positive, [word for word in named if word], float(known.min()), float(known.max()))

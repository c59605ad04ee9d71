"""Read and resample depths from rasters with GDAL: GeoTIFF, BAG, NetCDF, S-102; grids of Esri, GMT, Surfer."""

import os
import re
import sys
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.chart_survey import GeoBox
from hil.charts.projection import LocalPlane
from hil.charts.sources.s102 import with_uncertainty
from hil.charts.sources.sign import (
    Positive,
    detect_direction,
    is_depth_name,
    metres_in_name,
    metres_per_unit,
    require_possible,
)
from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import check_file

Array = NDArray[np.float64]

WGS84 = "EPSG:4326"
# The driver is set by the ending. Otherwise GDAL detects the format from the contents, and some formats (WMS, VRT) make
# it read other files and hosts.
DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".bag": "BAG", ".nc": "netCDF", ".asc": "AAIGrid", ".h5": "S102"}
GRIDS = {b"DSAA": "GSAG", b"DSBB": "GSBG", b"DSRB": "GS7BG"}  # .grd of Surfer by first bytes; GMT's is NetCDF
# Metadata with the date of a survey: of S-102, BAG, NetCDF (by the CF and ACDD conventions) and TIFF
DATES = ("issuedate", "bag_datetime", "time_coverage_end", "date_issued", "date_created", "tifftag_datetime")
FINEST = {"MODE": "RESAMPLED_GRID"}  # for a BAG of variable resolution, whose default band is a coarse overview
SAMPLED = 512  # pixels along a side of the sample that shows the sign of the values
AVERAGE_ABOVE = 1.5  # node spacing in pixels above which pixels are averaged instead of interpolated


class Raster(NamedTuple):
    """A raster of depths with its position on the earth.

    - `file`, `driver`, `options`: arguments with which GDAL opens it.
    - `crs`: coordinate system of its positions.
    - `box`: its area, degrees.
    - `spacing`: side of a pixel, m.
    - `scale`, `offset`: depth in m = `scale` * value + `offset`.
    - `date`: of the survey or of its issue, as 2024-03-01, "" if the file has none.
    - `band`: number of the band with the depths.
    - `note`: what was assumed of its values, "" for nothing.
    - `memory`: the file in memory that `file` names, None if `file` is on disk.
    """

    name: str
    file: str
    driver: str
    crs: Any
    box: GeoBox
    spacing: float
    scale: float
    offset: float
    date: str = ""
    band: int = 1
    note: str = ""
    options: Mapping[str, str] = {}
    memory: Any = None

    @property
    def label(self) -> str:
        """Its name, with its date."""
        return f"{self.name} of {self.date}" if self.date else self.name

    def depths(self, plane: LocalPlane, north: Array, east: Array) -> Array:
        """Return depths (m) at the crossings of evenly spaced `north` and `east` (m on `plane`), nan where unknown.

        Resampled by GDAL: bilinear, or the mean of the pixels of a node. Raises ConfigError.
        """
        import rasterio
        from rasterio.vrt import WarpedVRT
        from rasterio.warp import Resampling

        step = float(north[1] - north[0])
        # The orthographic projection is that of LocalPlane.
        local = f"+proj=ortho +lat_0={plane.latitude!r} +lon_0={plane.longitude!r} +datum=WGS84 +units=m"
        where = rasterio.Affine(step, 0.0, east[0] - 0.5 * step, 0.0, -step, north[-1] + 0.5 * step)
        how = Resampling.average if step > AVERAGE_ABOVE * self.spacing else Resampling.bilinear
        try:
            with (
                rasterio.open(self.file, driver=self.driver, **self.options) as source,
                WarpedVRT(
                    source, src_crs=self.crs, crs=local, transform=where, width=len(east), height=len(north),
                    resampling=how, src_nodata=_no_data(source, self.band), nodata=np.nan, dtype="float32",
                    UNIFIED_SRC_NODATA="NO",  # else a pixel without a depth counts if its uncertainty has a value
                ) as warped,
            ):  # fmt: skip
                found = warped.read(self.band)
        except (rasterio.errors.RasterioError, OSError) as error:
            raise ConfigError(f"{self.name}: cannot be resampled: {_cause(error)}") from None
        depths = self.scale * found[::-1].astype(float) + self.offset
        require_possible(self.name, depths[~np.isnan(depths)])
        return np.asarray(depths)


def _no_data(source: Any, band: int) -> float | None:
    """Return the value that marks pixels without a depth; nan for decimals without a declared one, as it is no depth.

    GDAL spreads an undeclared nan to all pixels that it resamples together with it.
    """
    declared: float | None = source.nodata
    return np.nan if declared is None and source.dtypes[band - 1].startswith("float") else declared


def open_raster(path: str, positive: Positive = "auto", crs: str | None = None) -> Raster:
    """Return the raster of the band of `path` that is named as depths or heights, else of the first band.

    `crs` (for example EPSG:32605) applies to a file that states no coordinate system. Without either, positions in
    degrees are WGS 84. No shift between vertical datums is applied. The format follows from the ending of the name, of
    a .grd also from its first bytes. Raises ConfigError, MissingExtraError.
    """
    try:
        import rasterio.io
        from rasterio._err import CPLE_BaseError  # raised for a coordinate system that is not one of the earth
        from rasterio.errors import NotGeoreferencedWarning, RasterioError
    except ImportError:
        raise MissingExtraError(f"{path}: rasters need rasterio: pip install 'uuv-hil[raster]'") from None
    check_file(path, sys.maxsize)  # no limit: only the needed part is read
    driver = _driver(path)
    try:
        with warnings.catch_warnings():
            # A NetCDF as a whole has no position; _describe_raster checks that of the variable.
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            memory = _readable_s102(path) if driver == "S102" else None
            source_path = memory.name if memory else path
            with rasterio.open(source_path, driver=driver) as source:
                # BAG and S-102 have depths in bands of the file; their subdatasets hold other data.
                parts = () if source.count else source.subdatasets
                file = _select_variable(path, driver, parts) if parts else source_path
                options = FINEST if float(source.tags().get("MIN_RESOLUTION_X", 0.0)) > 0.0 else {}
            with rasterio.open(file, driver=driver, **options) as source:
                return _describe_raster(path, file, source, positive, crs)._replace(options=options, memory=memory)
    except (RasterioError, CPLE_BaseError, OSError) as error:
        raise ConfigError(
            f"{path}: cannot be read as a raster of {driver}, use a whole file of that format: {_cause(error)}"
        ) from None


def is_raster(path: str) -> bool:
    """Return whether the ending of a file's name is that of a raster."""
    return os.path.splitext(path)[1].lower() in (*DRIVERS, ".grd")


def _driver(path: str) -> str:
    ending = os.path.splitext(path)[1].lower()
    if ending != ".grd":
        return DRIVERS[ending]
    with open(path, "rb") as file:
        return GRIDS.get(file.read(4), DRIVERS[".nc"])


def _cause(error: BaseException) -> str:
    """Return the text of the first of a chain of errors: rasterio's own text may refer to another one."""
    while error.__cause__ is not None:
        error = error.__cause__
    return str(error)


def _readable_s102(path: str) -> Any:
    """Return a file in memory that replaces an S-102 file which this GDAL cannot read; None if it can."""
    import rasterio

    with suppress(rasterio.errors.RasterioIOError), rasterio.open(path, driver="S102"):
        return None
    made = with_uncertainty(path)
    return rasterio.io.MemoryFile(made, ext=".h5") if made else None


def _select_variable(path: str, driver: str, parts: Sequence[str]) -> str:
    """Return GDAL's name of the variable with the depths, by the variables' names, else by their descriptions."""
    import rasterio

    names = [part.rpartition(":")[2].strip('"/') for part in parts]
    for part, name in zip(parts, names, strict=True):
        if is_depth_name(name):
            return part
    for part in parts:
        with rasterio.open(part, driver=driver) as source:
            tags = source.tags(1)
        if any(is_depth_name(tags.get(key, "")) for key in ("standard_name", "long_name")):
            return part
    raise ConfigError(
        f"{path}: has {', '.join(names)}, and none is named as depth or elevation: convert the right one to a GeoTIFF, "
        f"for example gdal_translate {driver.upper()}:{path}:{names[0]} bed.tif"
    )


def _describe_raster(path: str, file: str, source: Any, positive: Positive, crs: str | None) -> Raster:
    """Return the raster of an open dataset: its position, spacing, and the scale of its depths. Raises ConfigError."""
    from rasterio.crs import CRS
    from rasterio.warp import transform, transform_bounds

    if source.transform.is_identity:
        raise ConfigError(f"{path}: has no position on the earth: warp it to longitude and latitude")
    bounds = source.bounds
    own = source.crs if source.crs and (source.crs.is_geographic or source.crs.is_projected) else None
    where = own or (parse_crs(crs) if crs else None)  # a local one, of a building site or a pool, names no place
    if where is None and max(abs(bounds.top), abs(bounds.bottom)) > 90.0:
        raise ConfigError(
            f"{path}: has positions in metres but no coordinate system: name it, for example --crs EPSG:32605"
        )
    where = where or CRS.from_string(WGS84)
    if where.is_geographic and (max(abs(bounds.top), abs(bounds.bottom)) > 91.0 or max(map(abs, bounds)) > 541.0):
        raise ConfigError(
            f"{path}: has a coordinate system in degrees, and positions up to {max(map(abs, bounds)):g}: correct the "
            "file, for example with gdal_edit.py -a_srs EPSG:32605"
        )
    west, south, east, north = bounds if where.is_geographic else transform_bounds(where, WGS84, *bounds)
    box = GeoBox(min(south, north), west, max(south, north), east + 360.0 if east < west else east)
    middle = source.height // 2, source.width // 2
    if where.is_geographic and max(-west, east) >= 180.0:  # else GDAL omits the part beyond the 180th meridian
        where = CRS.from_dict({**where.to_dict(), "lon_wrap": 0.5 * (west + east)})
    a, b, c, d, e, f = source.transform[:6]  # from columns and rows to positions
    pixels = [(middle[1] + column, middle[0] + row) for row, column in ((0, 0), (1, 0), (0, 1))]
    corners = [(a * column + b * row + c, d * column + e * row + f) for column, row in pixels]
    longitude, latitude = (np.array(axis) for axis in transform(where, WGS84, *zip(*corners, strict=True)))
    local = np.column_stack(LocalPlane(float(latitude[0]), float(longitude[0])).to_local(latitude, longitude))
    spacing = float(np.hypot(*(local[1:] - local[0]).T).max())
    band = _band(source)
    if source.colorinterp[band - 1].name in ("red", "palette") and source.dtypes[band - 1] == "uint8":
        raise ConfigError(f"{path}: is a picture, whose colours are no depths: use the raster that it was drawn from")
    unit = _unit(path, source, band)
    is_upwards, note = _detect_direction(path, file, source, positive, band, unit)
    sign = -unit if is_upwards else unit
    scale, offset = sign * source.scales[band - 1], sign * source.offsets[band - 1]
    if own and crs and own != parse_crs(crs):
        own_note = f"{path}: --crs is not used, because the file has its own coordinate system"
        note = f"{note}; {own_note}" if note else own_note
    date = _date({**source.tags(), **source.tags(band)})
    return Raster(os.path.basename(path), file, source.driver, where, box, spacing, scale, offset, date, band, note)


def _band(source: Any) -> int:
    """Return the number of the band with the depths: the first with such a name, else 1."""
    for band, name in enumerate(source.descriptions, 1):
        if name and is_depth_name(name):
            return band
    return 1


def _unit(path: str, source: Any, band: int) -> float:
    """Return the length in m of the unit of a band's values, by default 1. Raises ConfigError for an unknown unit."""
    name = source.units[band - 1] or source.tags(band).get("units") or ""
    return metres_per_unit(path, name) if name else metres_in_name(source.descriptions[band - 1] or "")


def _date(tags: dict[str, str]) -> str:
    """Return the date in a raster's metadata, as 2024-03-01; "" if there is none."""
    words = {key.rpartition("#")[2].lower(): str(value) for key, value in tags.items()}
    for key in DATES:
        match = re.match(r"(\d{4})[-:]?(\d{2})[-:]?(\d{2})", words.get(key, ""))
        if match:
            return "-".join(match.groups())
    return ""


def parse_crs(name: str) -> Any:
    """Return the coordinate system with the name that the user gave. Raises ConfigError for an unknown one."""
    import rasterio
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    try:
        with rasterio.Env():  # else PROJ prints a line of its own
            return CRS.from_user_input(name)
    except CRSError as error:
        raise ConfigError(f"--crs: {name}: unknown coordinate system ({error}); use for example EPSG:32605") from None


def _detect_direction(
    path: str, file: str, source: Any, positive: Positive, band: int, unit: float
) -> tuple[bool, str]:
    """Return whether the values of a band count upwards, and a note on what was assumed, "" for nothing."""
    tags = {key.rpartition("#")[2].lower(): str(value) for key, value in source.tags(band).items()}
    counted = tags.get("positive", "").strip().lower()
    if positive == "auto" and counted in ("up", "down"):
        return counted == "up", ""
    if positive == "auto" and source.driver in ("BAG", "S102"):  # BAG has elevations; GDAL returns depths of S-102
        return bool(source.driver == "BAG"), ""
    name = tags.get("netcdf_varname") or os.path.basename(file)
    named = [tags.get("standard_name"), tags.get("long_name"), source.descriptions[band - 1], name]
    shape = min(SAMPLED, source.height), min(SAMPLED, source.width)
    values = source.read(band, out_shape=shape, masked=True)
    known = unit * (values.compressed() * source.scales[band - 1] + source.offsets[band - 1])
    known = known[~np.isnan(known)]
    if not len(known):
        raise ConfigError(f"{path}: no pixel has a depth: use another file")
    require_possible(path, known)
    return detect_direction(path, positive, [word for word in named if word], float(known.min()), float(known.max()))

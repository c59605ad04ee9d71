"""Read and resample depths from rasters with GDAL: GeoTIFF, BAG, NetCDF, S-102; grids of Esri, GMT, Surfer."""

import os
import sys
import warnings
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.chart_survey import GeoBox
from hil.charts.projection import LocalPlane
from hil.charts.sources import netcdf
from hil.charts.sources.s102 import with_uncertainty
from hil.charts.sources.sign import (
    Declared,
    detect_direction,
    first_hint,
    is_depth_name,
    join_notes,
    require_possible,
    unit_in_name,
)
from hil.charts.sources.systems import WGS84, depth_unit, parse_crs, vertical_axis
from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import check_file

Array = NDArray[np.float64]

# The driver is set by the ending. Otherwise GDAL detects the format from the contents, and some formats (WMS, VRT) make
# it read other files and hosts.
DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".bag": "BAG", ".nc": "netCDF", ".asc": "AAIGrid", ".h5": "S102"}
GRIDS = {b"DSAA": "GSAG", b"DSBB": "GSBG", b"DSRB": "GS7BG"}  # .grd of Surfer by first bytes; GMT's is NetCDF
ABOUT = ("title", "summary", "description", "tifftag_imagedescription", "tifftag_documentname")  # texts on the file
FINEST = {"MODE": "RESAMPLED_GRID"}  # for a BAG of variable resolution, whose default band is a coarse overview
SAMPLED = 512  # pixels along a side of the sample that shows the sign of the values
ALIKE = 0.02  # pixels by which two positions of a corner may differ
SHOALEST_ABOVE = 1.5  # node spacing in pixels above which a node has the shoalest of its pixels, not an interpolation


class Raster(NamedTuple):
    """A raster of depths with its position on the earth.

    - `file`, `driver`, `options`: arguments with which GDAL opens it.
    - `crs`: coordinate system of its positions.
    - `box`: its area, degrees.
    - `spacing`: side of a pixel, m.
    - `scale`, `offset`: depth in m = `scale` * value + `offset`.
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
    band: int = 1
    note: str = ""
    options: Mapping[str, str] = {}
    memory: Any = None

    def depths(self, plane: LocalPlane, north: Array, east: Array) -> Array:
        """Return depths (m) at the crossings of evenly spaced `north` and `east` (m on `plane`), nan where unknown.

        Resampled by GDAL: bilinear, or the shoalest pixel of a node, so that no needle is lost. Raises ConfigError.
        """
        import rasterio
        from rasterio.vrt import WarpedVRT
        from rasterio.warp import Resampling

        step = float(north[1] - north[0])
        # The orthographic projection is that of LocalPlane.
        local = f"+proj=ortho +lat_0={plane.latitude!r} +lon_0={plane.longitude!r} +datum=WGS84 +units=m"
        where = rasterio.Affine(step, 0.0, east[0] - 0.5 * step, 0.0, -step, north[-1] + 0.5 * step)
        how = Resampling.bilinear
        if step > SHOALEST_ABOVE * self.spacing:
            how = Resampling.max if self.scale < 0.0 else Resampling.min  # heights, depths
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


def open_raster(path: str, declared: Declared = Declared()) -> Raster:
    """Return the raster of the declared band or variable, else of the one named as depths or heights, else the first.

    Without a coordinate system, positions in degrees are WGS 84. No shift between
    vertical datums is applied. The format follows from the ending of the name, of a .grd also from its first bytes.
    Raises ConfigError, MissingExtraError.
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
        with warnings.catch_warnings(), rasterio.Env(GTIFF_REPORT_COMPD_CS=True):  # with their vertical axis
            # A NetCDF as a whole has no position; _describe_raster checks that of the variable.
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            opened = _open_netcdf(path, declared) if driver == "netCDF" else None
            file, driver, memory, number, note = opened or (path, driver, None, 0, "")
            if driver == "S102":
                memory = _readable_s102(path)
                file = memory.name if memory else path
            with rasterio.open(file, driver=driver) as source:
                options = FINEST if float(source.tags().get("MIN_RESOLUTION_X", 0.0)) > 0.0 else {}
            with rasterio.open(file, driver=driver, **options) as source:
                band = number or _band(path, source, declared)
                if source.count > 1 and not (
                    number or declared.layer or is_depth_name(source.descriptions[band - 1] or "")
                ):
                    note = f"{path}: the first of its {source.count} bands is used, none has a name of depths (--layer)"
                found = _describe_raster(path, file, source, band, declared)
                return found._replace(options=options, memory=memory, note=join_notes(note, found.note))
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path}: its coordinate system, in the file or in a .prj beside it, is not UTF-8 text ({error}): correct "
            "it, or remove the .prj and name the system with --crs"
        ) from None
    except (RasterioError, CPLE_BaseError, OSError) as error:
        raise ConfigError(
            f"{path}: cannot be read as a raster of {driver}, use a whole file of that format: {_cause(error)}"
        ) from None


def _open_netcdf(path: str, declared: Declared) -> tuple[str, str, Any, int, str] | None:
    """Return file, driver, file in memory, band, and note of the layer of depths, None if GDAL has to find it.

    The layer is laid out again in memory if GDAL does not read it as its axes say.
    """
    import rasterio

    with netcdf.open_netcdf(path) as variables:
        layer = netcdf.find_layer(path, variables, declared)
        if layer is None:
            return None
        file = f'NETCDF:"{path}":{layer.variable.name}'
        if layer.north.data.ndim == 2:
            with rasterio.open(file, driver="netCDF") as source:
                memory = _in_memory(*netcdf.read_curved(path, layer), source, layer.band)
            note = f"{path}: its positions have two dimensions: interpolated to even ones"
            return memory.name, "GTiff", memory, 1, join_notes(layer.note, note)
        with rasterio.open(file, driver="netCDF") as source:
            is_projected = bool(source.crs and source.crs.is_projected)
            is_geographic = layer.is_geographic(is_projected)
            metres = source.crs.linear_units_factor[1] if is_projected else 1.0
            east, south = netcdf.find_axes(path, layer, 0.0 if is_geographic else metres)
            x, y = (axis.even[1] - axis.even[0] for axis in (east, south))
            where = rasterio.Affine(x, 0.0, east.even[0] - 0.5 * x, 0.0, -y, 0.5 * y - south.even[0])
            is_even = len(east.at) == len(east.even) and len(south.at) == len(south.even)
            # Two corners in pixels: the same places if GDAL has the axes right
            off = np.subtract(
                [~where @ (source.transform @ corner) for corner in ((0.0, 0.0), source.shape[::-1])],
                [(0.0, 0.0), source.shape[::-1]],
            )
            if layer.band and is_even and np.abs(off).max() < ALIKE:
                return file, "netCDF", None, layer.band, layer.note
            crs = WGS84 if is_geographic and is_projected else source.crs
            memory = _in_memory(netcdf.read_layer(path, layer, east, south), where, crs, source, layer.band)
    note = "" if is_even else f"{path}: its positions are uneven: interpolated to even ones"
    return memory.name, "GTiff", memory, 1, join_notes(layer.note, note)


def _in_memory(values: Any, where: Any, crs: Any, source: Any, band: int) -> Any:
    """Return a file in memory with values laid out again, and the metadata of `source`."""
    import rasterio

    memory = rasterio.io.MemoryFile(ext=".tif")
    with memory.open(
        driver="GTiff", width=values.shape[1], height=values.shape[0], count=1, dtype="float32", nodata=np.nan,
        transform=where, crs=crs,
    ) as target:  # fmt: skip
        target.write(values, 1)
        target.update_tags(**source.tags())
        target.update_tags(1, **source.tags(band or 1))
    return memory


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


def _describe_raster(path: str, file: str, source: Any, band: int, declared: Declared) -> Raster:
    """Return the raster of an open dataset: its position, spacing, and the scale of its depths. Raises ConfigError."""
    from rasterio.coords import BoundingBox
    from rasterio.crs import CRS
    from rasterio.warp import transform, transform_bounds

    if source.transform.is_identity:
        raise ConfigError(f"{path}: has no position on the earth: warp it to longitude and latitude")
    a, b, c, d, e, f = source.transform[:6]  # from columns and rows to positions
    width, height, crs = source.width, source.height, declared.crs
    across = sorted((c, c + a * width, c + b * height, c + a * width + b * height))
    along = sorted((f, f + d * width, f + e * height, f + d * width + e * height))
    bounds = BoundingBox(across[0], along[0], across[-1], along[-1])
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
    box = GeoBox(south, west, north, east + 360.0 if east < west else east)
    middle = height // 2, width // 2
    if where.is_geographic and max(-west, east) >= 180.0:  # else GDAL omits the part beyond the 180th meridian
        where = CRS.from_dict({**where.to_dict(), "lon_wrap": 0.5 * (west + east)})
    pixels = [(middle[1] + column, middle[0] + row) for row, column in ((0, 0), (1, 0), (0, 1))]
    corners = [(a * column + b * row + c, d * column + e * row + f) for column, row in pixels]
    longitude, latitude = (np.array(axis) for axis in transform(where, WGS84, *zip(*corners, strict=True)))
    local = np.column_stack(LocalPlane(float(latitude[0]), float(longitude[0])).to_local(latitude, longitude))
    spacing = float(np.hypot(*(local[1:] - local[0]).T).max())
    unit, unit_note = _unit(path, source, band, declared, where)
    is_upwards, note = _detect_direction(path, source, declared, band, unit)
    sign = -unit if is_upwards else unit
    scale, offset = sign * source.scales[band - 1], sign * source.offsets[band - 1]
    own_note = f"{path}: --crs is not used, because the file has its own coordinate system"
    note = join_notes(unit_note, note, own_note if own and crs and own != parse_crs(crs) else "")
    return Raster(os.path.basename(path), file, source.driver, where, box, spacing, scale, offset, band, note)


def _band(path: str, source: Any, declared: Declared) -> int:
    """Return the number of the band that the user chose, else of the first that is named as depths, else 1."""
    name, number = declared.split_layer()
    names = [text or "" for text in source.descriptions]
    if (name and name not in names) or number > source.count:
        raise ConfigError(
            f"--layer {declared.layer}: {path} has {source.count} bands: {', '.join(filter(None, names))}"
        )
    if name or number:
        return number or names.index(name) + 1
    return next((band for band, text in enumerate(names, 1) if is_depth_name(text)), 1)


def _unit(path: str, source: Any, band: int, declared: Declared, where: Any) -> tuple[float, str]:
    """Return the length in m of the unit of a band's values, and a note. Raises ConfigError for what are no depths."""
    name, colour = source.descriptions[band - 1] or "", source.colorinterp[band - 1].name
    tags, whole = source.tags(band), source.dtypes[band - 1] in ("uint8", "int8")
    stated = source.units[band - 1] or tags.get("units") or unit_in_name(name)
    if colour in ("red", "palette") or (whole and source.count > 2):
        raise ConfigError(f"{path}: is a picture, whose colours are no depths: use the raster that it was drawn from")
    is_named = is_depth_name(name) or is_depth_name(tags.get("NETCDF_VARNAME", ""))
    is_scaled = (source.scales[band - 1], source.offsets[band - 1]) != (1.0, 0.0)
    if whole and not (stated or declared.unit or is_named or is_scaled):
        raise ConfigError(
            f"{path}: its values of 8 bits may be shades of a picture: if they are whole metres, use --unit m; if they "
            "are depths on a scale, state it in the file, for example with gdal_edit.py -scale 0.1 -offset 0"
        )
    return depth_unit(path, stated, declared.unit, where)


def _detect_direction(path: str, source: Any, declared: Declared, band: int, unit: float) -> tuple[bool, str]:
    """Return whether the values of a band count upwards, and a note on what was assumed, "" for nothing."""
    positive = declared.positive
    tags = {key.rpartition("#")[2].lower(): str(value) for key, value in source.tags(band).items()}
    counted = tags.get("positive", "").strip().lower()
    if positive == "auto" and counted in ("up", "down"):
        return counted == "up", ""
    if positive == "auto" and source.driver in ("BAG", "S102"):  # BAG has elevations; GDAL returns depths of S-102
        return bool(source.driver == "BAG"), ""
    own = [tags.get(key) for key in ("standard_name", "long_name", "netcdf_varname")]
    about = [text for key, text in source.tags().items() if key.rpartition("#")[2].lower() in ABOUT]
    fathoms = "depth" if (declared.unit or source.units[band - 1] or "").lower() in ("fm", "fathom", "fathoms") else ""
    named = first_hint([*own, source.descriptions[band - 1]], [os.path.basename(path)], about, [fathoms])
    shape = min(SAMPLED, source.height), min(SAMPLED, source.width)
    values = source.read(band, out_shape=shape, masked=True)
    known = unit * (values.compressed() * source.scales[band - 1] + source.offsets[band - 1])
    known = known[~np.isnan(known)]
    if not len(known):
        raise ConfigError(f"{path}: no pixel has a depth: use another file")
    require_possible(path, known)
    low, high, axis = float(known.min()), float(known.max()), vertical_axis(source.crs)[1]
    return detect_direction(path, positive, named, low, high, axis)

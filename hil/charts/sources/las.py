"""Read the bed out of point clouds of lidar and multibeam sonars in LAS and LAZ files (ASPRS LAS 1.0 to 1.4)."""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.charts.sources.sign import join_notes
from hil.charts.sources.survey import shoalest_in_cell
from hil.charts.sources.systems import parse_crs
from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import check_file

Array = NDArray[np.float64]

ENDINGS = (".las", ".laz")
BED = (2, 8, 40)  # classes: ground, its key points, bathymetric point; not water, plants, noise or buildings
UNCLASSIFIED = (0, 1)
CHUNK = 1_000_000  # points that are read at a time
MAX_POINTS = 200_000  # above which the highest in each cell is used
DOWN = (1.0, 1.0, -1.0)  # from heights to depths
UNITS = {9001: "m", 9002: "ft", 9003: "us-ft"}  # of GeoTIFF's key of vertical units


def read_las(path: str) -> tuple[Array, Any, str, str]:
    """Return the points of the bed, (n, 3) x, y and height; their coordinate system, their unit of height, and a note.

    The system is None and the unit "" if the file states none. Of a file without classes all points are used. Raises
    ConfigError, MissingExtraError.
    """
    try:
        import laspy
    except ImportError:
        raise MissingExtraError(f"{path}: LAS needs laspy: pip install 'uuv-hil[raster]'") from None
    check_file(path, sys.maxsize)  # no limit: it is read in parts
    bed, others, classes, count = np.empty((0, 3)), np.empty((0, 3)), set[int](), 0
    size = 0.0
    try:
        with laspy.open(path) as file:
            crs, unit = _system(file.header)
            for chunk in file.chunk_iterator(CHUNK):
                kind, count = np.asarray(chunk.classification), count + len(chunk)
                classes |= set(np.unique(kind).tolist())
                rows = np.column_stack([np.asarray(part) for part in (chunk.x, chunk.y, chunk.z)])
                is_used = ~np.asarray(chunk.withheld, bool)
                bed, size = _thin(np.concatenate([bed, rows[is_used & np.isin(kind, BED)]]), size)
                if not len(bed):
                    others, size = _thin(np.concatenate([others, rows[is_used & np.isin(kind, UNCLASSIFIED)]]), size)
    except (laspy.errors.LaspyException, OSError, ValueError, RuntimeError) as error:
        raise ConfigError(f"{path}: cannot be read as LAS: {error}") from None
    used = bed if len(bed) else others
    if not len(used):
        raise ConfigError(
            f"{path}: has no point of ground (2) or bathymetry (40), but of the classes {sorted(classes)}"
        )
    note = "" if len(bed) else f"{path}: has no classes: all its points are used, water and plants too"
    if size:
        note = join_notes(note, f"{path}: of {count} points {len(used)} are used, the highest in each {size:.2g}")
    return used, crs, unit, note


def _thin(rows: Array, size: float) -> tuple[Array, float]:
    """Return the highest of the rows (n, 3) in each square cell, so that there are at most MAX_POINTS, and its size.

    Cells are of `size` or more; 0 as long as all rows are used.
    """
    if len(rows) > MAX_POINTS:
        size = size or max(float(np.ptp(rows[:, :2], axis=0).max()), 1.0) / MAX_POINTS**0.5
    while len(rows) > MAX_POINTS:
        rows = shoalest_in_cell(rows * DOWN, size) * DOWN
        size *= 1.25 if len(rows) > MAX_POINTS else 1.0
    return rows, size


def _system(header: Any) -> tuple[Any, str]:
    """Return the coordinate system of a file, None if it states none, and the unit of its heights, "" likewise."""
    records = [*header.vlrs, *(header.evlrs or ())]
    for text in (record.string for record in records if hasattr(record, "string") and record.record_id == 2112):
        if text.strip("\0 "):
            return parse_crs(text.strip("\0 ")), ""
    for record in records:
        keys = {key.id: key.value_offset for key in getattr(record, "geo_keys", ()) if key.tiff_tag_location == 0}
        codes = [keys.get(3072) or keys.get(2048), keys.get(4096)]  # projected or geographic, vertical
        if codes[0] and codes[0] < 32767:
            names = "+".join(str(code) for code in codes if code and code < 32767)
            return parse_crs(f"EPSG:{names}"), UNITS.get(keys.get(4099, 0), "")
    return None, ""

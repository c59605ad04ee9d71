"""Write a grid as a GeoTIFF: heights in float32, in transverse Mercator projection about the world's origin."""

import os
from collections.abc import Callable
from errno import ENOSPC
from math import nan

from hil.charts.grid import STRIP_ROWS, Depths, Grid, written_whole
from hil.common.errors import MissingExtraError

CACHE_BYTES = 16 << 20  # of GDAL, which otherwise uses a twentieth of the machine's memory


def write_geotiff(
    grid: Grid, origin: tuple[float, float] | None, path: str, read: Callable[[slice], Depths] | None = None
) -> None:
    """Write heights above the water (m, land positive) to `path`; nan if unknown.

    Rows go from north to south; a value is that of a node (PixelIsPoint). `origin`: latitude and longitude (degrees) of
    (0, 0); None leaves out the coordinate system. The tangent plane and transverse Mercator differ by 2 mm at 5 km from
    the origin and by 0.1 m at 17 km. `read` returns the depths of the given rows, and is used instead of those of
    `grid`. Raises ConfigError if `path` cannot be written, MissingExtraError without rasterio.
    """
    try:
        import rasterio
        from rasterio.windows import Window
    except ImportError:
        raise MissingExtraError(f"{path}: rasters need rasterio: pip install 'uuv-hil[raster]'") from None
    rows, columns = grid.depths.shape
    _, north, west, _ = grid.extent
    spacing = grid.resolution
    # The transform refers to the north-west corner of the first pixel, whose centre is the first node.
    transform = rasterio.Affine(spacing, 0.0, west - 0.5 * spacing, 0.0, -spacing, north + 0.5 * spacing)
    with written_whole(path) as (name,), rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES):
        with rasterio.open(
            name, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32", nodata=nan,
            crs=_projection(origin), transform=transform,
        ) as file:  # fmt: skip
            file.update_tags(AREA_OR_POINT="Point")
            for end in range(rows, 0, -STRIP_ROWS):
                part = slice(max(0, end - STRIP_ROWS), end)
                depths = read(part) if read else grid.depths[part]
                file.write(-depths[::-1], 1, window=Window(0, rows - end, columns, len(depths)))
        if os.path.getsize(name) < grid.depths.nbytes:  # GDAL prints that the disk is full, but raises nothing
            raise OSError(ENOSPC, os.strerror(ENOSPC))


def _projection(origin: tuple[float, float] | None) -> str | None:
    if origin is None:
        return None
    latitude, longitude = origin
    return f"+proj=tmerc +lat_0={latitude!r} +lon_0={longitude!r} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"

"""Write a grid as a GeoTIFF: heights in float32 on a transverse Mercator plane with the world's origin."""

import os
from collections.abc import Callable
from errno import ENOSPC
from math import nan

from hil.charts.grid import STRIP_ROWS, Depths, Grid, replaced
from hil.common.errors import MissingExtraError

CACHE_BYTES = 16 << 20  # of GDAL, which takes a twentieth of the machine's memory else


def write_geotiff(
    grid: Grid, origin: tuple[float, float] | None, path: str, read: Callable[[slice], Depths] | None = None
) -> None:
    """Write heights above the water in m (land positive) to `path`; nan where nothing is known.

    Rows go from north to south, values are those of the nodes (PixelIsPoint). `origin`: latitude and longitude in
    degrees of (0, 0); None leaves the coordinate system out. The tangent plane and transverse Mercator differ by
    2 mm at 5 km from the origin and 0.1 m at 17 km. `read` gives the depths of some rows at a time, instead of `grid`.
    Raises ConfigError where `path` cannot be written, MissingExtraError without rasterio.
    """
    try:
        import rasterio
        from rasterio.windows import Window
    except ImportError:
        raise MissingExtraError(f"{path}: rasters need rasterio: pip install 'uuv-hil[raster]'") from None
    rows, columns = grid.depths.shape
    _, north, west, _ = grid.extent
    spacing = grid.resolution
    # GDAL places the north-western corner of the first pixel, whose centre is the first node.
    transform = rasterio.Affine(spacing, 0.0, west - 0.5 * spacing, 0.0, -spacing, north + 0.5 * spacing)
    with replaced(path) as (name,), rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES):
        with rasterio.open(
            name, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32", nodata=nan,
            crs=_projection(origin), transform=transform,
        ) as file:  # fmt: skip
            file.update_tags(AREA_OR_POINT="Point")
            for end in range(rows, 0, -STRIP_ROWS):
                part = slice(max(0, end - STRIP_ROWS), end)
                depths = read(part) if read else grid.depths[part]
                file.write(-depths[::-1], 1, window=Window(0, rows - end, columns, len(depths)))
        if os.path.getsize(name) < grid.depths.nbytes:  # GDAL only prints that the disk is full
            raise OSError(ENOSPC, os.strerror(ENOSPC))


def _projection(origin: tuple[float, float] | None) -> str | None:
    if origin is None:
        return None
    latitude, longitude = origin
    return f"+proj=tmerc +lat_0={latitude!r} +lon_0={longitude!r} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"

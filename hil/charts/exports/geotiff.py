"""Write a grid as a GeoTIFF: heights in float32 on a transverse Mercator plane with the world's origin."""

from math import nan

import numpy as np

from hil.charts.grid import Grid, write_file
from hil.common.errors import MissingExtraError


def write_geotiff(grid: Grid, origin: tuple[float, float] | None, path: str) -> None:
    """Write heights above the water in m (land positive) to `path`; nan where nothing is known.

    Rows go from north to south, values are those of the nodes (PixelIsPoint). `origin`: latitude and longitude in
    degrees of (0, 0); None leaves the coordinate system out. The tangent plane and transverse Mercator differ by
    2 mm at 5 km from the origin and 0.1 m at 17 km.
    Raises ConfigError where `path` cannot be written, MissingExtraError without rasterio.
    """
    try:
        from rasterio import Affine
        from rasterio.io import MemoryFile
    except ImportError:
        raise MissingExtraError(f"{path}: rasters need rasterio: pip install 'uuv-hil[raster]'") from None
    rows, columns = grid.depths.shape
    _, north, west, _ = grid.extent
    spacing = grid.resolution
    # GDAL places the north-western corner of the first pixel, whose centre is the first node.
    transform = Affine(spacing, 0.0, west - 0.5 * spacing, 0.0, -spacing, north + 0.5 * spacing)
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff", width=columns, height=rows, count=1, dtype="float32", nodata=nan,
            crs=_projection(origin), transform=transform,
        ) as file:  # fmt: skip
            file.update_tags(AREA_OR_POINT="Point")
            file.write((-grid.depths[::-1]).astype(np.float32), 1)
        write_file(path, memory.read())


def _projection(origin: tuple[float, float] | None) -> str | None:
    if origin is None:
        return None
    latitude, longitude = origin
    return f"+proj=tmerc +lat_0={latitude!r} +lon_0={longitude!r} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"

"""The local plane of a chart against the ellipsoid and PROJ."""

import numpy as np
import pytest

from hil.charts.projection import LocalPlane


def test_the_projection_agrees_with_proj() -> None:
    warp = pytest.importorskip("rasterio.warp", reason="PROJ comes with rasterio: pip install 'uuv-hil[raster]'")
    random = np.random.default_rng(3)
    for latitude, longitude in ((59.6, -151.4), (-45.0, 179.99), (0.0, 0.0), (89.0, 10.0)):
        plane = LocalPlane(latitude, longitude)
        north, east = random.uniform(-3e4, 3e4, (2, 5, 7))
        local = f"+proj=ortho +lat_0={latitude} +lon_0={longitude} +ellps=WGS84"
        east_longitude, north_latitude = warp.transform(local, "EPSG:4326", east.ravel(), north.ravel())
        back = plane.to_local(np.reshape(north_latitude, north.shape), np.reshape(east_longitude, north.shape))
        assert np.allclose(back, (north, east), rtol=0.0, atol=1e-6)

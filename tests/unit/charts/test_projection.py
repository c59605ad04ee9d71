"""The local plane of a chart against the ellipsoid and PROJ."""

from math import cos, radians, sin, sqrt

import numpy as np
import pytest

from hil.charts.projection import LocalPlane

A, E2 = 6_378_137.0, 0.00669437999014  # WGS 84


def radii(latitude: float) -> tuple[float, float]:
    """Return the radii of curvature along the meridian and across it."""
    w = sqrt(1.0 - E2 * sin(radians(latitude)) ** 2)
    return A * (1.0 - E2) / w**3, A / w


@pytest.mark.parametrize("latitude", [-77.0, -33.9, 0.0, 47.3, 59.6])
def test_short_distances_follow_the_radii_of_curvature(latitude: float) -> None:
    plane = LocalPlane(latitude, -151.4)
    step = 1e-3  # degrees: about 100 m
    north, east = plane.to_local(np.array([latitude + step, latitude]), np.array([-151.4, -151.4 + step]))
    meridian, across = radii(latitude)
    assert north[0] == pytest.approx(meridian * radians(step), abs=1e-3)
    assert east[1] == pytest.approx(across * cos(radians(latitude)) * radians(step), abs=1e-3)
    assert (abs(east[0]), abs(north[1])) == pytest.approx((0.0, 0.0), abs=2e-3)


def test_long_arcs_are_projected_to_their_sines() -> None:
    plane = LocalPlane(0.0, 0.0)
    angle = radians(0.25)  # along the equator, a circle
    _, east = plane.to_local(np.array([0.0]), np.array([0.25]))
    assert east[0] == pytest.approx(A * sin(angle), abs=1e-6)
    assert A * angle - east[0] == pytest.approx(0.0883, abs=1e-3)  # at 28 km


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

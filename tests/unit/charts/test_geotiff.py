"""The grid of a world, and its export as a GeoTIFF."""

from pathlib import Path

import numpy as np
import pytest
import rasterio

from hil.charts.geotiff import write_geotiff
from hil.charts.grid import Grid, grid_of
from sim.environment.world import load_world

NORTH, EAST = np.arange(12)[:, None], np.arange(17)


def sloping(hole: bool = True) -> Grid:
    """Return a bed that deepens to the north and shoals to the east, with land in the south-east."""
    depths = (10.0 + 1.5 * NORTH - 1.0 * EAST).astype(np.float32)
    if hole:
        depths[9, 3] = np.nan
    return Grid(depths, -20.0, 40.0, 5.0)


def test_the_grid_of_a_world_is_extracted() -> None:
    ridge = load_world("ridge")
    grid = grid_of(ridge)
    assert grid.extent == (-150.0, 150.0, -150.0, 150.0)
    assert grid.at(np.array([[0.0, 33.0], [100.0, -7.7]])) == pytest.approx([10.0, 25.0], abs=0.01)
    coarse = grid_of(ridge, 7.0)
    assert coarse.resolution == 7.0
    assert coarse.at(np.array([[-150.0 + 21 * 7.0, 4.0]])) == pytest.approx(ridge.seabed(-3.0, 4.0), abs=1e-4)
    flat = grid_of(load_world("pool"))
    assert (flat.depths == 5.0).all()
    assert flat.extent == (-10.0, 10.0, -10.0, 10.0)


def test_grid_values_are_interpolated_and_undefined_outside() -> None:
    grid = sloping()
    assert grid.at(np.array([[-20.0, 40.0], [-17.5, 42.5], [35.0, 120.0]])) == pytest.approx([10.0, 10.25, 10.5])
    assert np.isnan(grid.at(np.array([[-20.1, 40.0], [35.0, 120.1], [24.0, 56.0]]))).all()


def test_a_geotiff_has_its_depths_and_position(tmp_path: Path) -> None:
    path = tmp_path / "bed.tif"
    grid = sloping()
    write_geotiff(grid, (59.5, -151.25), str(path))
    with rasterio.open(path) as source:
        assert (source.width, source.height, source.dtypes) == (17, 12, ("float32",))
        assert np.array_equal(source.read(1)[::-1], -grid.depths, equal_nan=True)
        assert np.isnan(source.nodata)
        assert source.tags()["AREA_OR_POINT"] == "Point"
        assert source.res == (5.0, 5.0)
        assert source.xy(0, 0) == (40.0, 35.0), "the first pixel's centre is the first node, east and north"
        projection = source.crs.to_dict()
        assert projection["proj"] == "tmerc"
        assert (projection["lat_0"], projection["lon_0"]) == (59.5, -151.25)


def test_a_geotiff_without_an_origin_is_local(tmp_path: Path) -> None:
    path = tmp_path / "bed.tif"
    write_geotiff(sloping(), None, str(path))
    with rasterio.open(path) as source:
        assert not (source.crs and (source.crs.is_projected or source.crs.is_geographic))
        assert source.xy(0, 0) == (40.0, 35.0)

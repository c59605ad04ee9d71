"""Values of rasters: the band that has the depths, their unit, and undeclared no-data values."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.charts.chart_survey import GeoBox
from hil.charts.projection import LocalPlane
from hil.charts.sources.combine import ReadOptions, read_sources
from hil.charts.sources.points import read_points
from hil.charts.sources.rasters import Raster, open_raster
from hil.charts.sources.sign import Declared
from hil.common.errors import ConfigError

ROWS, COLUMNS = np.mgrid[0:30, 0:40]
DEPTHS = (20.0 + 0.3 * ROWS + 0.2 * COLUMNS).astype(np.float32)


def write(path: Path, *bands: np.ndarray, names: tuple[str, ...] = (), unit: str = "", **keys: Any) -> str:
    rasterio = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    where = {"crs": "EPSG:32632", "transform": rasterio.Affine(10, 0, 5e5, 0, -10, 6e6), **keys}
    shape = {"height": len(bands[0]), "width": 40, "count": len(bands), "dtype": "float32"}
    with rasterio.open(path, "w", driver="GTiff", **shape, **where) as file:
        file.write(np.stack(bands).astype(np.float32))
        for number, name in enumerate(names, 1):
            file.set_band_description(number, name)
        if unit:
            file.set_band_unit(1, unit)
    return str(path)


def depth_of(raster: Raster) -> float:
    """Return the depth in its middle, 26.2 m if it is read as it was meant."""
    south, west, north, east = raster.box
    axis = np.array([-5.0, 0.0, 5.0])
    return float(raster.depths(LocalPlane(0.5 * (south + north), 0.5 * (west + east)), axis, axis)[1, 1])


MIDDLE = pytest.approx(20.0 + 0.3 * 14.5 + 0.2 * 19.5, abs=0.05)


@pytest.mark.parametrize("names", [("Uncertainty", "Elevation"), ("depth uncertainty", "bedElevation")])
def test_the_band_named_as_a_height_is_taken(names: tuple[str, str], tmp_path: Path) -> None:
    path = write(tmp_path / "two.tif", np.full((30, 40), 0.5), -DEPTHS, names=names)
    assert depth_of(open_raster(path)) == MIDDLE


def test_the_first_of_three_unnamed_bands_is_taken(tmp_path: Path) -> None:
    path = write(tmp_path / "three.tif", -DEPTHS, np.full((30, 40), 0.5), np.ones((30, 40)))
    assert depth_of(open_raster(path)) == MIDDLE
    assert "the first of its 3 bands is used" in open_raster(path).note
    assert open_raster(path, Declared("up", layer="2")).band == 2


@pytest.mark.parametrize(("name", "unit", "length"), [
    ("depth", "ft", 0.3048), ("Depth (feet)", "", 0.3048), ("depth_fathoms", "", 1.8288), ("depth", "m below MSL", 1.0),
])  # fmt: skip
def test_depths_in_other_units_become_metres(name: str, unit: str, length: float, tmp_path: Path) -> None:
    path = write(tmp_path / "units.tif", DEPTHS / length, names=(name,), unit=unit)
    assert depth_of(open_raster(path)) == MIDDLE


@pytest.mark.parametrize("mark", [-99999.0, 1e20, np.inf])
def test_an_undeclared_no_data_value_out_of_range_is_refused(mark: float, tmp_path: Path) -> None:
    marked = np.where(COLUMNS < 10, mark, -DEPTHS)
    with pytest.raises(ConfigError, match=r"marks\.tif: has values of .* m, which cannot be depths: if they mean"):
        open_raster(write(tmp_path / "marks.tif", marked, names=("elevation",)))
    named = write(tmp_path / "named.tif", marked, names=("elevation",), nodata=mark)
    assert depth_of(open_raster(named)) == MIDDLE
    path = tmp_path / "marks.csv"
    path.write_text("lon,lat,depth\n10,54,10\n10.001,54,-99999\n10,54.001,30\n")
    with pytest.raises(ConfigError, match="which cannot be depths"):
        read_points(str(path), Declared("down"))


def test_a_local_coordinate_system_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "pool.tif", -DEPTHS, crs='LOCAL_CS["pool",UNIT["metre",1]]')
    with pytest.raises(ConfigError, match=r"pool\.tif: .*no coordinate system: name it, for example --crs EPSG:32605"):
        open_raster(path)
    assert depth_of(open_raster(path, Declared(crs="EPSG:32632"))) == MIDDLE


def test_metres_declared_as_degrees_are_refused_with_the_remedy(tmp_path: Path) -> None:
    path = write(tmp_path / "wrong.tif", -DEPTHS, crs="EPSG:4326")
    with pytest.raises(ConfigError, match=r"positions up to 6e\+06: correct the file, .* gdal_edit\.py -a_srs"):
        open_raster(path)


def test_undeclared_nan_leaves_the_depths_around_it(tmp_path: Path) -> None:
    holes = -DEPTHS
    holes[14, 18] = np.nan  # beside the middle, where four pixels meet
    assert depth_of(open_raster(write(tmp_path / "holes.tif", holes))) == pytest.approx(28.25, abs=0.5)


def test_an_undeclared_no_data_value_of_9999_is_refused(tmp_path: Path) -> None:
    """The value -9999 is a possible depth on the earth, but two exactly equal ones are not a measured bed."""
    holes = -DEPTHS
    holes[:10, :10] = -9999.0
    with pytest.raises(ConfigError, match=r"9999 m, which cannot be depths.*gdal_translate -a_nodata"):
        open_raster(write(tmp_path / "holes.tif", holes))
    holes[:10, :10] = -9998.7  # of a trench
    open_raster(write(tmp_path / "trench.tif", holes))


def test_an_assumption_about_the_sign_of_values_is_reported(tmp_path: Path) -> None:
    named_bands = open_raster(write(tmp_path / "named.tif", DEPTHS, names=("depth",)))
    unnamed_bands = open_raster(write(tmp_path / "bathymetry.tif", DEPTHS))
    negative_depths = open_raster(write(tmp_path / "odd.tif", -DEPTHS, names=("depth",)))
    assert named_bands.note == ""
    assert "bathymetry.tif: read as depths, because none is below zero" in unnamed_bands.note
    assert "odd.tif: named as depths, read as heights" in negative_depths.note
    assert [depth_of(raster) for raster in (named_bands, unnamed_bands, negative_depths)] == [MIDDLE] * 3


def test_a_raster_that_is_all_positive_needs_a_hint(tmp_path: Path) -> None:
    """It fits the heights of a land as well as depths; file name, metadata and fathoms can say which it is."""
    rasterio = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    bare = write(tmp_path / "bare.tif", DEPTHS)
    for path in (bare, write(tmp_path / "metres.tif", DEPTHS, unit="m")):
        with pytest.raises(ConfigError, match="nothing states whether they are heights or depths: use --positive up"):
            open_raster(path)
    assert depth_of(open_raster(bare, Declared("down"))) == MIDDLE
    assert open_raster(write(tmp_path / "lake_depth.tif", DEPTHS)).scale == 1.0
    assert open_raster(write(tmp_path / "lake_dem.tif", DEPTHS)).scale == -1.0
    assert open_raster(write(tmp_path / "lake.tif", DEPTHS, unit="fathom")).scale == 1.8288
    with rasterio.open(bare, "r+") as file:
        file.update_tags(TIFFTAG_IMAGEDESCRIPTION="Terrain elevation of the island")
    assert open_raster(bare).scale == -1.0


def test_of_a_raster_too_large_for_a_world_a_part_can_be_used(tmp_path: Path) -> None:
    """The part is around the given position, by default the centre, and a note names it."""
    rasterio = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    where = rasterio.Affine(9.0, 0.0, -180.0, 0.0, -6.0, 90.0)
    path = write(tmp_path / "earth.tif", -DEPTHS, crs="EPSG:4326", transform=where)
    survey, extent = read_sources([path], None, 1000.0, ReadOptions(crop=True, near=(60.0, 20.0)))
    assert survey.origin == pytest.approx((60.0, 20.0))
    assert survey.is_cropped
    assert "59.167 to 60.833 N" in survey.notes[-1]
    assert max(map(abs, extent)) < 1e5
    assert read_sources([path], None, 1000.0, ReadOptions(crop=True))[0].origin == pytest.approx((0.0, 0.0))
    assert not read_sources([path], GeoBox(10.0, 20.0, 10.1, 20.1), 1000.0, ReadOptions(crop=True))[0].is_cropped
    with pytest.raises(ConfigError, match=r"--start 95,20: is not on the chart, which covers -90 to 90 N"):
        read_sources([path], None, 1000.0, ReadOptions(crop=True, near=(95.0, 20.0)))


@pytest.mark.parametrize("driver", ["netCDF", "GSAG", "GSBG", "GS7BG"])
def test_a_grd_is_read_as_a_grid_of_gmt_or_of_surfer(driver: str, tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    from rasterio.shutil import copy

    where = {"crs": "EPSG:4326", "transform": rasterio.Affine(1e-4, 0, 10.0, 0, -1e-4, 54.0)}
    number = np.arange(40)  # a square, as GDAL 3.12 writes no other grid of GS7BG
    depths = 20.0 + 0.3 * number[:, None] + 0.2 * number
    copy(write(tmp_path / "bed.tif", -depths, **where), str(tmp_path / "bed.grd"), driver=driver)
    assert depth_of(open_raster(str(tmp_path / "bed.grd"), Declared("up"))) == pytest.approx(
        20.0 + 0.5 * 19.5, abs=0.05
    )


def test_heights_named_as_depths_are_not_made_land(tmp_path: Path) -> None:
    """Mostly below zero and named as depths, they may be heights. Folders and variables of a file name nothing."""
    folder = tmp_path / "depth maps"
    folder.mkdir()
    heights = 500.0 - 20.0 * DEPTHS  # from -230 to 100 m
    for name in ("depth_chart.tif", "chart.tif"):
        with pytest.raises(ConfigError, match=r"--positive down.*--positive up|--positive up or --positive down"):
            open_raster(write(folder / name, heights))
    assert depth_of(open_raster(write(folder / "depth.tif", heights), Declared("up"))) == pytest.approx(
        20.0 * 28.25 - 500.0, abs=1.0
    )
    drying = open_raster(write(folder / "depth.tif", DEPTHS - 25.0))
    assert depth_of(drying) == pytest.approx(28.25 - 25.0, abs=0.2), "a shore that dries has depths below zero"


def test_places_with_several_depths_are_reported(tmp_path: Path) -> None:
    """A file of temperatures in the water has several depths at each place; such depths make no bed."""
    path = tmp_path / "casts.csv"
    levels = [(10.0 + 1e-3 * i, 54.0 + 1e-3 * j, z) for i in range(5) for j in range(5) for z in (0.0, 10.0, 40.0)]
    path.write_text("longitude,latitude,depth\n" + "".join(f"{x},{y},{z}\n" for x, y, z in levels))
    assert "100% of its places have several depths, up to 40 m apart" in read_points(str(path)).note
    path.write_text("longitude,latitude,depth\n" + "".join(f"{x},{y},{z}\n" for x, y, z in levels[::3]))
    assert not read_points(str(path)).note

"""Beds from rasters as GDAL resamples them: their position, their sign, and which are refused."""

import socket
from pathlib import Path

import numpy as np
import pytest

from hil.charts.build import build
from hil.charts.chart_survey import GeoBox
from hil.charts.geotiff import write_geotiff
from hil.charts.grid import Grid
from hil.charts.projection import LocalPlane
from hil.charts.sources.combine import ReadOptions, read_sources
from hil.charts.sources.points import read_points
from hil.charts.sources.rasters import open_raster
from hil.charts.sources.sign import Declared, Positive
from hil.commands import world as command
from hil.common.errors import ConfigError


def geographic(north: np.ndarray, east: np.ndarray) -> list[np.ndarray]:
    """Return latitudes and longitudes of points on the plane at 54 N 10 E, by PROJ."""
    warp = pytest.importorskip("rasterio.warp")
    longitude, latitude = warp.transform("+proj=ortho +lat_0=54 +lon_0=10 +ellps=WGS84", "EPSG:4326", east, north)
    return [np.array(latitude), np.array(longitude)]


def raster(path: Path, origin: tuple[float, float] | None = (54.0, 10.0)) -> Grid:
    north, east = np.arange(30)[:, None], np.arange(40)
    depths = (10.0 + 0.1 * north - 0.2 * east).astype(np.float32)
    depths[20:, 30:] = np.nan
    grid = Grid(depths, -100.0, -200.0, 10.0)
    write_geotiff(grid, origin, str(path))
    return grid


def test_a_written_geotiff_is_read_back(tmp_path: Path) -> None:
    pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    path = tmp_path / "bed.tif"
    grid = raster(path)
    written = open_raster(str(path))
    assert written.spacing == pytest.approx(10.0, rel=0.01)
    same = written.depths(LocalPlane(54.0, 10.0), grid.north, grid.east)
    np.testing.assert_allclose(same[1:-1, 1:-1], grid.depths[1:-1, 1:-1], atol=2e-3)
    coarse = written.depths(LocalPlane(54.0, 10.0), grid.north[10:20:3], grid.east[10:20:3])
    shoalest = grid.depths[9:20, 11:22].reshape(11, 11)[:10:3, :10:3]  # of the pixels around each node
    np.testing.assert_allclose(coarse, shoalest, atol=0.02)
    survey, extent = read_sources([str(path)], None, 10.0)
    built = build(survey, extent, 10.0)
    centre = LocalPlane(*survey.origin or (0.0, 0.0))
    north, east = np.array([0.0, 50.0, 120.0]), np.array([-100.0, 120.0, -150.0])
    places = np.column_stack(centre.to_local(*geographic(north, east)))
    assert built.model.grid.at(places) == pytest.approx(10.0 + 0.01 * (north + 100.0) - 0.02 * (east + 200.0), abs=0.05)
    hole = np.column_stack(centre.to_local(*geographic(np.array([160.0]), np.array([160.0]))))
    assert np.isnan(built.model.grid.at(hole)).all()
    with pytest.raises(ConfigError, match=r"--area: .* is outside the data, which cover 53\.9"):
        read_sources([str(path)], GeoBox(60.0, 10.0, 60.1, 10.1), 10.0)


def test_soundings_in_metres_need_a_named_coordinate_system(tmp_path: Path) -> None:
    pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    path = tmp_path / "utm.csv"
    path.write_text("easting,northing,depth\n565000,5984000,5\n565100,5984000,6\n565000,5984100,7\n")
    with pytest.raises(ConfigError, match="an unknown coordinate system: name it, for example --crs EPSG:32605"):
        read_points(str(path))
    points = read_points(str(path), Declared(crs="EPSG:32632"))
    assert points.geographic
    assert points.positions[0] == pytest.approx([54.0, 10.0], abs=0.01)
    bare = tmp_path / "bare_depth.csv"
    bare.write_text("565000,5984000,5\n565100,5984000,6\n")
    assert "names no columns: read as east, north and depth" in read_points(str(bare), Declared(crs="EPSG:32632")).note
    north, east = LocalPlane(*points.positions[0]).to_local(*points.positions[1:].T)
    assert np.hypot(north, east) == pytest.approx([100.0, 100.0], abs=0.1)
    with pytest.raises(ConfigError, match="--crs: EPSG:1: unknown coordinate system"):
        read_points(str(path), Declared(crs="EPSG:1"))


def test_the_raster_that_is_named_first_is_used(tmp_path: Path) -> None:
    old, new, text = (str(tmp_path / name) for name in ("old.tif", "new.tif", "s.csv"))
    for file, more, known in ((old, 0.0, 40), (new, 1.5, 30)):
        depths = np.full((30, 40), 22.0 + more, np.float32)
        depths[:, known:] = np.nan
        write_geotiff(Grid(depths, 0.0, 0.0, 10.0), (54.0, 10.0), file)
    for files, first in (([old, new], 0.0), ([new, old], 1.5)):
        survey, extent = read_sources(files, None)
        built = build(survey, extent)
        plane = LocalPlane(*survey.origin or (0.0, 0.0))
        places = np.column_stack(plane.to_local(*geographic(np.full(2, 150.0), np.array([100.0, 350.0]))))
        assert built.model.grid.at(places) == pytest.approx([22.0 + first, 22.0], abs=0.1)
        bed_shares = dict(built.report.beds)
        assert list(bed_shares) == (["new.tif", "old.tif"] if first else ["old.tif", "new.tif"])
        assert bed_shares["old.tif"] == pytest.approx(0.25 if first else 1.0, abs=0.08)
        assert sum(bed_shares.values()) == pytest.approx(1.0, abs=0.08)
    Path(text).write_text("lon,lat,depth\n10.03,54.0,9\n10.03,54.01,9\n10.04,54.0,9\n10.04,54.01,9.5\n")
    assert command.main(["build", old, new, text, "-o", str(tmp_path / "bay")]) == 0


@pytest.mark.parametrize("kind", ["WMS", "VRT"])
def test_a_raster_that_names_a_host_is_refused_without_a_connection(kind: str, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as host:
        address = f"http://127.0.0.1:{host.getsockname()[1]}/a"
        path = tmp_path / "a.tif"
        path.write_text({
            "WMS": f'<GDAL_WMS><Service name="TMS"><ServerUrl>{address}/${{z}}/${{x}}/${{y}}.tif</ServerUrl></Service>'
            "<DataWindow><SizeX>64</SizeX><SizeY>64</SizeY><TileLevel>1</TileLevel></DataWindow></GDAL_WMS>",
            "VRT": '<VRTDataset rasterXSize="9" rasterYSize="9"><GeoTransform>10,0.1,0,54,0,-0.1</GeoTransform>'
            '<VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
            f"<SourceFilename>/vsicurl/{address}.tif</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>",
        }[kind])  # fmt: skip
        with pytest.raises(ConfigError, match="cannot be read as a raster"):
            open_raster(str(path), Declared("down"))
        host.setblocking(False)
        with pytest.raises(BlockingIOError):
            host.accept()


@pytest.mark.parametrize(("sign", "step"), [(1.0, 12.5), (-1.0, 5.0)])
def test_a_needle_is_kept_on_a_coarser_grid(tmp_path: Path, sign: float, step: float) -> None:
    """Needles of 3 x 3 m on a bed 20 m deep reach up to 5 m, as a raster of 1 m and as its soundings; none deepens."""
    depths = np.full((120, 120), 20.0) + 0.02 * np.arange(120.0)
    for row, column in ((30, 40), (71, 13), (95, 90)):
        depths[row : row + 3, column : column + 3] = 5.0
    rasterio = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    where = rasterio.Affine(1.0, 0.0, 500_000.0, 0.0, -1.0, 6_000_000.0)
    path = str(tmp_path / "needles.tif")
    with rasterio.open(path, "w", "GTiff", 120, 120, 1, "EPSG:32632", where, "float32") as written:
        written.write((sign * depths).astype(np.float32), 1)
    positive: Positive = "down" if sign > 0.0 else "up"
    east, north = np.meshgrid(np.arange(120.0), np.arange(120.0))
    rows = np.column_stack([east.ravel(), north.ravel(), depths.ravel()])
    np.savetxt(tmp_path / "needles.csv", rows, "%.2f", ",", header="east,north,depth", comments="")
    for file, how in ((path, ReadOptions(Declared(positive))), (str(tmp_path / "needles.csv"), ReadOptions())):
        survey, extent = read_sources([file], None, step, how)
        bed = build(survey, extent, step).model.grid.depths
        assert np.nanmin(bed) == pytest.approx(5.0, abs=0.3)
        assert (bed < 12.0).sum() >= 3
        assert np.nanmedian(bed) == pytest.approx(21.2, abs=0.5), "the bed around them"

import bz2
import gzip
import lzma
import os
import socket
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.charts.build import build
from hil.charts.chart_survey import Box
from hil.charts.exports.geotiff import write_geotiff
from hil.charts.grid import Grid
from hil.charts.projection import LocalPlane
from hil.charts.sources import points
from hil.charts.sources.choose import read_sources
from hil.charts.sources.points import read_points
from hil.charts.sources.rasters import open_raster
from hil.commands import world as command
from hil.common.errors import ConfigError
from sim.environment.obstacles import STANDING
from tests.support.charts.s57_encoder import Encoder, square
from tests.support.charts.small_cell import EAST, NORTH, SHORE, SOUTH, WEST, bay, bed


def geographic(north: np.ndarray, east: np.ndarray) -> list[np.ndarray]:
    """Latitudes and longitudes of places on the plane at 54 N 10 E, by PROJ."""
    warp = pytest.importorskip("rasterio.warp")
    longitude, latitude = warp.transform("+proj=ortho +lat_0=54 +lon_0=10 +ellps=WGS84", "EPSG:4326", east, north)
    return [np.array(latitude), np.array(longitude)]


@pytest.mark.parametrize(("name", "text"), [
    ("a.csv", "longitude,latitude,depth\n10.5,54.25,7.5\n10.6,54.5,9\n"),
    ("b.csv", "Latitude (deg);Depth_m;Lon\n54.25;7.5;10.5\n54.5;9;10.6\n"),
    ("c.xyz", "# soundings\n10.5 54.25 -7.5\n\n 10.6\t54.5 -9.0\n"),
    ("d.txt", "10.5\t54.25\t7.5\n10.6\t54.5\t9.0\n"),
    ("e.csv", '"lon","lat","note","elevation"\n10.5,54.25,"a, b",-7.5\n10.6,54.5,,-9\n10.7,54.5,nothing,\n'),
])  # fmt: skip
def test_text_of_many_kinds(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    points = read_points(str(path))
    assert points.geographic
    assert points.places.tolist() == [[54.25, 10.5], [54.5, 10.6]]
    assert points.depths.tolist() == [7.5, 9.0]


def test_packed_text_metres_and_signs(tmp_path: Path) -> None:
    path = tmp_path / "s.xyz.gz"
    path.write_bytes(gzip.compress(b"x,y,z\n100,200,-5\n110,210,2\n120,220,-6\n"))
    with pytest.raises(ConfigError, match=r"from -6 to 2 m, and nothing says .*--positive up or --positive down"):
        read_points(str(path))
    points = read_points(str(path), "up")
    assert not points.geographic
    assert points.places[0].tolist() == [200.0, 100.0]
    assert read_points(str(path), "down").depths.tolist() == [-5.0, 2.0, -6.0]
    assert read_points(str(path), "up").depths.tolist() == [5.0, -2.0, 6.0]


@pytest.mark.parametrize(("text", "said"), [
    ("", "no soundings in it: a line has longitude, latitude and depth"),
    ("lon,lat,depth\n", "no soundings in it"),
    ("lon,lat,colour\n1,2,3\n", "names the columns lon, lat, colour: longitude, latitude"),
    ("1,2,3\n1,2\n", "no sounding in row 2: '1,2'"),
    ("1,2,3\n1,x,2\n", "no sounding in row 2"),
    ("400000,5900000,12\n", "these are no degrees.*east,north,depth"),
])  # fmt: skip
def test_text_that_is_no_soundings(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=f"bad.csv: .*{said}"):
        read_points(str(path))


@pytest.mark.parametrize(("ending", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress), (".xz", lzma.compress)])
def test_a_small_file_that_unpacks_without_end(
    ending: str, pack: Callable[[bytes], bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bounded by lines, by characters, and by the length of one line: whichever comes first."""
    monkeypatch.setattr(points, "MOST_LINES", 10_000)
    monkeypatch.setattr(points, "LARGEST", 1_000_000)
    path = tmp_path / f"s.xyz{ending}"
    for text, words in (
        (b"1 2 3\n" * 20_000, "or 10000 lines: thin it out"),
        ((b"#" + b" " * 999 + b"\n") * 2_000, "more than 0 MiB of text"),
        (b"1" * 10_000_000, "a line of more than 10000 characters"),
    ):
        path.write_bytes(pack(text))
        with pytest.raises(ConfigError, match=rf"s\.xyz\{ending}: .*{words}"):
            read_points(str(path))
    path.write_bytes(pack(b"1 2 3\n" * 20_000)[:40] + b"\xff" * 40)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_points(str(path))
    path.write_bytes(pack(b"1 2 3\n" * 9_999))
    assert len(read_points(str(path)).depths) == 9_999


def test_the_whole_of_what_unpacks_without_end_is_never_in_memory(tmp_path: Path) -> None:
    """4 MB that took all memory: 4 GB without the end of a line. And of 20 MB of comments nothing is kept."""
    path = tmp_path / "s.xyz.gz"
    for text, words in ((b"0" * (1 << 22), "a line of more than 10000"), (b"#" * 9_999 + b"\n", "no soundings in it")):
        path.write_bytes(gzip.compress(text) * 1000 if len(text) > 10_000 else gzip.compress(text * 2_000))
        tracemalloc.start()
        try:
            with pytest.raises(ConfigError, match=words):
                read_points(str(path))
            assert tracemalloc.get_traced_memory()[1] < 2 << 20
        finally:
            tracemalloc.stop()


def test_soundings_are_no_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "s.xyz")
    with pytest.raises(ConfigError, match="no regular file"):
        read_points(str(tmp_path / "s.xyz"))


def test_a_chart_as_a_survey(tmp_path: Path) -> None:
    survey, extent = read_sources([bay().write(tmp_path / "BAY.000")], None, 20.0)
    assert survey.origin == pytest.approx((0.5 * (SOUTH + NORTH), 0.5 * (WEST + EAST)))
    assert extent[1] - extent[0] == pytest.approx(1113.0, abs=2.0)
    assert extent[3] - extent[2] == pytest.approx(1049.0, abs=2.0)
    assert "ENC BAY edition 1 update 0 1:10000" in survey.source
    kinds = {hazard.kind: hazard.bottom for hazard in survey.hazards}
    assert kinds == {"OBSTRN": 1.0, "PILPNT": STANDING, "UWTROC": STANDING}, "one of them floats"
    assert len(survey.contours) == 1
    assert (survey.guides[:, 2] == 0.0).all()
    assert len(survey.guides) > 20
    built = build(survey, extent, 20.0)
    plane = LocalPlane(*survey.origin or (0.0, 0.0))
    latitude, longitude = np.array([54.0015, 54.0045, 54.0072]), np.array([10.004, 10.013, 10.008])
    found = built.placed.grid.at(np.column_stack(plane.to_local(latitude, longitude)))
    truth = [bed(*place) for place in zip(latitude, longitude, strict=True)]
    assert found == pytest.approx(truth, abs=0.3)
    ashore = np.column_stack(plane.to_local(np.array([54.009, 54.0033]), np.array([10.008, 10.0065])))
    assert (built.placed.grid.at(ashore) < -2.0).all()
    assert built.report.rmse < 0.3


def test_the_larger_scale_is_believed_where_charts_overlap(tmp_path: Path) -> None:
    """A coarse chart that is 5 m too deep everywhere, and has a rock of its own inside the finer one."""
    coarse = Encoder(scale=90_000)
    coarse.area(302, square(SOUTH, WEST - 0.016, NORTH, EAST), CATCOV=1)
    coarse.area(42, square(SOUTH, WEST - 0.016, NORTH, EAST), DRVAL1=0, DRVAL2=50)
    lats, lons = np.linspace(SOUTH, NORTH, 9), np.linspace(WEST - 0.016, EAST, 17)
    coarse.soundings([(lat, lon, round(bed(lat, max(lon, WEST)) + 25.0, 1)) for lat in lats for lon in lons])
    coarse.point(153, (54.0015, 10.004), VALSOU=1)
    coarse.line(
        43, [(54.002, WEST - 0.015), (54.002, 9.995), (54.002, 9.999), (54.002, 10.002), (54.002, 10.01)], VALDCO=42
    )
    paths = [bay().write(tmp_path / "FINE.000"), coarse.write(tmp_path / "COARSE.000")]
    both, extent = read_sources(paths, None, 20.0)
    assert both.sheets[-1].name == "FINE"
    assert sorted(h.kind for h in both.hazards) == ["OBSTRN", "PILPNT", "UWTROC"]
    west_of = LocalPlane(*both.origin or (0.0, 0.0)).to_local(np.array([54.002]), np.array([WEST]))[1][0]
    pieces = [line for line, depth in both.contours if depth == 42.0]
    assert len(pieces) == 1
    assert len(pieces[0]) == 3
    assert (pieces[0][:, 1] < west_of).all()
    assert (both.guides[both.guides[:, 2] == 42.0][:, 1] <= west_of + 1.0).all()
    grid = build(both, extent, 20.0).placed.grid
    plane = LocalPlane(*both.origin or (0.0, 0.0))
    at = np.column_stack(plane.to_local(np.array([54.0035, 54.0035]), np.array([10.008, 9.992])))
    assert grid.at(at) == pytest.approx([bed(54.0035, 10.008), bed(54.0035, WEST) + 25.0], abs=1.0)


def test_a_chart_without_soundings_or_coverage(tmp_path: Path) -> None:
    empty = Encoder()
    empty.area(302, square(SOUTH, WEST, NORTH, EAST), CATCOV=1)
    with pytest.raises(ConfigError, match="E: no soundings: take a chart of a larger scale"):
        read_sources([empty.write(tmp_path / "E.000")], None, 20.0)
    bare = Encoder()
    bare.soundings([(54.0, 10.0, 1.0)])
    with pytest.raises(ConfigError, match="does not say what it covers"):
        read_sources([bare.write(tmp_path / "B.000")], None, 20.0)


def test_an_area_of_a_chart(tmp_path: Path) -> None:
    path = bay().write(tmp_path / "BAY.000")
    survey, extent = read_sources([path], Box(54.001, 10.002, 54.004, 10.008), 10.0)
    built = build(survey, extent, 10.0)
    assert built.placed.grid.extent[1] - built.placed.grid.extent[0] == pytest.approx(334.0, abs=20.0)
    for area, said in (
        (Box(SHORE + 0.0005, 10.002, 54.0095, 10.008), "no water"),
        (Box(60.0, 10.0, 60.01, 10.02), "no water"),
    ):
        survey, extent = read_sources([path], area, 10.0)
        with pytest.raises(ConfigError, match=f"{said} in the area.*--area"):
            build(survey, extent, 10.0)


def test_files_that_cannot_be_meant(tmp_path: Path) -> None:
    path = bay().write(tmp_path / "BAY.000")
    metres = tmp_path / "m.csv"
    metres.write_text("east,north,depth\n0,0,5\n10,0,6\n0,10,7\n")
    for paths, said in (
        ([str(tmp_path / "BAY.001")], r"BAY.001: is an update; name the cell itself"),
        ([str(tmp_path / "chart.pdf")], r"what is .pdf\? There are .000"),
        ([path, str(metres)], "has metres"),
        ([str(tmp_path / "none.csv")], "none.csv: no such file"),
    ):
        with pytest.raises(ConfigError, match=said):
            read_sources(paths, None, 20.0)


def test_soundings_in_metres_alone(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    random = np.random.default_rng(1)
    rows = [(e, n, 10.0 + 0.05 * n) for e, n in random.uniform(0.0, 100.0, (200, 2))]
    path.write_text("east,north,depth\n" + "\n".join(f"{e:.3f},{n:.3f},{d:.3f}" for e, n, d in rows))
    survey, extent = read_sources([str(path)], None, 5.0)
    assert survey.origin is None
    grid = build(survey, extent, 5.0).placed.grid
    inside = grid.depths[2:-2, 2:-2]
    assert np.abs(inside - (10.0 + 0.05 * grid.north[2:-2, None])).max() < 0.15
    near, extent = read_sources([str(path)], None, 5.0, reach=2.0)
    assert build(near, extent, 5.0).report.unknown > 0.3


def raster(path: Path, origin: tuple[float, float] | None = (54.0, 10.0)) -> Grid:
    north, east = np.arange(30)[:, None], np.arange(40)
    depths = (10.0 + 0.1 * north - 0.2 * east).astype(np.float32)
    depths[20:, 30:] = np.nan
    grid = Grid(depths, -100.0, -200.0, 10.0)
    write_geotiff(grid, origin, str(path))
    return grid


def test_a_geotiff_of_ours_comes_back(tmp_path: Path) -> None:
    pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    path = tmp_path / "bed.tif"
    grid = raster(path)
    found = open_raster(str(path))
    assert found.spacing == pytest.approx(10.0, rel=0.01)
    same = found.depths(LocalPlane(54.0, 10.0), grid.north, grid.east)
    np.testing.assert_allclose(same[1:-1, 1:-1], grid.depths[1:-1, 1:-1], atol=2e-3)
    coarse = found.depths(LocalPlane(54.0, 10.0), grid.north[10:20:3], grid.east[10:20:3])
    np.testing.assert_allclose(coarse, grid.depths[10:20:3, 10:20:3], atol=0.2)
    survey, extent = read_sources([str(path)], None, 10.0)
    built = build(survey, extent, 10.0)
    centre = LocalPlane(*survey.origin or (0.0, 0.0))
    north, east = np.array([0.0, 50.0, 120.0]), np.array([-100.0, 120.0, -150.0])
    places = np.column_stack(centre.to_local(*geographic(north, east)))
    assert built.placed.grid.at(places) == pytest.approx(
        10.0 + 0.01 * (north + 100.0) - 0.02 * (east + 200.0), abs=0.05
    )
    hole = np.column_stack(centre.to_local(*geographic(np.array([160.0]), np.array([160.0]))))
    assert np.isnan(built.placed.grid.at(hole)).all()
    survey, extent = read_sources([str(path)], Box(60.0, 10.0, 60.1, 10.1), 10.0)
    with pytest.raises(ConfigError, match="no water in the area: move or widen"):
        build(survey, extent, 10.0)


def test_of_rasters_and_soundings_each_has_its_place(tmp_path: Path) -> None:
    """The first raster before the second, both before soundings, which are believed where neither has a pixel."""
    pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    for name, depth, west in (("a", 10.0, -100.0), ("b", 20.0, 0.0)):
        write_geotiff(
            Grid(np.full((21, 21), depth, np.float32), -100.0, west, 10.0), (54.0, 10.0), f"{tmp_path}/{name}.tif"
        )
    places = np.array([(n, e) for n in range(-100, 101, 20) for e in range(-100, 301, 20)], float)
    latitude, longitude = geographic(places[:, 0], places[:, 1])
    rows = "\n".join(f"{lon:.7f},{lat:.7f},30" for lat, lon in zip(latitude, longitude, strict=True))
    (tmp_path / "c.csv").write_text(f"lon,lat,depth\n{rows}\n")
    survey, extent = read_sources([f"{tmp_path}/{name}" for name in ("a.tif", "b.tif", "c.csv")], None, 10.0)
    grid = build(survey, extent, 10.0).placed.grid
    plane = LocalPlane(*survey.origin or (0.0, 0.0))
    wanted = np.column_stack(plane.to_local(*geographic(np.zeros(4), np.array([-50.0, 50.0, 150.0, 250.0]))))
    assert grid.at(wanted) == pytest.approx([10.0, 10.0, 20.0, 30.0], abs=0.01)


def test_a_large_raster_takes_no_longer_than_gdal_needs(tmp_path: Path) -> None:
    """A million pixels in UTM, of which radial bases would take ten minutes: each node is their depth."""
    rasterio = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    path = tmp_path / "utm.tif"
    rows, columns = np.mgrid[:1000, :1000]
    heights = (-20.0 - 5.0 * np.sin(rows / 40.0) - 0.01 * columns).astype(np.float32)
    where = rasterio.Affine(2.0, 0.0, 565_000.0, 0.0, -2.0, 6_000_000.0)
    with rasterio.open(
        path, "w", driver="GTiff", width=1000, height=1000, count=1, dtype="float32", crs="EPSG:32632", transform=where
    ) as file:
        file.write(heights, 1)
    survey, extent = read_sources([str(path)], None)
    built = build(survey, extent)
    grid = built.placed.grid
    assert grid.resolution == pytest.approx(2.0, abs=0.11)
    assert len(survey.soundings) == 0
    x, y = 565_000.0 + 2.0 * (np.array([100, 500, 900]) + 0.5), 6_000_000.0 - 2.0 * (np.array([50, 400, 800]) + 0.5)
    longitude, latitude = (np.array(axis) for axis in rasterio.warp.transform("EPSG:32632", "EPSG:4326", x, y))
    plane = LocalPlane(*survey.origin or (0.0, 0.0))
    found = grid.at(np.column_stack(plane.to_local(latitude, longitude)))
    assert found == pytest.approx(-heights[[50, 400, 800], [100, 500, 900]], abs=0.02)


def test_heights_and_depths_are_not_guessed(tmp_path: Path) -> None:
    """More land than water: by its name a height, else asked for; all of one sign is a seabed."""
    rasterio = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    path = str(tmp_path / "topobathy.tif")

    def write(values: NDArray[np.float64], name: str | None = None) -> None:
        where = rasterio.Affine(0.001, 0.0, 10.0, 0.0, -0.001, 54.0)
        with rasterio.open(
            path, "w", driver="GTiff", width=30, height=30, count=1, dtype="float32", crs="EPSG:4326", transform=where
        ) as file:
            file.write(values.astype(np.float32), 1)
            if name:
                file.set_band_description(1, name)

    mixed = np.linspace(-5.0, 20.0, 900).reshape(30, 30)
    write(mixed)
    with pytest.raises(ConfigError, match=r"from -5 to 20 m, and nothing says .*--positive up or"):
        open_raster(path)
    assert (open_raster(path, "up").scale, open_raster(path, "down").scale) == (-1.0, 1.0)
    write(mixed, "Elevation (MLLW)")
    assert open_raster(path).scale == -1.0
    write(mixed, "Depth")
    assert open_raster(path).scale == 1.0
    for sign in (1.0, -1.0):
        write(sign * np.abs(mixed))
        assert open_raster(path).scale == sign
    csv = tmp_path / "s.csv"
    csv.write_text("lon,lat,z\n10,54,-3\n10,54.1,4\n10.1,54,5\n")
    with pytest.raises(ConfigError, match="--positive up or --positive down"):
        read_points(str(csv))


def test_metres_of_a_named_coordinate_system(tmp_path: Path) -> None:
    pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    path = tmp_path / "utm.csv"
    path.write_text("easting,northing,depth\n565000,5984000,5\n565100,5984000,6\n565000,5984100,7\n")
    with pytest.raises(ConfigError, match="a coordinate system that it does not name: name it, as --crs EPSG:32605"):
        read_points(str(path))
    points = read_points(str(path), crs="EPSG:32632")
    assert points.geographic
    assert points.places[0] == pytest.approx([54.0, 10.0], abs=0.01)
    north, east = LocalPlane(*points.places[0]).to_local(*points.places[1:].T)
    assert np.hypot(north, east) == pytest.approx([100.0, 100.0], abs=0.1)
    with pytest.raises(ConfigError, match="--crs: EPSG:1: no such coordinate system"):
        read_points(str(path), crs="EPSG:1")


def test_a_world_across_the_180th_meridian(tmp_path: Path) -> None:
    path = tmp_path / "fiji.csv"
    rows = [(lon, -17.0 + 0.001 * i) for i in range(8) for lon in (179.996, 179.998, 180.0, -179.998, -179.996)]
    path.write_text("lon,lat,depth\n" + "\n".join(f"{lon},{lat},{12 if lon > 0 else 14}" for lon, lat in rows))
    survey, extent = read_sources([str(path)], None)
    assert extent[3] - extent[2] < 1000.0
    assert survey.origin == pytest.approx((-16.9965, 180.0)) or survey.origin == pytest.approx((-16.9965, -180.0))
    grid = build(survey, extent, 20.0).placed.grid
    assert grid.at(np.array([[0.0, -300.0], [0.0, 300.0]])) == pytest.approx([12.0, 14.0], abs=0.5)
    assert command.area("-17,179.9,-16,-179.9") == (-17.0, 179.9, -16.0, 180.1)
    extent = read_sources([str(path)], Box(-17.0, 179.997, -16.993, 180.003), None)[1]
    assert extent[3] - extent[2] < 700.0


def test_a_netcdf_like_gebco_s_and_rasters_that_are_none(tmp_path: Path) -> None:
    """Degrees, heights in whole metres, two variables in one file."""
    pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")
    h5py = pytest.importorskip("h5py", reason="writes the NetCDF for this test")
    path = tmp_path / "gebco.nc"
    with h5py.File(path, "w") as file:
        axes = {"lat": np.linspace(54.0, 54.1, 25), "lon": np.linspace(10.0, 10.2, 49)}
        for name, values in axes.items():
            file[name] = values
            file[name].make_scale(name)
            file[name].attrs["units"] = np.bytes_("degrees_north" if name == "lat" else "degrees_east")
            file[name].attrs["standard_name"] = np.bytes_("latitude" if name == "lat" else "longitude")
        for name, value in (("elevation", -np.arange(25)[:, None] * 2 - np.arange(49)), ("tid", np.ones((25, 49)))):
            file[name] = value.astype("i2")
            for axis, scale in enumerate(("lat", "lon")):
                file[name].dims[axis].attach_scale(file[scale])
    survey, extent = read_sources([str(path)], None)
    grid = build(survey, extent).placed.grid
    assert grid.resolution == pytest.approx(460.0, abs=20.0)
    plane = LocalPlane(*survey.origin or (0.0, 0.0))
    places = np.column_stack(plane.to_local(np.array([54.025, 54.05]), np.array([10.05, 10.1])))
    assert grid.at(places) == pytest.approx([24.0, 48.0], abs=0.5)
    bad = tmp_path / "bad.tif"
    bad.write_bytes(b"II*\0 no more")
    with pytest.raises(ConfigError, match=r"bad.tif: cannot be read as a raster"):
        open_raster(str(bad))
    with pytest.raises(ConfigError, match=r"none.tif: no such file"):
        open_raster(str(tmp_path / "none.tif"))


@pytest.mark.parametrize("kind", ["WMS", "VRT"])
def test_a_raster_that_names_a_host_is_refused_unasked(kind: str, tmp_path: Path) -> None:
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
            open_raster(str(path), "down")
        host.setblocking(False)
        with pytest.raises(BlockingIOError):
            host.accept()

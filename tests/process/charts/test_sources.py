"""Reading seabed data: soundings as text, compressed files, charts and rasters, with their limits and faults."""

import bz2
import gzip
import lzma
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hil.charts.build import build
from hil.charts.chart_survey import GeoBox
from hil.charts.describe import describe
from hil.charts.projection import LocalPlane
from hil.charts.sources import points
from hil.charts.sources.combine import ReadOptions, read_sources
from hil.charts.sources.points import read_points
from hil.charts.sources.sign import Declared
from hil.commands import world as command
from hil.common.errors import ConfigError
from sim.environment.obstacles import STANDING
from tests.support.charts.s57_encoder import Encoder, square
from tests.support.charts.small_cell import EAST, NORTH, SHORE, SOUTH, WEST, bay, bed


@pytest.mark.parametrize(("name", "text"), [
    ("a.csv", "longitude,latitude,depth\n10.5,54.25,7.5\n10.6,54.5,9\n"),
    ("b.csv", "Latitude (deg);Depth_m;Lon\n54.25;7.5;10.5\n54.5;9;10.6\n"),
    ("c.xyz", "# soundings\n10.5 54.25 -7.5\n\n 10.6\t54.5 -9.0\n"),
    ("d.txt", "10.5\t54.25\t7.5\n10.6\t54.5\t9.0\n"),
    ("f.csv", "Breite;Länge;Tiefe;lat;lon;water_depth\na;b;c;54,25;10,5;7,5\na;b;c;54,5;10,6;9\n"),
    ("h.xyz", "10,5 54,25 -7,5\n10,6 54,5 -9\n"),
    ("i.csv", "10.5, 54.25, 7.5\n10.6, 54.5, 9\n"),
    ("g.xyz", "> a track of GMT\n10.5 54.25 -7.5 S1\n10.6 54.5 -9.0 S1\n"),
    ("e.csv", '"lon","lat","note","elevation"\n10.5,54.25,"a, b",-7.5\n10.6,54.5,,-9\n10.7,54.5,nothing,\n'),
])  # fmt: skip
def test_text_formats_of_soundings_are_read(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / f"soundings_{name}"
    path.write_text(text)
    points = read_points(str(path))
    assert points.geographic
    assert points.positions.tolist() == [[54.25, 10.5], [54.5, 10.6]]
    assert points.depths.tolist() == [7.5, 9.0]


def test_compressed_soundings_in_metres_are_read_with_a_given_sign(tmp_path: Path) -> None:
    path = tmp_path / "s.xyz.gz"
    path.write_bytes(gzip.compress(b"x,y,z\n100,200,-5\n110,210,2\n120,220,-6\n"))
    with pytest.raises(ConfigError, match=r"from -6 to 2 m, and nothing states .*--positive up or --positive down"):
        read_points(str(path))
    points = read_points(str(path), Declared("up"))
    assert not points.geographic
    assert points.positions[0].tolist() == [200.0, 100.0]
    assert read_points(str(path), Declared("down")).depths.tolist() == [-5.0, 2.0, -6.0]
    assert read_points(str(path), Declared("up")).depths.tolist() == [5.0, -2.0, 6.0]


@pytest.mark.parametrize(("text", "output"), [
    ("", "has no soundings: a line must have longitude, latitude and depth"),
    ("lon,lat,colour\n1,2,3\n", "names the columns lon, lat, colour: longitude, latitude"),
    ("1,2,3\n1,2\n", "no sounding in row 2: '1,2'"),
    ("400000,5900000,12\n", "are not degrees in this order.*latitude,longitude,depth.*east,north,depth"),
])  # fmt: skip
def test_text_without_soundings_is_refused(tmp_path: Path, text: str, output: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=f"bad.csv: .*{output}"):
        read_points(str(path))


@pytest.mark.parametrize(("ending", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress), (".xz", lzma.compress)])
def test_a_decompression_bomb_is_refused(
    ending: str, pack: Callable[[bytes], bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reading is bounded by lines, by characters, and by the length of one line."""
    monkeypatch.setattr(points, "MAX_LINES", 10_000)
    monkeypatch.setattr(points, "LARGEST", 1_000_000)
    path = tmp_path / f"soundings.xyz{ending}"
    for text, message in (
        (b"1 2 3\n" * 20_000, "or 10000 lines: thin it out"),
        ((b"#" + b" " * 999 + b"\n") * 2_000, "more than 0 MiB of text"),
        (b"1" * 10_000_000, "a line of more than 10000 characters"),
    ):
        path.write_bytes(pack(text))
        with pytest.raises(ConfigError, match=rf"s\.xyz\{ending}: .*{message}"):
            read_points(str(path))
    path.write_bytes(pack(b"1 2 3\n" * 20_000)[:40] + b"\xff" * 40)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_points(str(path))
    path.write_bytes(pack(b"1 2 3\n" * 9_999))
    assert len(read_points(str(path)).depths) == 9_999


def test_a_decompression_bomb_takes_little_memory(tmp_path: Path) -> None:
    """The 4 MB hold 4 GB without the end of a line, which took all memory; of 20 MB of comments nothing is stored."""
    path = tmp_path / "s.xyz.gz"
    for text, message in ((b"0" * (1 << 22), "a line of more than 10000"), (b"#" * 9_999 + b"\n", "has no soundings")):
        path.write_bytes(gzip.compress(text) * 1000 if len(text) > 10_000 else gzip.compress(text * 2_000))
        tracemalloc.start()
        try:
            with pytest.raises(ConfigError, match=message):
                read_points(str(path))
            assert tracemalloc.get_traced_memory()[1] < 2 << 20
        finally:
            tracemalloc.stop()


def test_a_chart_becomes_a_survey_and_a_bed(tmp_path: Path) -> None:
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
    found = built.model.grid.at(np.column_stack(plane.to_local(latitude, longitude)))
    truth = [bed(*place) for place in zip(latitude, longitude, strict=True)]
    assert found == pytest.approx(truth, abs=0.3)
    ashore = np.column_stack(plane.to_local(np.array([54.009, 54.0033]), np.array([10.008, 10.0065])))
    assert (built.model.grid.at(ashore) < -2.0).all()
    assert built.report.rmse < 0.3


def test_the_chart_of_larger_scale_is_used_where_charts_overlap(tmp_path: Path) -> None:
    """The coarse chart is 5 m too deep everywhere, and has a rock of its own inside the finer one."""
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
    combined, extent = read_sources(paths, None, 20.0)
    assert combined.sheets[-1].name == "FINE"
    assert sorted(h.kind for h in combined.hazards) == ["OBSTRN", "PILPNT", "UWTROC"]
    west_of = LocalPlane(*combined.origin or (0.0, 0.0)).to_local(np.array([54.002]), np.array([WEST]))[1][0]
    contour_pieces = [line for line, depth in combined.contours if depth == 42.0]
    assert len(contour_pieces) == 1
    assert len(contour_pieces[0]) == 3
    assert (contour_pieces[0][:, 1] < west_of).all()
    assert (combined.guides[combined.guides[:, 2] == 42.0][:, 1] <= west_of + 1.0).all()
    grid = build(combined, extent, 20.0).model.grid
    plane = LocalPlane(*combined.origin or (0.0, 0.0))
    at = np.column_stack(plane.to_local(np.array([54.0035, 54.0035]), np.array([10.008, 9.992])))
    assert grid.at(at) == pytest.approx([bed(54.0035, 10.008), bed(54.0035, WEST) + 25.0], abs=3.0)


def overview() -> Encoder:
    """Return a general chart of 9 x 20 degrees: land from 200 km around its middle, and soundings in the far south."""
    cell = Encoder(scale=1_500_000)
    cell.area(302, square(60.0, 170.0, 69.0, 190.0), CATCOV=1)
    cell.area(42, square(60.0, 170.0, 62.0, 190.0), DRVAL1=0, DRVAL2=200)
    cell.area(71, square(62.0, 170.0, 69.0, 190.0))
    cell.soundings([(60.1 + 0.15 * i, 172.0 + 0.2 * j, 20.0 + 5.0 * i + j) for i in range(12) for j in range(20)])
    cell.soundings([(61.0, 188.0, 7.0)])
    return cell


def test_a_general_chart_is_cropped_to_where_most_soundings_are(tmp_path: Path) -> None:
    """Its middle is far inland. Without a crop the refusal names a place with soundings."""
    path = overview().write(tmp_path / "US1XX00M.000")
    survey, extent = read_sources([path], None, options=ReadOptions(crop=True))
    built = build(survey, extent)
    assert built.report.soundings > 60
    assert built.report.water > 0.95
    assert 60.5 < (survey.origin or (0.0, 0.0))[0] < 61.5
    with pytest.raises(ConfigError, match=r"for example --area=(6[01]\.\d),17[2-5]\.\d,") as caught:
        read_sources([path], None)
    area = GeoBox(*map(float, str(caught.value).partition("--area=")[2].split(",")))
    assert build(*read_sources([path], area)).report.water == 1.0


def test_water_around_soundings_in_unsurveyed_areas_is_known(tmp_path: Path) -> None:
    cell = Encoder(scale=10_000)
    cell.area(302, square(SOUTH, WEST, NORTH, EAST), CATCOV=1)
    cell.area(154, square(SOUTH, WEST, NORTH, EAST))
    cell.soundings([(54.002 + 0.001 * i, 10.008, 5.0 + i) for i in range(6)])
    survey, extent = read_sources([cell.write(tmp_path / "TRACK.000")], None)
    built = build(survey, extent, 20.0)
    assert 0.05 < built.report.water < 0.3
    assert built.report.unknown > 0.7


def test_a_chart_without_soundings_is_gridded_from_contours_and_areas(tmp_path: Path) -> None:
    """The bed of the small chart, whose depth areas are divided by contours, within 1.5 m of the truth."""
    cell, shores = Encoder(scale=10_000), [54.0, 54.002, 54.004, 54.006, SHORE]
    cell.area(302, square(SOUTH, WEST, NORTH, EAST), CATCOV=1)
    cell.area(71, square(SHORE, WEST, NORTH, EAST))
    depths = [round(20.0 * (SHORE - latitude) / (SHORE - SOUTH)) for latitude in shores]
    for south, north, deep, shoal in zip(shores, shores[1:], depths, depths[1:], strict=False):
        cell.area(42, square(south, WEST, north, EAST), DRVAL1=shoal, DRVAL2=deep)
        cell.line(43, [(north, WEST), (north, EAST)], VALDCO=shoal)
    survey, extent = read_sources([cell.write(tmp_path / "BARE.000")], None)
    assert not len(survey.soundings)
    assert survey.notes == ("BARE: has no soundings: its bed is that of its contours, coasts and depth areas",)
    built = build(survey, extent, 20.0)
    assert ("data", f"{built.report.guides} points on contours and coasts, no soundings held out") in describe(
        survey, built
    )
    for latitude in (54.001, 54.003, 54.005, 54.007):
        north = (latitude - 0.5 * (SOUTH + NORTH)) * 111_260.0
        truth = 20.0 * (SHORE - latitude) / (SHORE - SOUTH)
        assert built.model.grid.at(np.array([[north, 0.0]]))[0] == pytest.approx(truth, abs=1.5)


def test_a_chart_without_depths_or_coverage_is_refused(tmp_path: Path) -> None:
    empty = Encoder()
    empty.area(302, square(SOUTH, WEST, NORTH, EAST), CATCOV=1)
    with pytest.raises(ConfigError, match="E: no soundings or contours: use another chart of the place"):
        read_sources([empty.write(tmp_path / "E.000")], None, 20.0)
    encoder = Encoder()
    encoder.soundings([(54.0, 10.0, 1.0)])
    with pytest.raises(ConfigError, match=r"neither its coverage .* nor areas of water and land"):
        read_sources([encoder.write(tmp_path / "B.000")], None, 20.0)


def test_a_chart_that_states_no_coverage_covers_its_water_and_land(tmp_path: Path) -> None:
    stated, extent = read_sources([bay().write(tmp_path / "S.000")], None, 20.0)
    cell = bay()
    cell.records = [fields for fields in cell.records if fields.get("FRID", [(0,) * 7])[0][4] != 302]  # M_COVR
    bare, found = read_sources([cell.write(tmp_path / "B.000")], None, 20.0)
    assert found == pytest.approx(extent, abs=0.1)
    assert bare.notes == ("B: states no coverage: that of its areas of water and land is used",)
    assert not stated.notes
    one, other = (build(survey, extent, 20.0).model.grid.depths for survey in (stated, bare))
    np.testing.assert_allclose(one, other, atol=1e-3)


def test_an_area_of_a_chart_is_built_and_must_have_water(tmp_path: Path) -> None:
    path = bay().write(tmp_path / "BAY.000")
    survey, extent = read_sources([path], GeoBox(54.001, 10.002, 54.004, 10.008), 10.0)
    built = build(survey, extent, 10.0)
    assert built.model.grid.extent[1] - built.model.grid.extent[0] == pytest.approx(334.0, abs=20.0)
    survey, extent = read_sources([path], GeoBox(SHORE + 0.0005, 10.002, 54.0095, 10.008), 10.0)
    with pytest.raises(ConfigError, match=r"no water in the area.*--area"):
        build(survey, extent, 10.0)


@pytest.mark.parametrize(
    "area", [GeoBox(60.0, 10.0, 60.01, 10.02), GeoBox(54.0, 10.02, 54.01, 10.03), GeoBox(54.0, -10.0, 54.01, -9.9)]
)
def test_an_area_outside_the_data_is_refused_with_their_extent(tmp_path: Path, area: GeoBox) -> None:
    with pytest.raises(ConfigError, match=r"--area: .* outside the data, which cover 54 to 54\.01 N, 10 to 10\.016 E"):
        read_sources([bay().write(tmp_path / "BAY.000")], area, 10.0)


def test_an_area_is_compared_with_the_data_across_the_180th_meridian(tmp_path: Path) -> None:
    file = tmp_path / "pacific.csv"
    rows = [((359.99 + 0.005 * i) % 360.0 - 180.0, -0.01 + 0.005 * j, 10 + i) for i in range(5) for j in range(5)]
    file.write_text("longitude,latitude,depth\n" + "".join(f"{x},{y},{z}\n" for x, y, z in rows))
    for west in (179.995, -179.999, 180.001):
        assert read_sources([str(file)], GeoBox(-0.005, west, 0.005, west + 0.004))[0].source
    assert command.area("-17,179.9,-16,-179.9") == (-17.0, 179.9, -16.0, 180.1)
    with pytest.raises(ConfigError, match=r"which cover -0\.01 to 0\.01 N, 179\.99 to -179\.99 E"):
        read_sources([str(file)], GeoBox(-0.005, 179.9, 0.005, 179.98))


def test_unusable_files_are_refused(tmp_path: Path) -> None:
    path = bay().write(tmp_path / "BAY.000")
    metres = tmp_path / "m.csv"
    metres.write_text("east,north,depth\n0,0,5\n10,0,6\n0,10,7\n")
    for paths, output in (
        ([str(tmp_path / "BAY.001")], r"BAY.001: is an update; give the cell"),
        ([str(tmp_path / "chart.pdf")], r"unknown format .pdf: use .000"),
        ([path, str(metres)], "has positions in metres"),
        ([str(tmp_path / "none.csv")], "none.csv: no such file"),
    ):
        with pytest.raises(ConfigError, match=output):
            read_sources(paths, None, 20.0)


def test_soundings_in_local_metres_make_a_world_without_origin(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    random = np.random.default_rng(1)
    rows = [(e, n, 10.0 + 0.05 * n) for e, n in random.uniform(0.0, 100.0, (200, 2))]
    path.write_text("east,north,depth\n" + "\n".join(f"{e:.3f},{n:.3f},{d:.3f}" for e, n, d in rows))
    survey, extent = read_sources([str(path)], None, 5.0)
    assert survey.origin is None
    grid = build(survey, extent, 5.0).model.grid
    inside = grid.depths[2:-2, 2:-2]
    assert np.abs(inside - (10.0 + 0.05 * grid.north[2:-2, None])).max() < 0.15
    near, extent = read_sources([str(path)], None, 5.0, ReadOptions(reach=2.0))
    assert build(near, extent, 5.0).report.unknown > 0.3

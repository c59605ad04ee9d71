"""A whole chart is gridded once and cached; the bed of a dive is cut from that grid."""

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.charts import seabed_cache as module
from hil.charts.build import MAX_OWN_NODES, build, default_resolution
from hil.charts.build_process import read_and_build
from hil.charts.chart_survey import LINE_ACCURACY
from hil.charts.dive.prepare import DiveOptions, prepare_dive
from hil.charts.grid import Grid, grid_of
from hil.charts.hazards import MIN_HEIGHT, SeabedModel
from hil.charts.seabed_cache import cut_seabed, load_or_build_seabed
from hil.charts.site import MAX_MIDDLES, find_sites
from hil.charts.sources.combine import read_sources
from hil.common.errors import ConfigError
from hil.scenario.config import load_scenario
from sim.environment.obstacles import Cylinder
from sim.environment.world import load_world
from tests.support.charts.s57_encoder import Encoder, square
from tests.support.charts.small_cell import bay

pytestmark = pytest.mark.usefixtures("charts_in_process")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "uuv-hil" / "charts"


@pytest.fixture
def builds(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Record the resolution of each seabed that is gridded, not read from the cache."""
    built: list[Any] = []

    def build_and_record(paths: Any, area: Any, resolution: Any, *more: Any) -> Any:
        built.append(resolution)
        return read_and_build(paths, area, resolution, *more)

    monkeypatch.setattr(module, "read_and_build", build_and_record)
    return built


def test_a_chart_is_gridded_once_and_then_cached(tmp_path: Path, cache: Path, builds: list[Any]) -> None:
    path = bay(20_000).write(tmp_path / "BAY.000")
    first, second = load_or_build_seabed(path), load_or_build_seabed(path)
    assert builds == [None]
    assert first.model.grid.resolution == pytest.approx(LINE_ACCURACY * 20_000)
    assert second.report == first.report
    assert second.model.cylinders == first.model.cylinders
    np.testing.assert_array_equal(second.model.grid.depths, first.model.grid.depths)
    assert not second.model.grid.depths.flags.owndata, "mapped, not read"
    assert load_or_build_seabed(path, 25.0).model.grid.resolution == 25.0
    assert len(os.listdir(cache)) == 2
    os.utime(path, (1.0, 1.0))
    load_or_build_seabed(path)
    assert builds == [None, 25.0, None], "the file has changed"


def test_the_cache_is_pruned_and_may_be_missing_or_damaged(
    tmp_path: Path, cache: Path, builds: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = bay().write(tmp_path / "BAY.000")
    load_or_build_seabed(path, 20.0)
    (folder,) = cache.iterdir()
    (folder / "report.json").write_text("{")
    for _ in range(2):
        load_or_build_seabed(path, 20.0)
    assert builds == [20.0, 20.0], "again after the damage, then from the cache"
    monkeypatch.setattr(module, "MAX_CACHED_BYTES", 1)
    load_or_build_seabed(path, 25.0)
    assert len(os.listdir(cache)) == 1
    load_or_build_seabed(path, 25.0)
    assert builds == [20.0, 20.0, 25.0]
    shutil.rmtree(cache)
    cache.write_text("in the way")
    assert load_or_build_seabed(path, 25.0).report.soundings > 40


def test_a_part_of_a_chart_has_the_same_nodes_as_the_whole(tmp_path: Path) -> None:
    """All the chart's data shape a part, also when only that part is built."""
    path = bay().write(tmp_path / "BAY.000")
    placed = load_or_build_seabed(path, 10.0).model
    cut = cut_seabed(placed, (-123.0, 88.0, -201.0, 64.0))
    assert cut.grid.extent == pytest.approx((-130.0, 90.0, -210.0, 70.0))
    nodes = np.column_stack([axis.ravel() for axis in np.meshgrid(cut.grid.north, cut.grid.east, indexing="ij")])
    np.testing.assert_allclose(placed.grid.at(nodes), cut.grid.depths.ravel(), atol=1e-5)
    survey, _ = read_sources([path], None)
    alone = build(survey, cut.grid.extent, 10.0).model.grid
    # Not the outermost nodes: the bank of land beyond the grid needs nodes on both sides of the shore.
    np.testing.assert_allclose(alone.depths[1:-1, 1:-1], cut.grid.depths[1:-1, 1:-1], atol=0.02)
    things = (Cylinder(0.0, 0.0, 1.0, 2.0), Cylinder(0.0, 300.0, 1.0, 2.0))
    assert cut_seabed(SeabedModel(placed.grid, things, ()), cut.grid.extent).cylinders == things[:1]


def test_a_dive_has_the_bed_of_the_whole_chart(tmp_path: Path) -> None:
    path = bay().write(tmp_path / "BAY.000")
    path, facts = prepare_dive(path, DiveOptions(length=10.0, resolution=10.0), str(tmp_path))
    flown = grid_of(load_world(load_scenario(path).world))
    known = load_or_build_seabed(str(tmp_path / "BAY.000"), 10.0).model.grid
    nodes = np.column_stack([axis.ravel() for axis in np.meshgrid(flown.north, flown.east, indexing="ij")])
    np.testing.assert_allclose(known.at(nodes), flown.depths.ravel(), atol=1e-5)
    assert "linear interpolation of the same soundings and contours" in dict(facts)["held out"]
    with pytest.raises(ConfigError, match="--resolution is for charts"):
        prepare_dive("ridge", DiveOptions(length=10.0, resolution=10.0), str(tmp_path))


def test_a_small_scale_chart_with_soundings_in_one_corner_has_a_path(tmp_path: Path) -> None:
    """A dive finds a path, and a grid that is too fine is refused with a usable resolution."""
    cell = Encoder(scale=80_000)
    cell.area(302, square(54.0, 10.0, 54.2, 10.3), CATCOV=1)
    cell.area(42, square(54.0, 10.0, 54.2, 10.3), DRVAL1=5, DRVAL2=20)
    cell.soundings([(54.01 + 0.003 * i, 10.01 + 0.004 * j, 6.0 + i + 0.5 * j) for i in range(5) for j in range(5)])
    path = cell.write(tmp_path / "COARSE.000")
    assert load_or_build_seabed(path).model.grid.resolution == 40.0
    assert load_scenario(prepare_dive(path, DiveOptions(length=10.0), str(tmp_path)).path).master.depth >= 2.0
    with pytest.raises(ConfigError, match=r"use ([\d.]+) m or coarser") as caught:
        load_or_build_seabed(path, 1.0)
    fits = float(str(caught.value).partition("use ")[2].split()[0])
    assert 2.0 < fits < 4.0
    with pytest.raises(ConfigError, match=r"use [\d.]+ m or a larger area"):
        load_or_build_seabed(path, 25_000.0)


def test_the_resolution_follows_from_the_data_until_there_are_too_many_nodes(tmp_path: Path) -> None:
    survey, extent = read_sources([bay(12_345).write(tmp_path / "BAY.000")], None)
    assert default_resolution(survey, extent) == 6.2, "half a millimetre on paper, and two digits"
    wide = default_resolution(survey, (0.0, 60_000.0, 0.0, 60_000.0))
    assert 60_000.0**2 / wide**2 <= MAX_OWN_NODES
    assert wide == 30.0


def test_the_coast_line_guides_the_bed(tmp_path: Path) -> None:
    """The bed comes up to the coast without contours or near soundings, and no water is exactly 0 m deep."""
    cell = Encoder(scale=10_000)
    cell.area(302, square(54.0, 10.0, 54.01, 10.016), CATCOV=1)
    cell.area(42, square(54.0, 10.0, 54.008, 10.016), DRVAL1=0, DRVAL2=25)
    cell.area(71, square(54.008, 10.0, 54.01, 10.016))
    shore = [(54.008, 10.0), (54.008, 10.016)]
    cell.soundings([(54.0005 + 0.0008 * i, 10.001 + 0.0015 * j, 20.0 - 3.2 * i) for i in range(6) for j in range(10)])
    bare_bed = load_or_build_seabed(cell.write(tmp_path / "BARE.000"), 10.0).model.grid
    cell.line(30, shore)
    guided = load_or_build_seabed(cell.write(tmp_path / "COAST.000"), 10.0).model.grid
    before = guided.north < (54.0079 - 54.005) * 111_260.0
    for found in (bare_bed, guided):
        assert (found.depths[before] == 0.0).mean() < 0.01
    assert (np.diff(bare_bed.depths[before][:, 50]) > 0.0).any(), "a trough before the beach"
    assert (np.diff(guided.depths[before][:, 50]) < 0.0).all(), "up to the coast without one"
    assert guided.at(np.array([[(54.0078 - 54.005) * 111_260.0, 0.0]]))[0] < 1.5


def test_a_wreck_bounds_the_bed(tmp_path: Path) -> None:
    """A wreck whose top is deeper than the bed between the soundings stands on a bed below it, and does not vanish."""
    cell = Encoder(scale=10_000)
    cell.area(302, square(54.0, 10.0, 54.01, 10.016), CATCOV=1)
    cell.area(42, square(54.0, 10.0, 54.01, 10.016), DRVAL1=5, DRVAL2=30)
    cell.soundings([(54.0005 + 0.001 * i, 10.001 + 0.0015 * j, 10.0) for i in range(10) for j in range(10)])
    cell.point(159, (54.00495, 10.00775), VALSOU=13, WATLEV=3)
    seabed = load_or_build_seabed(cell.write(tmp_path / "WRECK.000"), 5.0)
    (wreck,) = seabed.model.cylinders
    assert wreck.top == 13.0
    bed = seabed.model.grid.at(np.array([[wreck.north, wreck.east]]))[0]
    assert bed == pytest.approx(13.0 + MIN_HEIGHT, abs=0.3)
    assert seabed.report.beds_under == 1
    assert seabed.report.held_out > 50, "the bed under a wreck is no sounding"


def test_sites_of_a_large_grid_are_searched_where_the_bed_is_steep() -> None:
    side = 400
    assert side * side > 3 * MAX_MIDDLES
    depths = np.full((side, side), 10.0, np.float32)
    depths[40:60, 40:60] += np.random.default_rng(1).uniform(-2.0, 2.0, (20, 20)).astype(np.float32)
    best = next(find_sites(Grid(depths, 0.0, 0.0, 10.0), 50.0))
    assert all(380.0 <= axis <= 610.0 for axis in best.start)

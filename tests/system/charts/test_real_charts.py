"""Beds from NOAA's ENC cells, where UUV_HIL_CHARTS names a folder of them."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from hil.charts.build import BuiltSeabed, build
from hil.charts.sources.combine import read_sources
from hil.charts.sources.s57 import read_cell
from hil.charts.sources.survey import Survey
from hil.common.errors import ConfigError
from tests.support.charts.dive import check_dive

CHARTS = os.environ.get("UUV_HIL_CHARTS", "")
pytestmark = pytest.mark.skipif(not CHARTS, reason="UUV_HIL_CHARTS names no folder with NOAA's cells")


def cell_path(name: str) -> str:
    return os.path.join(CHARTS, name, f"{name}.000")


def built(*names: str, resolution: float | None = None) -> tuple[Survey, BuiltSeabed]:
    survey, extent = read_sources([cell_path(name) for name in names], None, resolution)
    return survey, build(survey, extent, resolution)


@pytest.mark.parametrize(("name", "counts"), [
    ("US5AK5SI", {"SOUNDG": 8, "DEPCNT": 82, "DEPARE": 69, "COALNE": 24, "LNDARE": 7, "OBSTRN": 6, "WRECKS": 3,
                  "PIPSOL": 3, "CBLARE": 2, "SBDARE": 33}),
    ("US5AK5SJ", {"SOUNDG": 2, "DEPCNT": 113, "DEPARE": 108, "COALNE": 68, "LNDARE": 31, "OBSTRN": 1}),
    ("US5WA22M", {"SOUNDG": 24, "DEPCNT": 406, "DEPARE": 364, "COALNE": 123, "LNDARE": 67, "OBSTRN": 123, "WRECKS": 20,
                  "DRGARE": 21, "BRIDGE": 18, "PIPSOL": 6, "RESARE": 6, "SBDARE": 85}),
    ("US4AK4PH", {"CBLSUB": 4, "CBLARE": 2, "SBDARE": 240}),
])  # fmt: skip
def test_the_objects_of_the_cells_are_counted(name: str, counts: dict[str, int]) -> None:
    cell = read_cell(cell_path(name))
    assert {kind: len(cell.select(kind)) for kind in counts} == counts


def test_pipelines_zones_and_seabed_natures_of_a_chart_are_read() -> None:
    """Names and rules are those of the cell; this bay has more mud than sand."""
    survey, _ = read_sources([cell_path("US5WA22M")], None, None)
    charted = survey.charted
    assert {pipeline.diameter for pipeline in charted.pipelines} == {0.6}
    assert sum(zone.kind == "dumping" for zone in charted.zones) == 4
    (anchorage,) = [zone for zone in charted.zones if zone.kind == "anchorage"]
    assert anchorage.name == "Commencement Bay General Anchorage"
    assert any("entry prohibited" in zone.rule or "anchoring prohibited" in zone.rule for zone in charted.zones)
    codes = [nature.code for nature in charted.natures]
    assert codes.count(1) > 2 * codes.count(4) > 20


def test_updates_change_the_chart() -> None:
    plain, updated = (read_cell(cell_path("US5WA22M"), updates) for updates in (False, True))
    assert (plain.update, updated.update) == (0, 4)
    assert (len(plain.select("DEPARE")), len(updated.select("DEPARE"))) == (365, 364)
    assert (len(plain.select("SOUNDG")), len(updated.select("SOUNDG"))) == (22, 24)


def test_a_missing_update_is_named(tmp_path: Path) -> None:
    for ending in ("000", "001", "002", "004"):
        shutil.copy(cell_path("US5WA22M")[:-3] + ending, tmp_path / f"US5WA22M.{ending}")
    with pytest.raises(ConfigError, match=r"US5WA22M\.003: this update is missing"):
        read_cell(str(tmp_path / "US5WA22M.000"))


# RMSE in m of ours, of linear interpolation, and of the better of scipy's two radial bases (50 neighbours, linear or
# thin plate), all three with the same contours and limits.
ERRORS = [
    ("US5AK5SI", 2.926, 5.595, 3.760), ("US5AK5SJ", 6.519, 8.849, 7.294), ("US5WA22M", 4.804, 7.779, 5.535),
    ("US4AK4PH", 8.370, 12.41, 9.196), ("US4MD81M", 1.214, 1.812, 1.491),
]  # fmt: skip


@pytest.mark.parametrize(("name", "ours", "linear", "radial"), ERRORS)
def test_soundings_that_were_held_out_are_predicted(name: str, ours: float, linear: float, radial: float) -> None:
    """The grid is better than linear or radial interpolation, nowhere below a sounding, and has no mean error."""
    survey, world = built(name)
    report = world.report
    assert report.rmse == pytest.approx(ours, rel=0.02)
    assert report.linear_rmse == pytest.approx(linear, rel=0.02)
    assert report.rmse < 0.95 * min(report.linear_rmse, radial)
    assert report.rmse_all < 1.02 * report.rmse
    assert abs(report.bias) < 0.02 * report.rmse
    grid = world.model.grid
    depths = grid.at(survey.soundings[:, :2]) - survey.soundings[:, 2]
    assert np.nanmax(depths) < 0.2


def test_two_adjacent_charts_of_different_scales_are_joined() -> None:
    survey, found = built("US5AK5SI", "US5AK5SJ", resolution=50.0)
    assert [sheet.name for sheet in survey.sheets] == ["US5AK5SJ", "US5AK5SI"]
    assert found.report.rmse < 0.75 * found.report.linear_rmse
    assert found.report.unknown < 0.01


@pytest.mark.parametrize("name", [name for name, *_ in ERRORS])
def test_a_short_flight_over_each_chart(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    check_dive(tmp_path, cell_path(name))

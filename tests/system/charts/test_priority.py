"""Several sources for one area: which one is used, by priority, order and date; and beds across 180 degrees."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.charts.build import build
from hil.charts.grid import Grid
from hil.charts.projection import LocalPlane
from hil.charts.sources.combine import ReadOptions, read_sources
from hil.charts.sources.sign import Declared
from hil.commands import world as command
from hil.common.errors import ConfigError

pytestmark = pytest.mark.usefixtures("charts_in_process")

rasterio: Any = pytest.importorskip("rasterio", reason="rasters need rasterio: pip install 'uuv-hil[raster]'")


def raster(path: Path, depth: float, west: float, east: float, slope: float = 0.0) -> str:
    """Write a bed at 52 N that is `depth` m deep at 180 degrees, `slope` m a degree deeper to the east."""
    columns = round((east - west) / 0.0005)
    longitudes = west + (np.arange(columns) + 0.5) * 0.0005
    depths = np.tile(depth + slope * (longitudes % 360.0 - 180.0), (80, 1)).astype(np.float32)
    where = rasterio.Affine(0.0005, 0.0, west, 0.0, -0.0005, 52.02)
    keys = {"driver": "GTiff", "width": columns, "height": 80, "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    with rasterio.open(path, "w", transform=where, **keys) as file:
        file.write(depths, 1)
    return str(path)


def soundings(path: Path, depth: float, west: float, east: float, count: int = 250) -> str:
    places = np.random.default_rng(4).uniform((51.98, west), (52.02, east), (count, 2))
    rows = [f"{latitude:.6f},{(longitude + 180.0) % 360.0 - 180.0:.6f},{depth}" for latitude, longitude in places]
    path.write_text("latitude,longitude,depth\n" + "\n".join(rows) + "\n")
    return str(path)


def bed(files: list[str], priorities: dict[str, int] | None = None) -> tuple[Grid, LocalPlane, Any]:
    survey, extent = read_sources(files, None, 50.0, ReadOptions(Declared("down"), priorities=priorities or {}))
    built = build(survey, extent, 50.0)
    assert survey.origin
    return built.model.grid, LocalPlane(*survey.origin), built.report


def depth_at(grid: Grid, plane: LocalPlane, longitude: float) -> float:
    north, east = plane.to_local(np.array([52.0]), np.array([longitude]))
    row, column = round((north[0] - grid.north_min) / 50.0), round((east[0] - grid.east_min) / 50.0)
    return float(grid.depths[row, column])


def test_the_raster_of_greater_priority_is_used(tmp_path: Path) -> None:
    one, other = raster(tmp_path / "a.tif", 20.0, 10.0, 10.06), raster(tmp_path / "b.tif", 30.0, 10.02, 10.08)
    for priorities, both in (({}, 20.0), ({other: 2}, 30.0), ({one: 3, other: 2}, 20.0)):
        grid, plane, report = bed([one, other], priorities)
        assert [depth_at(grid, plane, x) for x in (10.01, 10.04, 10.07)] == pytest.approx([20.0, both, 30.0], abs=0.1)
        assert sum(share for _, share in report.beds) == pytest.approx(1.0, abs=0.01)


def test_soundings_of_greater_priority_replace_a_raster(tmp_path: Path) -> None:
    """The raster then fills in where soundings are farther away than they reach."""
    coarse = raster(tmp_path / "coarse.tif", 20.0, 10.0, 10.08)
    survey = soundings(tmp_path / "survey.csv", 40.0, 10.02, 10.04)
    for priorities, both in (({}, 20.0), ({survey: 2}, 40.0), ({coarse: -1}, 40.0), ({survey: 1}, 20.0)):
        grid, plane, report = bed([coarse, survey], priorities)
        assert [depth_at(grid, plane, x) for x in (10.03, 10.07)] == pytest.approx([both, 20.0], abs=0.1)
    assert report.beds[0][1] > 0.99


def test_soundings_of_less_priority_are_left_out_where_others_exist(tmp_path: Path) -> None:
    old = soundings(tmp_path / "old.csv", 20.0, 10.0, 10.04, 600)
    new = soundings(tmp_path / "new.csv", 40.0, 10.02, 10.06, 600)
    grid, plane, _ = bed([old, new], {new: 1})
    assert [depth_at(grid, plane, x) for x in (10.01, 10.03, 10.05)] == pytest.approx([20.0, 40.0, 40.0], abs=0.5)
    mixed, plane, _ = bed([old, new])
    assert 20.0 < np.nanmean(mixed.depths[:, mixed.depths.shape[1] // 2]) < 40.0


def test_an_invalid_priority_is_refused(tmp_path: Path) -> None:
    assert command.priority("a=b.tif=-2") == ("a=b.tif", -2)
    for wrong in ("a.tif", "a.tif=high"):
        with pytest.raises(argparse.ArgumentTypeError, match="expected FILE=N"):
            command.priority(wrong)
    with pytest.raises(ConfigError, match=r"--priority: c.tif is not one of the files"):
        bed([raster(tmp_path / "a.tif", 20.0, 10.0, 10.02)], {"c.tif": 1})


@pytest.mark.parametrize("bounds", [[(179.96, 180.04)], [(-180.04, -179.96)], [(179.96, 180.0), (-180.0, -179.96)]])
def test_rasters_across_180_degrees_are_whole(tmp_path: Path, bounds: list[tuple[float, float]]) -> None:
    files = [raster(tmp_path / f"{k}.tif", 50.0, *each, slope=400.0) for k, each in enumerate(bounds)]
    grid, plane, _ = bed(files)
    assert np.isfinite(grid.depths).mean() > 0.98
    found = [depth_at(grid, plane, longitude) for longitude in (179.97, 179.99, 180.0, -179.99, -179.97)]
    assert found == pytest.approx([38.0, 46.0, 50.0, 54.0, 62.0], abs=0.3)


def test_soundings_on_both_sides_of_180_degrees_and_a_raster_on_one(tmp_path: Path) -> None:
    files = [soundings(tmp_path / "a.csv", 40.0, 179.99, 180.04), raster(tmp_path / "b.tif", 20.0, 179.96, 180.0)]
    grid, plane, _ = bed(files)
    assert [depth_at(grid, plane, x) for x in (179.97, 179.995, -179.98)] == pytest.approx([20.0, 20.0, 40.0], abs=0.1)

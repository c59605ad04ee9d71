"""A demonstration dive over a chart: its site, depth and scenario."""

from itertools import pairwise
from math import hypot
from pathlib import Path

import numpy as np
import pytest

from hil.charts.dive.prepare import DiveOptions, prepare_dive
from hil.charts.grid import Grid, grid_of
from hil.charts.site import MAX_ALTITUDE, MAX_DEPTH, MIN_ALTITUDE, depth_between, find_sites
from hil.common.errors import ConfigError
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from tests.support.charts.small_cell import bay

pytestmark = pytest.mark.usefixtures("charts_in_process")


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def slope_with_a_wall() -> Grid:
    """Return a bed 6 m deep in the south, 16 m in the north, with a wall out of the water along north = 100 m."""
    north = np.arange(-200.0, 201.0, 5.0)
    depths = np.repeat((11.0 + north / 40.0)[:, None], 81, axis=1).astype(np.float32)
    depths[np.abs(north - 100.0) < 3.0] = -2.0
    return Grid(depths, -200.0, -200.0, 5.0)


def test_the_best_path_is_beside_the_wall_and_in_known_water() -> None:
    grid = slope_with_a_wall()
    sites = list(find_sites(grid, 60.0))
    assert len(sites) > 2
    best = sites[0]
    assert all(60.0 < place[0] < 140.0 for place in (best.start, best.goal)), "the wall is seen from there"
    for site in sites:
        assert hypot(site.goal[0] - site.start[0], site.goal[1] - site.start[1]) == pytest.approx(60.0)
        way = np.linspace(site.start, site.goal, 50)
        assert (grid.at(way) - site.depth).min() > MIN_ALTITUDE - 0.3
    middles = [np.mean([site.start, site.goal], axis=0) for site in sites]
    assert all(hypot(*(a - b)) > 100.0 for a, b in pairwise(middles))


def test_a_requested_depth_is_used_where_the_water_allows_it() -> None:
    grid = slope_with_a_wall()
    assert {site.depth for site in find_sites(grid, 40.0, 7.0)} == {7.0}
    with pytest.raises(ConfigError, match="no straight path of 40 m at 30 m here with known water"):
        next(find_sites(grid, 40.0, 30.0))
    assert depth_between(grid, (0.0, -50.0), (0.0, 50.0)) == 8.5
    with pytest.raises(ConfigError, match="shallow or unknown water"):
        depth_between(grid, (60.0, 0.0), (140.0, 0.0))


def test_the_path_is_near_the_bed_where_all_water_is_deeper_than_daylight() -> None:
    """The water is 50 m deep, as in most surveys of hydrographic offices: the bed is not visible from 12 m."""
    grid = slope_with_a_wall()
    deep = grid._replace(depths=grid.depths + 40.0)
    site = next(find_sites(deep, 60.0))
    way = deep.at(np.linspace(site.start, site.goal, 50)) - site.depth
    assert way.min() > MIN_ALTITUDE - 0.3
    assert way.max() < MAX_ALTITUDE + 0.3
    assert all(each.depth <= MAX_DEPTH for each in find_sites(grid, 60.0))


def test_a_dive_scenario_over_a_chart_has_sensors_and_clearance(tmp_path: Path) -> None:
    """Start and goal are at the requested geographic positions."""
    chart = bay().write(tmp_path / "BAY.000")
    path = prepare_dive(chart, DiveOptions((54.0015, 10.002), (54.0015, 10.0025), resolution=10.0), str(tmp_path)).path
    scenario = load_scenario(path)
    assert {"laser", "camera", "forward_sonar", "altimeter"} <= set(scenario.sensors)
    assert scenario.start.north == pytest.approx((54.0015 - 54.005) * 111_260.0, abs=2.0)
    world = load_world(scenario.world)
    assert scenario.start.depth == scenario.master.depth
    assert world.seabed(scenario.start.north, scenario.start.east) - scenario.start.depth >= MIN_ALTITUDE
    south, north, west, east = grid_of(world).extent
    assert north - south < 350.0
    assert east - west < 400.0


def test_a_dive_over_a_world_without_origin_takes_no_positions(tmp_path: Path) -> None:
    path = prepare_dive("ridge", DiveOptions(depth=6.0, length=20.0), str(tmp_path)).path
    assert load_scenario(path).master.depth == 6.0
    with pytest.raises(ConfigError, match="this world has no `origin`"):
        prepare_dive("ridge", DiveOptions((1.0, 2.0), (1.0, 2.001)), str(tmp_path))

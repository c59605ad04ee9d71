"""Planning and drawing in a world of 50 km x 50 km at 5 m: only the surroundings are read."""

import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.autonomy.paths.astar import path_length
from hil.charts.grid import overview
from hil.master.flight import make_request, prepare
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.map_parts import MAX_GROWN
from hil.scenario.variant import write_toml
from hil.view.scene.world import nodes
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

SIDE, STEP = 10_001, 5.0
HALF = 0.5 * (SIDE - 1) * STEP
NEAR = slice(4700, 5301)  # rows and columns that hold water, 30 m deep; all else is land, and takes no room on the disk


def scenario(folder: Path, wall: float = 0.0, **master: Any) -> Scenario:
    """Return a scenario in water of 3 km x 3 km; a wall `wall` m long through the middle begins at the south edge."""
    depths = np.full((NEAR.stop - NEAR.start, NEAR.stop - NEAR.start), 30.0, "<f4")
    if wall:
        depths[: int(wall / STEP), 298:303] = 1.0
    with open(folder / "large.f32", "wb") as file:
        os.truncate(file.fileno(), 4 * SIDE * SIDE)
        for row, line in enumerate(depths, NEAR.start):
            file.seek(4 * (row * SIDE + NEAR.start))
            file.write(line.tobytes())
    terrain = {
        "file": "large.f32", "north_min": -HALF, "east_min": -HALF, "resolution": STEP, "rows": SIDE, "columns": SIDE,
    }  # fmt: skip
    world = {"name": "large", "source": "", "extent": [-HALF, HALF, -HALF, HALF], "depth": 30.0, "terrain": terrain}
    write_toml(str(folder / "large.toml"), world)
    table = {
        "vehicle": "paper_six", "world": "large.toml", "start": {"north": -100.0, "east": -400.0, "depth": 5.0},
        "master": {"goal": [-100.0, 400.0], "depth": 5.0, "resolution": 2.0, **master},
    }  # fmt: skip
    write_toml(str(folder / "scenario.toml"), table)
    return load_scenario(str(folder / "scenario.toml"))


def peak_mb(work: Callable[[], Any]) -> float:
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def test_a_path_is_planned_on_the_part_around_start_and_goal(tmp_path: Path) -> None:
    """A map of the whole world would have 625 million cells, and was refused."""
    plan = prepare(scenario(tmp_path))
    assert path_length(plan.planner.path) == pytest.approx(800.0)
    assert plan.request.map.cells.size < 500_000
    assert plan.request.map.contains((-290.0, -590.0))
    assert peak_mb(lambda: prepare(load_scenario(str(tmp_path / "scenario.toml")))) < 60.0


def test_a_part_of_the_map_has_the_cells_of_the_whole_map(tmp_path: Path) -> None:
    loaded = scenario(tmp_path, wall=1500.0)
    world = load_world(loaded.world)
    small = world._replace(extent=(-500.0, 500.0, -600.0, 600.0))
    vehicle = load_vehicle(loaded.vehicle)[0]
    map_part, whole_map = make_request(loaded, vehicle, world).map, make_request(loaded, vehicle, small).map
    rows, columns = np.indices(map_part.cells.shape)[:, ::7, ::7].reshape(2, -1)
    places = [map_part.centre((int(row), int(column))) for row, column in zip(rows, columns, strict=True)]
    inside = [position for position in places if whole_map.contains(position)]
    assert len(inside) > 2000
    assert {map_part.is_free(position) for position in inside} == {True, False}
    assert all(map_part.is_free(position) == whole_map.is_free(position) for position in inside)


def test_a_detour_beyond_the_first_part_is_found(tmp_path: Path) -> None:
    """A wall of 2.6 km hides the goal but for its north end, 1.2 km off the straight line."""
    plan = prepare(scenario(tmp_path, wall=2600.0))
    assert max(north for north, *_ in plan.planner.path) > 1090.0
    assert 2500.0 < path_length(plan.planner.path) < 2800.0


def test_paths_between_distant_points_use_coarser_cells(tmp_path: Path) -> None:
    """A map of the part around the points would have 19 million cells of 0.25 m."""
    far = scenario(tmp_path, wall=1300.0, goal=[-100.0, 700.0], resolution=0.25)
    plan = prepare(far)
    assert plan.request.map.resolution == 1.0
    assert plan.request.map.cells.size <= MAX_GROWN
    world, vehicle = load_world(far.world), load_vehicle(far.vehicle)[0]
    below = 0.5 * vehicle.dimensions[2] + far.master.seabed_margin
    for north in (-370.0, -300.3, -204.2, -201.5, -200.0, -150.0):
        for east in (-17.5, -12.6, -10.2, -3.0, 0.0, 9.9, 12.7):
            is_deep = world.seabed(north, east) > far.master.depth + below
            assert is_deep or not plan.request.map.is_free((north, east)), "a cell with any shallow part is occupied"
    assert plan.request.map.is_free((-150.0, 0.0))
    assert (
        peak_mb(
            lambda: prepare(
                load_scenario(
                    str(tmp_path / "scenario.toml"), {"master.resolution": 0.25, "master.goal": [-100.0, 700.0]}
                )
            )
        )
        < 80.0
    )


def test_the_view_subsamples_the_bed_before_it_computes(tmp_path: Path) -> None:
    world = load_world(scenario(tmp_path).world)
    norths, easts, depths = nodes(world)
    assert depths.shape == (len(norths), len(easts))
    assert max(depths.shape) <= 400
    for row, column in ((0, 0), (190, 195), (200, 200)):
        assert depths[row, column] == world.seabed(norths[row], easts[column])
    assert peak_mb(lambda: nodes(world)) < 8.0


def test_an_overview_subsamples_the_nodes(tmp_path: Path) -> None:
    world = load_world(scenario(tmp_path).world)
    assert world.terrain is not None
    thin = overview(world, 500)
    assert max(thin.depths.shape) <= 500
    for row, column in ((0, 0), (239, 241), (250, 250)):
        north, east = float(thin.north[row]), float(thin.east[column])
        assert thin.depths[row, column] == world.seabed(north, east)
    coarse = overview(world, 500, 130.0)
    assert coarse.resolution == 130.0
    assert coarse.depths[193, 190] == pytest.approx(world.seabed(float(coarse.north[193]), float(coarse.east[190])))
    assert overview(world, 500, 1.0).resolution == pytest.approx(50_000.0 / 499), "no finer than the picture"
    assert peak_mb(lambda: overview(world, 1320)) < 20.0

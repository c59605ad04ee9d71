"""A* path planning: never through an obstacle, and smoothed without touching one."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.paths.astar import path_length, plan, smooth
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.common.errors import MissionError, NoPathError

Cell = tuple[int, int]


def random_grid(seed: int, resolution: float = 1.0) -> tuple[OccupancyGrid, Any]:
    generator = np.random.default_rng(seed)
    shape = generator.integers(2, 16, 2)
    cells = generator.random(shape) < generator.choice([0.05, 0.2, 0.35, 0.5])
    cells[tuple(generator.integers(0, shape))] = False
    return OccupancyGrid(cells, resolution, (-7.0, 30.0)), generator


def random_free(grid: OccupancyGrid, generator: Any) -> Cell:
    row, column = generator.choice(np.argwhere(~grid.cells))
    return int(row), int(column)


SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS)
def test_the_path_and_its_smoothed_form_touch_no_obstacle(seed: int) -> None:
    grid, generator = random_grid(seed)
    start, goal = random_free(grid, generator), random_free(grid, generator)
    endpoints = [
        (north + generator.uniform(-0.49, 0.49), east + generator.uniform(-0.49, 0.49))
        for north, east in map(grid.centre, (start, goal))
    ]
    try:
        path = plan(grid, *endpoints)
    except NoPathError:  # test_astar_networkx holds that there is none
        return
    smoothed = smooth(grid, path)
    for route in (path, smoothed):
        assert [route[0], route[-1]] == [endpoints[0], endpoints[-1]] or endpoints[0] == endpoints[1]
        assert all(grid.line_is_free(a, b) for a, b in pairwise(route))
        assert all(a != b for a, b in pairwise(route))
    assert path_length(smoothed) <= path_length(path) + 1e-9


def test_smoothing_leaves_turns_only_at_corners() -> None:
    """The shortest line past two walls with gaps at opposite ends has two bends; the grid path is 15 % longer."""
    cells = np.zeros((60, 60), bool)
    cells[20, :50] = True
    cells[40, 10:] = True
    grid = OccupancyGrid(cells, 0.5, (0.0, 0.0))
    path = plan(grid, (1.0, 1.0), (29.0, 29.0))
    smoothed = smooth(grid, path)
    assert len(smoothed) <= 6
    taut = (
        math.dist((1.0, 1.0), (10.25, 25.0))
        + math.dist((10.25, 25.0), (20.25, 5.0))
        + math.dist((20.25, 5.0), (29.0, 29.0))
    )
    assert path_length(smoothed) < 1.03 * taut
    assert path_length(path) > 1.04 * taut


def test_smoothing_accepts_straight_single_point_and_empty_paths() -> None:
    grid = OccupancyGrid(np.zeros((30, 30), bool), 1.0, (0.0, 0.0))
    assert smooth(grid, plan(grid, (2.0, 3.0), (27.0, 22.0))) == [(2.0, 3.0), (27.0, 22.0)]
    assert smooth(grid, [(2.0, 3.0)]) == [(2.0, 3.0)]
    assert smooth(grid, []) == []


def test_start_and_goal_in_one_cell_give_a_path() -> None:
    grid = OccupancyGrid(np.zeros((3, 3), bool), 1.0, (0.0, 0.0))
    assert plan(grid, (1.2, 1.2), (1.2, 1.2))[-1] == (1.2, 1.2)
    assert plan(grid, (1.5, 1.5), (1.5, 1.5)) == [(1.5, 1.5)]


def test_paths_do_not_cut_corners_of_obstacles() -> None:
    cells = np.zeros((2, 2), bool)
    cells[0, 1] = True
    grid = OccupancyGrid(cells, 1.0, (0.0, 0.0))
    assert plan(grid, (0.5, 0.5), (1.5, 1.5)) == [(0.5, 0.5), (1.5, 0.5), (1.5, 1.5)]
    cells[1, 0] = True
    with pytest.raises(MissionError, match="no path from"):
        plan(grid, (0.5, 0.5), (1.5, 1.5))


def test_occupied_start_and_goal_are_reported_with_the_nearest_free_cell() -> None:
    cells = np.zeros((10, 10), bool)
    cells[4:7, 4:7] = True
    grid = OccupancyGrid(cells, 1.0, (0.0, 0.0))
    with pytest.raises(
        MissionError, match=r"start \(4\.20 m north, 5\.00 m east\) is inside an obstacle; .*\(3\.50 m north"
    ):
        plan(grid, (4.2, 5.0), (1.0, 1.0))
    with pytest.raises(MissionError, match=r"goal \(1\.00 m north, -3\.00 m east\) is outside the map; .*0\.50 m east"):
        plan(grid, (1.0, 1.0), (1.0, -3.0))
    with pytest.raises(MissionError, match="no free cell"):
        plan(OccupancyGrid(np.ones((2, 2), bool), 1.0, (0.0, 0.0)), (0.5, 0.5), (1.5, 1.5))

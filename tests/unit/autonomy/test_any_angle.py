"""Any-angle paths: free of obstacles, near the true shortest, and with the grid's own lines of sight."""

import math
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.paths.any_angle import Sight, plan_any_angle
from hil.autonomy.paths.astar import path_length, plan
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.common.errors import MissionError
from tests.support.lazy import import_lazily

if TYPE_CHECKING:
    import networkx as nx
else:
    nx = import_lazily("networkx")

SEEDS = st.integers(0, 2**32 - 1)


def random_grid(seed: int) -> tuple[OccupancyGrid, list[tuple[int, int]]]:
    """Return a few cells grown to blobs, and two free cells."""
    generator = np.random.default_rng(seed)
    grid = OccupancyGrid(generator.random(generator.integers(5, 22, 2)) < 0.06, 0.5, (2.0, -9.0))
    grown = grid.inflate(float(generator.choice([0.0, 0.5, 0.8])))
    free = np.argwhere(~grown.cells)
    if not len(free):
        return random_grid(seed + 1)
    rows = generator.integers(len(free), size=2)
    return grown, [(int(free[i][0]), int(free[i][1])) for i in rows]


def shortest_length(grid: OccupancyGrid, start: tuple[int, int], goal: tuple[int, int]) -> float:
    """Return the length of the shortest path over centres of cells: Dijkstra over every free line between two cells."""
    graph: nx.Graph[tuple[int, int]] = nx.Graph()
    sight = Sight(~grid.cells)
    nodes = [(int(row), int(column)) for row, column in np.argwhere(~grid.cells)]
    for a, b in combinations(nodes, 2):
        if sight.is_free(a, b):
            graph.add_edge(a, b, weight=math.dist(grid.centre(a), grid.centre(b)))
    return float(nx.dijkstra_path_length(graph, start, goal))


@given(SEEDS)
def test_the_path_is_free_and_no_longer_than_the_grid_path(seed: int) -> None:
    grid, (start, goal) = random_grid(seed)
    endpoints = grid.centre(start), grid.centre(goal)
    try:
        straight = plan(grid, *endpoints)
    except MissionError:
        with pytest.raises(MissionError, match="no path"):
            plan_any_angle(grid, *endpoints)
        return
    path = plan_any_angle(grid, *endpoints)
    assert path[0] == endpoints[0]
    assert path[-1] == endpoints[1]
    assert all(grid.line_is_free(a, b) for a, b in pairwise(path))
    assert path_length(path) <= path_length(straight) + 1e-9


def test_the_path_is_nearly_as_short_as_the_true_shortest() -> None:
    """The searches are over 25 maps; the grid path, with turns of 45 degrees, is several per cent longer."""
    ratios: list[float] = []
    straight: list[float] = []
    for seed in range(120):
        grid, (start, goal) = random_grid(seed)
        if grid.cells.size > 150 or math.dist(start, goal) < 5.0:
            continue
        endpoints = grid.centre(start), grid.centre(goal)
        try:
            length = path_length(plan(grid, *endpoints))
        except MissionError:
            continue
        best = shortest_length(grid, start, goal)
        straight.append(length / best)
        ratios.append(path_length(plan_any_angle(grid, *endpoints)) / best)
    assert len(ratios) > 15
    assert min(ratios) > 0.96  # smoothing bends between centres too
    assert max(ratios) < 1.08
    assert sum(ratios) / len(ratios) < 1.01
    assert sum(straight) / len(straight) > 1.02


@given(SEEDS)
def test_sight_agrees_with_the_grids_line_of_sight(seed: int) -> None:
    generator = np.random.default_rng(seed)
    cells = generator.random(generator.integers(2, 60, 2)) < generator.choice([0.005, 0.03, 0.2])
    grid, sight = OccupancyGrid(cells, 1.0, (0.0, 0.0)), Sight(~cells)
    free = np.argwhere(~cells)
    for first, second in generator.integers(len(free), size=(10, 2)):
        a, b = ((int(row), int(column)) for row, column in (free[first], free[second]))
        assert sight.is_free(a, b) == grid.line_is_free(grid.centre(a), grid.centre(b))


def test_unreachable_start_and_goal_are_reported() -> None:
    cells = np.zeros((5, 5), bool)
    cells[2] = True
    grid = OccupancyGrid(cells, 1.0, (0.0, 0.0))
    with pytest.raises(MissionError, match="no path from"):
        plan_any_angle(grid, (0.5, 0.5), (4.5, 4.5))
    with pytest.raises(MissionError, match="inside an obstacle"):
        plan_any_angle(grid, (2.5, 0.5), (4.5, 4.5))

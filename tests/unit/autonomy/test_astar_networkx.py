"""A* against networkx's Dijkstra, an independent implementation, on 200 random maps."""

from typing import TYPE_CHECKING

import numpy as np
import pytest

from hil.autonomy.paths.astar import path_length, plan
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.common.errors import MissionError
from tests.support.lazy import import_lazily

if TYPE_CHECKING:
    import networkx as nx
else:
    nx = import_lazily("networkx")


def graph(cells: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> "nx.Graph[tuple[int, int]]":
    """Return the graph of free cells, joined to their 8 neighbours; a diagonal needs both cells beside it free."""
    graph: nx.Graph[tuple[int, int]] = nx.Graph()
    free = {(int(row), int(column)) for row, column in np.argwhere(~cells)}
    graph.add_nodes_from(free)
    for row, column in free:
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            around = {(row + down, column + right), (row + down, column), (row, column + right)}
            if around <= free:
                graph.add_edge((row, column), (row + down, column + right), weight=float(np.hypot(down, right)))
    return graph


@pytest.mark.parametrize("batch", range(10))
def test_path_cost_is_optimal_on_200_random_maps(batch: int) -> None:
    path_count = 0
    for seed in range(20 * batch, 20 * batch + 20):
        generator = np.random.default_rng(seed)
        cells = generator.random(generator.integers(4, 25, 2)) < generator.uniform(0.05, 0.45)
        free = [(int(row), int(column)) for row, column in np.argwhere(~cells)]
        start, goal = (free[int(generator.integers(len(free)))] for _ in "ab")
        grid = OccupancyGrid(cells, 0.5, (-3.0, 7.0))
        endpoints = grid.centre(start), grid.centre(goal)
        try:
            expected = nx.dijkstra_path_length(graph(cells), start, goal)
        except nx.NetworkXNoPath:
            with pytest.raises(MissionError, match="no path"):
                plan(grid, *endpoints)
            continue
        path_count += 1
        path = plan(grid, *endpoints)
        assert path_length(path) == pytest.approx(0.5 * expected, abs=1e-9)
        assert (path[0], path[-1]) == endpoints
    assert path_count > 10

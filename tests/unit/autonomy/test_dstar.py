"""D* Lite: after any change and from any position as short as A*, for less work."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.paths.astar import path_length, plan
from hil.autonomy.paths.dstar import DStarLite
from hil.autonomy.paths.occupancy import OccupancyGrid, Point
from hil.common.errors import MissionError


def length(planner: DStarLite | None, grid: OccupancyGrid, start: Point, goal: Point) -> float:
    """Return the length of the path, -1 if there is none."""
    try:
        path = (planner.plan if planner else plan)(grid, start, goal)
    except MissionError:
        return -1.0
    assert all(grid.line_is_free(a, b) for a, b in pairwise(path))
    return path_length(path)


@given(st.integers(0, 2**32 - 1))
def test_paths_stay_as_short_as_a_star_while_map_and_vehicle_change(seed: int) -> None:
    generator = np.random.default_rng(seed)
    cells = generator.random(generator.integers(4, 18, 2)) < 0.25
    free_cells = [tuple(int(i) for i in generator.integers(0, cells.shape)) for _ in range(4)]
    for cell in free_cells:
        cells[cell] = False
    planner = DStarLite()
    for start in (*free_cells[1:], *free_cells[1:]):
        grid = OccupancyGrid(cells.copy(), 1.0, (5.0, -2.0))
        ends = grid.centre((start[0], start[1])), grid.centre((free_cells[0][0], free_cells[0][1]))
        assert length(planner, grid, *ends) == pytest.approx(length(None, grid, *ends), abs=1e-9)
        for _ in range(int(generator.integers(0, 6))):
            changed = tuple(generator.integers(0, cells.shape))
            cells[changed] = not cells[changed]
        for cell in free_cells:
            cells[cell] = False


class CountingPlanner(DStarLite):
    """Counts the expanded cells, a measure of the cost of planning."""

    def __init__(self) -> None:
        super().__init__()
        self.expanded = 0

    def _settle(self, cell: int) -> None:
        self.expanded += 1
        super()._settle(cell)

    def _unsettle(self, cell: int) -> None:
        self.expanded += 1
        super()._unsettle(cell)


def test_a_repair_expands_far_fewer_cells_than_a_plan() -> None:
    """The search expands a small share of the first plan's cells after a wall appears near the vehicle."""
    cells = np.zeros((150, 150), bool)
    cells[60:90, 40:110] = True
    grid, goal = OccupancyGrid(cells, 1.0, (0.0, 0.0)), (145.5, 75.5)
    planner = CountingPlanner()
    planner.plan(grid, (5.5, 70.5), goal)
    first = planner.expanded
    cells[20, 60:80] = True
    assert length(planner, grid, (10.5, 70.5), goal) == pytest.approx(length(None, grid, (10.5, 70.5), goal))
    assert planner.expanded - first < 0.2 * first


def test_another_goal_or_map_starts_a_new_search() -> None:
    planner = DStarLite()
    for size, goal in ((12, (1.5, 9.5)), (12, (9.5, 9.5)), (20, (15.5, 3.5))):
        grid = OccupancyGrid(np.zeros((size, size), bool), 1.0, (0.0, 0.0))
        assert length(planner, grid, (0.5, 0.5), goal) == pytest.approx(length(None, grid, (0.5, 0.5), goal))
    with pytest.raises(MissionError, match="outside the map"):
        planner.plan(grid, (0.5, 0.5), (30.0, 3.0))

"""Any-angle path planning on a grid: lazy Theta* over jump points.

A* on a grid turns only in steps of 45 degrees. In Theta* the parent of a cell can be any cell in line of sight, so the
path goes straight from corner to corner (Daniel, Nash, Koenig & Felner, JAIR 39, 2010). The lazy version checks a line
of sight only when the search continues from the cell (Nash, Koenig & Tovey, "Lazy Theta*", AAAI 2010). The cells are
those where A* of `hil.autonomy.paths.astar` may turn, which leaves out most of an open map. If A*'s own path, smoothed,
is shorter, it is returned. The path is short, but not proven the shortest: that would need every line between two
corners of the map.
"""

import heapq
from math import dist, inf

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.astar import ALL_DIRECTIONS, Jumps, path_length, plan, smooth, trace, without_repeats
from hil.autonomy.paths.occupancy import Cell, OccupancyGrid, Point

# In free water, a line of sight is checked in steps of up to this number of cells.
_FARTHEST_STEP = 24
# A straight line may replace up to this number of turns.
_AHEAD = 20


def plan_any_angle(grid: OccupancyGrid, start: Point, goal: Point) -> list[Point]:
    """Return a short path from `start` to `goal` (m north, m east) over free cells, as the points where it turns.

    The vehicle's size is not modelled: inflate the grid first. Raises MissionError as `hil.autonomy.paths.astar.plan`.
    """
    known = smooth(grid, plan(grid, start, goal))
    cells = _Search(~grid.cells, grid.cell(start), grid.cell(goal)).run()
    direct = smooth(grid, without_repeats([start, *map(grid.centre, cells), goal]))
    return min(direct, known, key=path_length)


class _Search:
    """State of one search. Cells are numbered as in `Jumps`: row by row on a map with a border of one occupied cell."""

    def __init__(self, free: NDArray[np.bool_], start: Cell, goal: Cell) -> None:
        self._jumps = Jumps(free, goal)
        self._sight = Sight(free)
        self._source, self._target = self._jumps.index(start), self._jumps.index(goal)
        self._costs = {self._source: 0.0}
        self._parents = {self._source: self._source}
        self._came_from: dict[int, int] = {}  # cell -> start of the jump that reached it, whose line is always free
        self._closed: set[int] = set()

    def run(self) -> list[Cell]:
        """Return the cells where the path turns, ends included; a path has to exist."""
        queue = [(0.0, self._source)]
        while True:
            _, cell = heapq.heappop(queue)
            if cell in self._closed:
                continue
            self._settle(cell)
            if cell == self._target:
                return self._straightened([self._jumps.cell(index) for index in trace(self._parents, cell)])
            for direction in ALL_DIRECTIONS:
                next_cell = self._jumps.next(cell, direction)
                if next_cell and next_cell not in self._closed and self._reach(next_cell, cell):
                    heapq.heappush(queue, (self._costs[next_cell] + self._distance(next_cell, self._target), next_cell))

    def _straightened(self, cells: list[Cell]) -> list[Cell]:
        """Remove turns that a straight line can replace, because each parent was chosen by a single check."""
        lengths, before = [0.0], [0]
        for end, cell in enumerate(cells[1:], 1):
            choices = [
                end - 1,
                *(i for i in range(max(0, end - _AHEAD), end - 1) if self._sight.is_free(cells[i], cell)),
            ]
            candidates = [(lengths[i] + dist(cells[i], cell), i) for i in choices]
            lengths.append(min(candidates)[0])
            before.append(min(candidates)[1])
        return [cells[i] for i in trace(dict(enumerate(before)), len(cells) - 1)]

    def _reach(self, to: int, cell: int) -> bool:
        """Assume that the parent of `cell` sees `to`: store that path if it is the best so far; return True if so."""
        parent = self._parents[cell]
        cost = self._costs[parent] + self._distance(parent, to)
        if cost >= self._costs.get(to, inf):
            return False
        self._costs[to], self._parents[to], self._came_from[to] = cost, parent, cell
        return True

    def _settle(self, cell: int) -> None:
        """Check that the parent sees the cell; otherwise use the jump's start as its parent."""
        self._closed.add(cell)
        before, parent = self._came_from.get(cell, cell), self._parents[cell]
        if parent != before and not self._sight.is_free(self._jumps.cell(parent), self._jumps.cell(cell)):
            self._parents[cell] = before
            self._costs[cell] = self._costs[before] + self._distance(before, cell)

    def _distance(self, a: int, b: int) -> float:
        return dist(self._jumps.cell(a), self._jumps.cell(b))


class Sight:
    """Line-of-sight checks between the centres of cells, with few steps in open water."""

    def __init__(self, free: NDArray[np.bool_]) -> None:
        walled = np.pad(free, 1)
        self._width = walled.shape[1]
        self._clear = _free_rings(walled).tobytes()

    def is_free(self, start: Cell, end: Cell) -> bool:
        """Return whether the line between two free cells touches only free cells; corners of occupied cells count."""
        (row, column), (to_row, to_column) = start, end
        index = (row + 1) * self._width + column + 1
        along, across = abs(to_row - row), abs(to_column - column)
        ahead = self._width if to_row > row else -self._width
        lateral = 1 if to_column > column else -1
        if across > along:
            along, across, ahead, lateral = across, along, lateral, ahead
        return self._walk(index, along, across, ahead, lateral)

    def _walk(self, origin: int, along: int, across: int, ahead: int, lateral: int) -> bool:
        """Check `along` cells from `origin` in steps of `ahead`, and `across` (fewer) in steps of `lateral`."""
        clear, step = self._clear, 0
        while step < along:
            # lateral offset of the line between this column of cells and the next, in halves of 1 / along
            shift, rest = divmod((2 * step + 1) * across + along, 2 * along)
            cell = origin + step * ahead + shift * lateral
            if not (clear[cell] and clear[cell + ahead]):
                return False
            if not rest and not (clear[cell - lateral] and clear[cell - lateral + ahead]):  # at a corner of four cells
                return False
            step += max(1, clear[cell] - 1)
        return True


def _free_rings(free: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the number of free rings of cells around each cell, itself counted as one; 0 if it is occupied."""
    rings, inner = free.astype(np.uint8), free
    for _ in range(_FARTHEST_STEP):
        rows = inner[:-2] & inner[1:-1] & inner[2:]
        shrunk = np.zeros_like(inner)
        shrunk[1:-1, 1:-1] = rows[:, :-2] & rows[:, 1:-1] & rows[:, 2:]
        rings += shrunk
        inner = shrunk
    return rings

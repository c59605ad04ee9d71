"""Incremental path planning on a changing map: D* Lite.

Koenig & Likhachev, "D* Lite", AAAI 2002, the optimised version: the search runs from the goal to the vehicle and is
repaired where cells change. It pays off where the changes are near the vehicle and the rest of the map has been
searched already; the first plan takes longer than with `hil.autonomy.paths.astar`, which jumps over open water. Moves
and corners are the same as there. Lengths are integers (a cell is 2^20), so equally long paths compare equal, however
they are summed.
"""

import heapq
from math import inf, sqrt

import numpy as np

from hil.autonomy.paths.astar import check_ends, no_path_error, without_repeats
from hil.autonomy.paths.occupancy import OccupancyGrid, Point

_CELL = 1 << 20
_DIAGONAL = round(sqrt(2.0) * _CELL)

Key = tuple[float, float]


class DStarLite:
    """Planner that reuses its search for the next plan, as long as the goal and the map's size do not change."""

    def __init__(self) -> None:
        self._cells: np.ndarray[tuple[int, int], np.dtype[np.bool_]] = np.empty((0, 0), np.bool_)
        self._goal = self._start = -1

    def plan(self, grid: OccupancyGrid, start: Point, goal: Point) -> list[Point]:
        """Return the shortest 8-connected path from `start` to `goal` (m north, m east), cell by cell.

        The vehicle's size is not modelled: inflate the grid first. Raises MissionError as
        `hil.autonomy.paths.astar.plan` does.
        """
        check_ends(grid, start, goal)
        self._width = int(grid.cells.shape[1]) + 2
        start_index, target = (self._index(*grid.cell(point)) for point in (start, goal))
        if target != self._goal or grid.cells.shape != self._cells.shape:
            self._begin(grid, start_index, target)
        self._shift += self._octile(self._start, start_index)
        self._start = start_index
        self._repair(grid)
        self._search()
        if self._costs.get(start_index, inf) == inf:
            raise no_path_error(start, goal)
        cells = [(index // self._width - 1, index % self._width - 1) for index in self._trace_path()]
        return without_repeats([start, *map(grid.centre, cells), goal])

    def _index(self, row: int, column: int) -> int:
        return (row + 1) * self._width + column + 1

    def _begin(self, grid: OccupancyGrid, start: int, goal: int) -> None:
        width = self._width
        self._cells, self._start, self._goal = grid.cells.copy(), start, goal
        self._free = bytearray(np.pad(~grid.cells, 1).tobytes())
        self._straight = (1, width, -1, -width)
        self._diagonal = tuple((a + b, a, b) for a in (1, -1) for b in (width, -width))
        self._shift = 0  # "k_m": sum of the vehicle's own movements, added to every key
        self._costs: dict[int, float] = {}  # "g"
        self._ahead: dict[int, float] = {goal: 0}  # "rhs": the cost through the best neighbour
        self._queue: list[tuple[Key, int]] = []
        self._queued: dict[int, Key] = {}
        self._put(goal)

    def _repair(self, grid: OccupancyGrid) -> None:
        """Update the cells that changed and their neighbours, whose moves they affect."""
        changed = [self._index(int(row), int(column)) for row, column in np.argwhere(grid.cells != self._cells)]
        for cell in changed:
            self._free[cell] = not self._free[cell]
        around = [0, *self._straight, *(step for step, _, _ in self._diagonal)]
        for cell in {cell + step for cell in changed for step in around}:
            self._update_best_neighbour(cell)
        self._cells = grid.cells.copy()

    def _search(self) -> None:
        costs, ahead = self._costs, self._ahead
        while self._queue:
            key, cell = self._queue[0]
            if self._queued.get(cell) != key:
                heapq.heappop(self._queue)
                continue
            here = ahead.get(self._start, inf)
            if key >= self._key(self._start) and here == costs.get(self._start, inf):
                return
            heapq.heappop(self._queue)
            del self._queued[cell]
            if key < self._key(cell):
                self._put(cell)
            elif costs.get(cell, inf) > ahead.get(cell, inf):
                self._settle(cell)
            else:
                self._unsettle(cell)

    def _settle(self, cell: int) -> None:
        cost = self._costs[cell] = self._ahead[cell]
        for neighbour, length in self._moves(cell):
            if cost + length < self._ahead.get(neighbour, inf):
                self._ahead[neighbour] = cost + length
                self._put(neighbour)

    def _unsettle(self, cell: int) -> None:
        before = self._costs.pop(cell, inf)
        for neighbour, length in self._moves(cell):
            if self._ahead.get(neighbour, inf) == before + length:
                self._update_best_neighbour(neighbour)
        self._update_best_neighbour(cell)

    def _update_best_neighbour(self, cell: int) -> None:
        """Recompute the best neighbour of a cell."""
        if cell != self._goal:
            costs = [self._costs.get(neighbour, inf) + length for neighbour, length in self._moves(cell)]
            self._ahead[cell] = min(costs, default=inf)
        self._put(cell)

    def _put(self, cell: int) -> None:
        """Queue a cell if its two costs differ; else remove it from the queue."""
        if self._costs.get(cell, inf) == self._ahead.get(cell, inf):
            self._queued.pop(cell, None)
            return
        key = self._queued[cell] = self._key(cell)
        heapq.heappush(self._queue, (key, cell))

    def _key(self, cell: int) -> Key:
        cost = min(self._costs.get(cell, inf), self._ahead.get(cell, inf))
        return cost + self._octile(self._start, cell) + self._shift, cost

    def _moves(self, cell: int) -> list[tuple[int, int]]:
        """Return the free neighbours and their distances."""
        free = self._free
        if not free[cell]:
            return []
        moves = [(cell + step, _CELL) for step in self._straight if free[cell + step]]
        for step, first, second in self._diagonal:
            if free[cell + step] and free[cell + first] and free[cell + second]:
                moves.append((cell + step, _DIAGONAL))
        return moves

    def _trace_path(self) -> list[int]:
        cell = self._start
        path = [cell]
        while cell != self._goal:
            cell = min((length + self._costs.get(near, inf), near) for near, length in self._moves(cell))[1]
            path.append(cell)
        return path

    def _octile(self, a: int, b: int) -> int:
        rows, columns = abs(a // self._width - b // self._width), abs(a % self._width - b % self._width)
        return _CELL * abs(rows - columns) + _DIAGONAL * min(rows, columns)

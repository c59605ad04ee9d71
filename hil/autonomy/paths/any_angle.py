"""Any-angle path planning on a grid: lazy Theta* over jump points.

A* on a grid turns by 45 degrees only; Theta* lets a cell's parent be any cell that it can be seen from, so the
path goes straight from corner to corner (Daniel, Nash, Koenig & Felner, JAIR 39, 2010). Lazy, it looks along a
line only once the cell is the next to go on from (Nash, Koenig & Tovey, "Lazy Theta*", AAAI 2010). The cells are
those where A* of `hil.autonomy.paths.astar` may turn, which leaves most of an open map out. Where A*'s own path,
smoothed,
is shorter, it is the answer. The path is short, not proven the shortest: that would take every line between two corners
of the map.
"""

import heapq
from math import dist, inf

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.astar import ALL_DIRECTIONS, Jumps, path_length, plan, smooth, trace, without_repeats
from hil.autonomy.paths.occupancy import Cell, OccupancyGrid, Point

# A line of sight is walked in steps of up to so many cells where the water around is free.
_FARTHEST_STEP = 24
# A straight line may leave out up to so many turns.
_AHEAD = 20


def plan_any_angle(grid: OccupancyGrid, start: Point, goal: Point) -> list[Point]:
    """Return a short path from `start` to `goal` (m north, m east) over free cells, as the points where it turns.

    Vehicle size is not modelled: inflate the grid. Raises MissionError as `hil.autonomy.paths.astar.plan` does.
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
        self._came_from: dict[int, int] = {}  # the jump that ends in a cell: always free to go
        self._closed: set[int] = set()

    def run(self) -> list[Cell]:
        """Return the cells where the path turns, ends included; there must be one."""
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
        """Return the cells without turns that a straight line can replace: parents were chosen by one check each."""
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
        """Assume that `to` can be seen from the parent of `cell`; return whether that is the best path so far."""
        parent = self._parents[cell]
        cost = self._costs[parent] + self._distance(parent, to)
        if cost >= self._costs.get(to, inf):
            return False
        self._costs[to], self._parents[to], self._came_from[to] = cost, parent, cell
        return True

    def _settle(self, cell: int) -> None:
        """Check whether the parent can be seen; else use the jump's start as the parent."""
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
        """Return whether the line between two free cells touches free ones only; an occupied one's corner counts."""
        (row, column), (to_row, to_column) = start, end
        here = (row + 1) * self._width + column + 1
        along, across = abs(to_row - row), abs(to_column - column)
        ahead = self._width if to_row > row else -self._width
        lateral = 1 if to_column > column else -1
        if across > along:
            along, across, ahead, lateral = across, along, lateral, ahead
        return self._walk(here, along, across, ahead, lateral)

    def _walk(self, origin: int, along: int, across: int, ahead: int, lateral: int) -> bool:
        """Check `along` cells from `origin` in steps of `ahead`, and `across` (fewer) in steps of `lateral`."""
        clear, step = self._clear, 0
        while step < along:
            # between this column of cells and the next the line is this far aside, in halves of 1 / along
            shift, rest = divmod((2 * step + 1) * across + along, 2 * along)
            cell = origin + step * ahead + shift * lateral
            if not (clear[cell] and clear[cell + ahead]):
                return False
            if not rest and not (clear[cell - lateral] and clear[cell - lateral + ahead]):  # through the corner of four
                return False
            step += max(1, clear[cell] - 1)
        return True


def _free_rings(free: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return how many rings of cells around each are free, itself counted as one; 0 where it is occupied."""
    rings, inner = free.astype(np.uint8), free
    for _ in range(_FARTHEST_STEP):
        rows = inner[:-2] & inner[1:-1] & inner[2:]
        shrunk = np.zeros_like(inner)
        shrunk[1:-1, 1:-1] = rows[:, :-2] & rows[:, 1:-1] & rows[:, 2:]
        rings += shrunk
        inner = shrunk
    return rings

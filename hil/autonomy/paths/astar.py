"""Shortest path on an occupancy grid: A* with jump-point search, and smoothing of the path.

Moves go to the 8 neighbours at cost 1 and sqrt(2). A diagonal move needs both adjacent cells free, so no corner is cut.
Of the many equally long paths, jump-point search considers only one: diagonal moves first, and a turn only where an
obstacle makes it useful (Harabor & Grastien, "Online graph pruning for pathfinding on grid maps", AAAI 2011; the
variant without corner cutting, SoCS 2012). The next turn in the four straight directions comes from tables that numpy
computes for the whole map at once.
"""

import heapq
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import ceil, hypot, inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.occupancy import Cell, OccupancyGrid, Point
from hil.common.errors import MissionError, NoPathError

# Saving of a diagonal move compared with two straight ones.
_SAVING = 2.0 - sqrt(2.0)
# (rows, columns) of a move, from east over north all round: even ones are straight, odd ones diagonal.
_DIRECTIONS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
ALL_DIRECTIONS = tuple(range(8))
STRIP_ROWS = 64
# Directions in which a path may go on after a move: up to 90 degrees off a straight one, 45 off a diagonal one.
_ONWARD = [tuple((d + turn) % 8 for turn in (range(-1, 2) if d % 2 else range(-2, 3))) for d in range(8)]
# Views of the map for moves to the east, north, west and south, in which the move is always to the right.
_VIEWS: tuple[Callable[[NDArray[Any]], NDArray[Any]], ...] = (
    lambda cells: cells,
    lambda cells: cells.T,
    lambda cells: cells[:, ::-1],
    lambda cells: cells.T[:, ::-1],
)


def plan(grid: OccupancyGrid, start: Point, goal: Point) -> list[Point]:
    """Return the shortest 8-connected path from `start` to `goal` (m north, m east), as the points where it turns.

    It passes through centres of cells; its ends are `start` and `goal` themselves. The vehicle's size is not modelled:
    inflate the grid first. Raises MissionError if an end is off the map or in an obstacle (naming the nearest free
    point) or if there is no path.
    """
    check_ends(grid, start, goal)
    cells = _search(~grid.cells, grid.cell(start), grid.cell(goal))
    if cells is None:
        raise no_path_error(start, goal)
    return without_repeats([start, *map(grid.centre, cells), goal])


def smooth(grid: OccupancyGrid, path: Sequence[Point]) -> list[Point]:
    """Return `path` without detours that a straight line over free cells can replace.

    From each point the line goes as far along the path as is visible; the result is short, not the shortest. The ends
    do not change.
    """
    points = _densify(path, grid.resolution)
    smoothed, here = points[:1], 0
    while here < len(points) - 1:
        here = _last_visible(grid, points, here)
        smoothed.append(points[here])
    return smoothed


def _last_visible(grid: OccupancyGrid, points: list[Point], start: int) -> int:
    """Return a point visible from `start` whose successor is not; found by doubling, then by bisection."""
    last, first_hidden = start + 1, len(points)  # the next point needs no check, as it is on the path
    while first_hidden - last > 1:
        candidate = (
            min(2 * last - start, first_hidden - 1) if first_hidden == len(points) else (last + first_hidden) // 2
        )
        if grid.line_is_free(points[start], points[candidate]):
            last = candidate
        else:
            first_hidden = candidate
    return last


def path_length(path: Sequence[Sequence[float]]) -> float:
    """Return the length of a path in m."""
    return sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(path))


def check_ends(grid: OccupancyGrid, start: Point, goal: Point, names: Sequence[str] = ("start", "goal")) -> None:
    """Raise MissionError if an end of a path is off the map or in an obstacle, naming the nearest free point."""
    for point, name in zip((start, goal), names, strict=True):
        _check(grid, point, name)


def no_path_error(start: Point, goal: Point) -> NoPathError:
    """Return the error to raise if there is no path from `start` to `goal`."""
    return NoPathError(
        f"no path from {_text(start)} to {_text(goal)}: obstacles part them; lessen the margin, or the map's cells",
        "path",
    )


def without_repeats(points: list[Point]) -> list[Point]:
    """Return `points` without those that equal their predecessor."""
    return [points[0], *(b for a, b in pairwise(points) if a != b)]


def _check(grid: OccupancyGrid, point: Point, what: str) -> None:
    if grid.is_free(point):
        return
    nearest = grid.nearest_free(point)
    remedy = f"the nearest free point is {_text(nearest)}" if nearest else "the map has no free cell"
    if not grid.contains(point):
        raise NoPathError(f"the {what} {_text(point)} is outside the map; {remedy}", what)
    raise MissionError(f"the {what} {_text(point)} is inside an obstacle; {remedy}", what)


def _text(point: Point) -> str:
    return f"({point[0]:.2f} m north, {point[1]:.2f} m east)"


def _densify(path: Sequence[Point], step: float) -> list[Point]:
    points = list(path[:1])
    for (north, east), (to_north, to_east) in pairwise(path):
        parts = max(1, ceil(hypot(to_north - north, to_east - east) / step))
        for part in range(1, parts):
            share = part / parts
            points.append((north + share * (to_north - north), east + share * (to_east - east)))
        points.append((to_north, to_east))
    return points


def _search(free: NDArray[np.bool_], start: Cell, goal: Cell) -> list[Cell] | None:
    """Return the cells of a shortest path where it turns or may turn, ends included; None if there is no path."""
    jumps = Jumps(free, goal)
    source, target, width = jumps.index(start), jumps.index(goal), jumps.width
    costs, parents = {source: 0.0}, {source: source}
    queue = [(0.0, source, ALL_DIRECTIONS)]
    closed = set()
    while queue:
        _, cell, directions = heapq.heappop(queue)
        if cell == target:
            return [jumps.cell(index) for index in trace(parents, cell)]
        if cell in closed:
            continue
        closed.add(cell)
        for direction in directions:
            next_cell = jumps.next(cell, direction)
            reached = costs[cell] + _octile(cell, next_cell, width)
            if next_cell and reached < costs.get(next_cell, inf):
                costs[next_cell] = reached
                parents[next_cell] = cell
                heapq.heappush(queue, (reached + _octile(next_cell, target, width), next_cell, _ONWARD[direction]))
    return None


def _octile(a: int, b: int, width: int) -> float:
    """Return the length, in cells, of the shortest path from `a` to `b` without obstacles."""
    row, column = divmod(a, width)
    other_row, other_column = divmod(b, width)
    rows, columns = abs(row - other_row), abs(column - other_column)
    return rows + columns - _SAVING * (rows if rows < columns else columns)


def trace(parents: dict[int, int], cell: int) -> list[int]:
    """Return the cells from the start to `cell`."""
    path = [cell]
    while parents[cell] != cell:
        cell = parents[cell]
        path.append(cell)
    return path[::-1]


class Jumps:
    """Ends of moves in one direction: the next cell where a shortest path may turn, or the goal.

    Cells are numbered row by row on the map with a border of one occupied cell, so that no move has to check for the
    edge. 0, a cell of the border, means that there is no end.
    """

    def __init__(self, free: NDArray[np.bool_], goal: Cell) -> None:
        free = np.pad(free, 1)
        self.width = int(free.shape[1])
        self._goal = self.index(goal)
        self._straight: list[memoryview] = []
        first = (np.arange(free.shape[0], dtype=np.int32) * self.width)[:, None]
        numbers = np.broadcast_to(first, free.shape), np.broadcast_to(np.arange(self.width, dtype=np.int32), free.shape)
        for view in _VIEWS:
            table = np.zeros(free.shape, np.int32)
            cells, turns, (row_numbers, column_numbers) = view(free), view(table), map(view, numbers)
            for start in range(1, len(cells) - 1, STRIP_ROWS):  # in strips, to limit memory for intermediate results
                end = min(start + STRIP_ROWS, len(cells) - 1)
                index = row_numbers[start - 1 : end + 1] + column_numbers[start - 1 : end + 1]
                turns[start:end] = _next_turns(cells[start - 1 : end + 1], index, self._goal)[1:-1]
            self._straight.append(table.ravel().data)
        self._diagonal = []
        for direction in range(1, 8, 2):
            rows, columns = _DIRECTIONS[direction]
            passable = free & _ahead(free, rows, 0) & _ahead(free, 0, columns) & _ahead(free, rows, columns)
            adjacent = self._straight[direction // 2], self._straight[(direction // 2 + 1) % 4]
            self._diagonal.append((rows * self.width + columns, passable.tobytes(), *adjacent))

    def index(self, cell: Cell) -> int:
        """Return the number of a cell of the map."""
        return (cell[0] + 1) * self.width + cell[1] + 1

    def cell(self, index: int) -> Cell:
        """Return the cell with this number."""
        row, column = divmod(index, self.width)
        return row - 1, column - 1

    def next(self, cell: int, direction: int) -> int:
        """Return the end of a move from `cell`; 0 if there is none."""
        if direction % 2 == 0:
            return self._straight[direction // 2][cell]
        step, passable, first, second = self._diagonal[direction // 2]
        goal = self._goal
        while passable[cell]:
            cell += step
            if first[cell] or second[cell] or cell == goal:
                return cell
        return 0


def _next_turns(free: NDArray[np.bool_], index: NDArray[np.int32], goal: int) -> NDArray[np.int32]:
    """Return, for moves to the right, each row's next cell where a path may turn; 0 if it is blocked before.

    A path turns beside the end of an obstacle: where the lateral neighbour is free and the one before it is not.
    """
    wall = ~free
    opening = [_ahead(free, side, 0) & _ahead(wall, side, -1) for side in (-1, 1)]
    is_turn = free & (opening[0] | opening[1] | (index == goal))
    columns = np.arange(free.shape[1], dtype=np.int32)
    stops = np.where(is_turn | wall, columns, columns[-1])
    at_or_after = np.minimum.accumulate(stops[:, ::-1], axis=1)[:, ::-1]
    after = np.append(at_or_after[:, 1:], at_or_after[:, -1:], axis=1)
    turns: NDArray[np.int32] = np.take_along_axis(index * is_turn, after, axis=1)
    return turns


def _ahead(cells: NDArray[np.bool_], rows: int, columns: int) -> NDArray[np.bool_]:
    """Return the cells this many rows and columns further; those that wrap around are in the border."""
    return np.roll(cells, (-rows, -columns), axis=(0, 1))

"""Mapping from scans: update an occupancy grid with the echoes of a scanning laser or sonar.

Each cell has the logarithm of its odds of being occupied: an echo increases it, a beam that passes decreases it, and
bounds allow later changes (Moravec & Elfes, ICRA 1985; the constants are those of OctoMap, Hornung et al., Autonomous
Robots 34, 2013). Cells that were occupied at the start stay so. Errors of the vehicle's position are not modelled; they
blur the map.
"""

from collections.abc import Sequence
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.autonomy.paths.vfh import Scan

Floats = NDArray[np.floating]
Cells = tuple[NDArray[np.intp], NDArray[np.intp]]  # rows and columns

_HIT, _MISS = 0.85, -0.4
_MIN, _MAX = -2.0, 3.5


class LaserMap:
    """Map `known`, updated by scans; echoes beyond `reach` m are ignored. `grid` is the present map."""

    def __init__(self, known: OccupancyGrid, reach: float) -> None:
        self.grid = OccupancyGrid(known.cells.copy(), known.resolution, known.origin)
        self.grid.is_open = known.is_open
        self._known = known.cells
        self._odds: NDArray[np.float32] = np.zeros(known.cells.shape, np.float32)
        self._reach = reach

    def add(self, position: Sequence[float], heading: float, scan: Scan) -> NDArray[np.intp]:
        """Add a scan taken at `position` (m north, m east) and `heading` (rad from north, clockwise).

        Returns the cells (n x 2, row and column) that are newly occupied.
        """
        angles = heading + scan.first + scan.step * np.arange(len(scan.ranges))
        ranges = np.array([d if isfinite(d) and d > 0.0 else np.inf for d in scan.ranges])
        seen = ranges <= self._reach
        hits = self._cells(position, ranges[seen], angles[seen])
        self._pass_through(position, np.minimum(ranges, self._reach), angles, hits)
        self._odds[hits] = np.minimum(self._odds[hits] + _HIT, _MAX)
        occupied = self._known | (self._odds > 0.0)
        fresh = np.argwhere(occupied & ~self.grid.cells)
        self.grid.cells = occupied
        return fresh

    def block(self, center: Sequence[float], radius: float) -> None:
        """Occupy the cells within `radius` m of `center` (m north, m east) for good, whatever later scans show."""
        grid = self.grid
        rows, columns = np.indices(grid.cells.shape)
        north, east = (
            (index + 0.5) * grid.resolution + start - at
            for index, start, at in zip((rows, columns), grid.origin, center, strict=True)
        )
        self._known = self._known | (np.hypot(north, east) <= radius)
        grid.cells = grid.cells | self._known

    def _pass_through(
        self,
        position: Sequence[float],
        ranges: Floats,
        angles: Floats,
        hits: Cells,
    ) -> None:
        """Decrease the odds of the cells that beams passed, once for each scan, except those with an echo."""
        steps = np.arange(0.0, self._reach, 0.7 * self.grid.resolution)
        along, turned = np.broadcast_arrays(steps[:, None], angles)
        short = along < ranges - self.grid.resolution
        passed = np.zeros(self._odds.shape, bool)
        passed[self._cells(position, along[short], turned[short])] = True
        passed[hits] = False
        self._odds[passed] = np.maximum(self._odds[passed] + _MISS, _MIN)

    def _cells(self, position: Sequence[float], ranges: Floats, angles: Floats) -> Cells:
        """Return the cells of the map at these distances and headings, with repetitions."""
        (south, west), resolution = self.grid.origin, self.grid.resolution
        rows = np.floor((position[0] + ranges * np.cos(angles) - south) / resolution).astype(np.intp)
        columns = np.floor((position[1] + ranges * np.sin(angles) - west) / resolution).astype(np.intp)
        height, width = len(self._odds), self._odds.shape[1]
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return rows[inside], columns[inside]

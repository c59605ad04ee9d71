"""Where a vehicle fits: the seabed and what stands on it as an occupancy map."""

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.occupancy import Extent, OccupancyGrid
from hil.charts.grid import Grid
from sim.obstacles import Box, Cylinder
from sim.world import World

Array = NDArray[np.float64]

HALF_DIAGONAL = 0.7072  # cells: how far a cell's corner is from its centre


def free_water(world: World, grid: Grid, depth: float, resolution: float) -> OccupancyGrid:
    """The map for a vehicle whose lowest point is `depth` m down; cells of `resolution` m.

    A cell is occupied where the seabed at its centre is no deeper, where that is unknown, or where an obstacle that
    reaches so far up may touch any part of it; with `walls` those are the map's edge. Raises ConfigError.
    """
    south, north, west, east = grid.extent
    standing: tuple[Cylinder | Box, ...] = (*world.cylinder, *world.box)

    def clearance(norths: Array, easts: Array) -> Array:
        places = np.column_stack([norths.ravel(), easts.ravel()])
        below = grid.at(places).reshape(norths.shape) - depth
        free = np.where(below > 0.0, np.inf, -1.0)  # nan is no water
        for obstacle in standing:
            if obstacle.top < depth:
                _stand(obstacle, norths, easts, free)
        return free

    return OccupancyGrid.rasterise(
        clearance, Extent(south, west, north, east), resolution, HALF_DIAGONAL * resolution, vectorised=True
    )


def _stand(obstacle: Cylinder | Box, norths: Array, easts: Array, free: Array) -> None:
    """Lower `free` to the distance from `obstacle` in m where that may matter."""
    size = (
        obstacle.radius if isinstance(obstacle, Cylinder) else 0.5 * np.hypot(obstacle.size_north, obstacle.size_east)
    )
    reach = size + 2.0 * abs(norths[-1, 0] - norths[0, 0]) / max(1, len(norths) - 1)
    rows = slice(*np.searchsorted(norths[:, 0], (obstacle.north - reach, obstacle.north + reach)))
    columns = slice(*np.searchsorted(easts[0], (obstacle.east - reach, obstacle.east + reach)))
    x, y = norths[rows, columns] - obstacle.north, easts[rows, columns] - obstacle.east
    if isinstance(obstacle, Cylinder):
        distance = np.hypot(x, y) - obstacle.radius
    else:
        c, s = np.cos(obstacle.heading), np.sin(obstacle.heading)
        along = np.abs(c * x + s * y) - 0.5 * obstacle.size_north
        across = np.abs(c * y - s * x) - 0.5 * obstacle.size_east
        distance = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)) + np.minimum(
            np.maximum(along, across), 0.0
        )
    free[rows, columns] = np.minimum(free[rows, columns], distance)

"""Build the occupancy map of a world's seabed and obstacles at a depth."""

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.occupancy import Extent, OccupancyGrid
from hil.charts.grid import Grid
from hil.scenario.world_map import HALF_DIAGONAL, lower
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World

Array = NDArray[np.float64]


def build_occupancy(world: World, grid: Grid, depth: float, resolution: float) -> OccupancyGrid:
    """Return the map for a vehicle whose lowest point is at `depth` m, with cells of `resolution` m.

    A cell is occupied if the seabed at its centre is not below `depth` or is unknown, or if an obstacle that reaches up
    to `depth` may touch any part of it. The map ends at the extent of `grid`. Raises ConfigError.
    """
    south, north, west, east = grid.extent
    standing: tuple[Cylinder | Box, ...] = (*world.cylinder, *world.box)

    def clearance(norths: Array, easts: Array) -> Array:
        places = np.column_stack([norths.ravel(), easts.ravel()])
        below = grid.at(places).reshape(norths.shape) - depth
        free = np.where(below > 0.0, np.inf, -1.0)  # nan, an unknown depth, counts as occupied
        if world.terrain is not None:
            world.terrain.unmap()
        for obstacle in standing:
            if obstacle.top < depth:
                lower(free, obstacle, norths, easts)
        return free

    return OccupancyGrid.rasterise(
        clearance, Extent(south, west, north, east), resolution, HALF_DIAGONAL * resolution, vectorised=True
    )

"""Make the occupancy map of seabed and obstacles for a vehicle's size."""

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.occupancy import Extent, OccupancyGrid
from hil.charts.grid import Grid
from hil.scenario.world_map import HALF_DIAGONAL, lower
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World

Array = NDArray[np.float64]


def free_water(world: World, grid: Grid, depth: float, resolution: float) -> OccupancyGrid:
    """Return the map for a vehicle whose lowest point is `depth` m down; cells of `resolution` m.

    A cell is occupied where the seabed at its centre is no deeper, where that is unknown, or where an obstacle that
    reaches so far up may touch any part of it; with `walls` those are the map's edge. Raises ConfigError.
    """
    south, north, west, east = grid.extent
    standing: tuple[Cylinder | Box, ...] = (*world.cylinder, *world.box)

    def clearance(norths: Array, easts: Array) -> Array:
        places = np.column_stack([norths.ravel(), easts.ravel()])
        below = grid.at(places).reshape(norths.shape) - depth
        free = np.where(below > 0.0, np.inf, -1.0)  # nan is no water
        if world.terrain is not None:
            world.terrain.unmap()
        for obstacle in standing:
            if obstacle.top < depth:
                lower(free, obstacle, norths, easts)
        return free

    return OccupancyGrid.rasterise(
        clearance, Extent(south, west, north, east), resolution, HALF_DIAGONAL * resolution, vectorised=True
    )

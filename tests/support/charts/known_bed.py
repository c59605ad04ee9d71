"""A seabed that is known everywhere, and the soundings and contours that a chart of it would have."""

import numpy as np
from numpy.typing import NDArray

from sim.environment.relief import Fractal
from sim.environment.terrain_grid import Grid

Array = NDArray[np.float64]

SIDE, STEP = 129, 10.0


def known_bed(seed: int = 4) -> Array:
    """Return rough ground of 129 x 129 nodes, 10 m apart, mean 40 m, deviation 12 m."""
    relief = Fractal(40.0, 12.0, hurst=0.95, seed=seed, resolution=STEP)
    return np.array(relief.depths(Grid(0.0, 0.0, STEP, SIDE, SIDE))).reshape(SIDE, SIDE)


def sounded(bed: Array, count: int, seed: int = 1) -> Array:
    """Return (count, 3): north, east and depth of randomly chosen nodes."""
    nodes = np.random.default_rng(seed).choice(bed.size, count, replace=False)
    rows, columns = np.divmod(nodes, SIDE)
    return np.column_stack([rows * STEP, columns * STEP, bed[rows, columns]])


def contoured(bed: Array, levels: list[float]) -> Array:
    """Return (n, 3): points where lines between neighbouring nodes cross the levels."""
    crossings = []
    for level in levels:
        for axis in (0, 1):
            a, b = (bed[:-1], bed[1:]) if axis == 0 else (bed[:, :-1], bed[:, 1:])
            rows, columns = np.nonzero((a < level) != (b < level))
            share = (level - a[rows, columns]) / (b[rows, columns] - a[rows, columns])
            north, east = (rows + share, columns) if axis == 0 else (rows, columns + share)
            crossings.append(np.column_stack([north * STEP, east * STEP, np.full(len(rows), level)]))
    return np.concatenate(crossings)

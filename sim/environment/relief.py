"""Generated seabeds, for a world without a chart: each kind is a record of its keys.

Each kind computes the depth (m) at each node of a grid. `north` and `east` (m) are the position at which its `depth`
is given, `heading` (rad from north, clockwise) its direction, and x the distance from that position along `heading`.
"""

from array import array
from collections.abc import Callable
from math import cos, exp, pi, sin
from random import Random
from statistics import fmean, pstdev
from typing import Annotated, Any, NamedTuple

from hil.common.schema import Range
from sim.environment.terrain_grid import Edge, Grid, Resolution

Depth = Annotated[float, Range(0.1, 11_000.0, "m")]
Height = Annotated[float, Range(-1000.0, 1000.0, "m")]
Length = Annotated[float, Range(0.1, 1e5, "m")]
Heading = Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]


class Slope(NamedTuple):
    """A plane that goes down by `slope` m a metre: depth + slope x."""

    depth: Depth
    slope: Annotated[float, Range(-10.0, 10.0)]
    heading: Heading = 0.0
    north: Edge = 0.0
    east: Edge = 0.0
    resolution: Resolution = 1.0

    def depths(self, grid: Grid) -> "array[float]":
        """Return the depths (m) at the nodes."""
        return _along(self, grid, lambda x: self.depth + self.slope * x)


class Step(NamedTuple):
    """A cliff across `heading`: from x = 0 on it is `height` m shallower. The cliff is one cell wide."""

    depth: Depth
    height: Height
    heading: Heading = 0.0
    north: Edge = 0.0
    east: Edge = 0.0
    resolution: Resolution = 1.0

    def depths(self, grid: Grid) -> "array[float]":
        """Return the depths (m) at the nodes."""
        return _along(self, grid, lambda x: self.depth - self.height if x >= 0.0 else self.depth)


class Ridge(NamedTuple):
    """A ridge across `heading` with a Gaussian profile of `height` m and standard deviation `width` m.

    A negative height makes a trench.
    """

    depth: Depth
    height: Height
    width: Length
    heading: Heading = 0.0
    north: Edge = 0.0
    east: Edge = 0.0
    resolution: Resolution = 1.0

    def depths(self, grid: Grid) -> "array[float]":
        """Return the depths (m) at the nodes."""
        return _along(self, grid, lambda x: self.depth - self.height * exp(-0.5 * (x / self.width) ** 2))


class Sinusoid(NamedTuple):
    """Sand waves: depth - amplitude sin(2 pi x / wavelength)."""

    depth: Depth
    amplitude: Height
    wavelength: Length
    heading: Heading = 0.0
    north: Edge = 0.0
    east: Edge = 0.0
    resolution: Resolution = 1.0

    def depths(self, grid: Grid) -> "array[float]":
        """Return the depths (m) at the nodes."""
        return _along(self, grid, lambda x: self.depth - self.amplitude * sin(2.0 * pi / self.wavelength * x))


class Fractal(NamedTuple):
    """Rough ground: random depths with mean `depth` and standard deviation `deviation` m, determined by `seed`.

    Made by random midpoint displacement, each level 2^-hurst times the one before (Fournier, Fussell & Carpenter 1982,
    Communications of the ACM 25(6)); `hurst` 1 is smooth, 0 rugged. Another resolution gives another seabed.
    """

    depth: Depth
    deviation: Annotated[float, Range(0.0, 1000.0, "m")]
    hurst: Annotated[float, Range(0.0, 1.0)] = 0.8
    seed: Annotated[int, Range(0, 2**63 - 1)] = 0
    resolution: Resolution = 1.0

    def depths(self, grid: Grid) -> "array[float]":
        """Return the depths (m) at the nodes."""
        side = 1
        while side + 1 < max(grid.rows, grid.columns):
            side *= 2
        heights = _displaced(side, self.hurst, Random(f"{self.seed}/fractal"))
        nodes = [height for row in heights[: grid.rows] for height in row[: grid.columns]]
        mean, spread = fmean(nodes), pstdev(nodes) or 1.0
        return array("f", [self.depth - self.deviation * (height - mean) / spread for height in nodes])


KINDS: dict[str, Any] = {"slope": Slope, "step": Step, "ridge": Ridge, "sinusoid": Sinusoid, "fractal": Fractal}


def _along(relief: "Slope | Step | Ridge | Sinusoid", grid: Grid, depth: Callable[[float], float]) -> "array[float]":
    """Return the depth at every node, computed from its distance x along the relief's heading."""
    c, s = cos(relief.heading), sin(relief.heading)
    norths = [c * (grid.north_min + i * grid.resolution - relief.north) for i in range(grid.rows)]
    easts = [s * (grid.east_min + j * grid.resolution - relief.east) for j in range(grid.columns)]
    return array("f", [depth(north + east) for north in norths for east in easts])


def _displaced(side: int, hurst: float, random: Random) -> list[list[float]]:
    """Return the heights of (side + 1)² nodes by midpoint displacement (diamond-square); `side` is a power of 2."""
    nodes = [[0.0] * (side + 1) for _ in range(side + 1)]
    for i, j in ((0, 0), (0, side), (side, 0), (side, side)):
        nodes[i][j] = random.gauss(0.0, 1.0)
    step, size = side, 1.0
    while step > 1:
        half = step // 2
        for i in range(half, side, step):
            for j in range(half, side, step):
                around = (
                    nodes[i - half][j - half],
                    nodes[i - half][j + half],
                    nodes[i + half][j - half],
                    nodes[i + half][j + half],
                )
                nodes[i][j] = 0.25 * sum(around) + random.gauss(0.0, size)
        for i in range(0, side + 1, half):
            for j in range(half if i % step == 0 else 0, side + 1, step):
                near = ((i - half, j), (i + half, j), (i, j - half), (i, j + half))
                edge = [nodes[a][b] for a, b in near if 0 <= a <= side and 0 <= b <= side]
                nodes[i][j] = sum(edge) / len(edge) + random.gauss(0.0, size * 0.7071067811865476)
        step, size = half, size * 2.0**-hurst
    return nodes

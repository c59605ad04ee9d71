"""Pipelines and cables on the seabed: `[[pipeline]]` of a world's file.

[[pipeline]]
name = "outfall"
points = [[-40.0, 0.0], [0.0, 10.0], [60.0, 10.0]]   # north and east of its bends
diameter = 0.8
height = -0.2                  # a quarter of it is in the seabed

Each follows the seabed below the straight lines between its points, node by node of the grid. Only parts near a point
of interest are computed, so that a cable of 100 km costs no more than one of 100 m.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from math import ceil, floor, hypot, inf, sqrt
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3, off_line
from sim.environment.obstacles import Coordinate, Separation

Share = Annotated[float, Range(0.0, 1.0)]
Seabed = Callable[[float, float], float]
Piece = tuple[Vector3, Vector3]


class Pipeline(NamedTuple):
    """A pipeline or cable: the `points` (north, east) of its line, its outer `diameter`, and where it lies.

    `height` is the height of its lower side above the seabed; a negative value means that it is buried by that much,
    and visible as far as it is above the seabed. `colour` and `echo` are as for a `[[mesh]]`. If `hidden` it is not on
    any planner's map; `name` is for reports.
    """

    points: tuple[tuple[Coordinate, Coordinate], ...]
    diameter: Annotated[float, Range(0.005, 20.0, "m")] = 0.5
    height: Annotated[float, Range(-100.0, 1000.0, "m")] = 0.0
    kind: Literal["pipeline", "cable"] = "pipeline"
    colour: tuple[Share, Share, Share] = (0.1, 0.1, 0.1)
    echo: Annotated[float, Range(-60.0, 60.0, "dB")] = 3.0
    hidden: bool = False
    name: str = ""

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return None if len(self.points) > 1 else "points: give two or more"

    @property
    def label(self) -> str:
        """Name for messages."""
        north, east = self.points[0]
        return self.name or f"the {self.kind} from ({north:g}, {east:g})"

    @property
    def top(self) -> float:
        """A depth (m) above which it never is; its actual depth follows the seabed."""
        return -100.0

    @property
    def bottom(self) -> float:
        """A depth (m) below which it never is."""
        return inf

    @property
    def is_buried(self) -> bool:
        """True if it is completely in the seabed."""
        return self.height + self.diameter <= 0.0

    def separation(self, north: float, east: float) -> Separation:
        """Return the horizontal distance (m) from its side, and the direction away from its axis."""
        offsets = (off_line(north, east, *start, *end) for start, end in pairwise(self.points))
        distance, x, y = min((sqrt(x * x + y * y), x, y) for x, y in offsets)
        out = (x / distance, y / distance) if distance else (1.0, 0.0)
        return distance - 0.5 * self.diameter, *out

    def stretches(
        self, seabed: Seabed, spacing: float, north: float, east: float, within: float
    ) -> "Iterator[Stretch]":
        """Yield the straight parts of its line within a horizontal distance of `within` m from a position."""
        for start, end in pairwise(self.points):
            segment = self._replace(points=(start, end))
            near = segment.pieces(seabed, spacing, north, east, within + 0.5 * self.diameter)
            depths = [place[2] for piece in near for place in piece]
            if depths:  # the ends of inclined pieces are higher by less than a diameter
                yield Stretch(segment, min(depths) - self.diameter)

    def pieces(
        self, seabed: Seabed, spacing: float, north: float = 0.0, east: float = 0.0, within: float = inf
    ) -> Iterator[Piece]:
        """Yield the pieces of its axis (NED, m) within a horizontal distance of `within` m from a position.

        They go from node to node, every `spacing` m of its line or a little less. Pieces on land and pieces without
        data of the seabed are left out.
        """
        above = self.height + 0.5 * self.diameter
        for start, end in pairwise(self.points):
            along = end[0] - start[0], end[1] - start[1]
            length = hypot(*along)
            x, y = off_line(north, east, *start, *end)
            if not length or x * x + y * y > within * within:
                continue
            count = max(1, ceil(length / spacing))
            first, last = 0, count
            if within < inf:
                share = ((north - start[0]) * along[0] + (east - start[1]) * along[1]) / (length * length)
                first, last = floor((share - within / length) * count), ceil((share + within / length) * count)
            nodes = [
                (start[0] + k / count * along[0], start[1] + k / count * along[1])
                for k in range(max(first, 0), min(last, count) + 1)
            ]
            beds = [(n, e, seabed(n, e)) for n, e in nodes]
            for one, other in pairwise(beds):
                if one[2] > 0.0 and other[2] > 0.0:
                    yield (one[0], one[1], one[2] - above), (other[0], other[1], other[2] - above)

    @property
    def length(self) -> float:
        """Length of its line, m."""
        return sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(self.points))

    def drawn(self, seabed: Seabed, spacing: float, max_pieces: int = 2000) -> Iterator[Piece]:
        """Yield all of its pieces, at most about `max_pieces` of them, for plots."""
        return self.pieces(seabed, max(spacing, self.length / max_pieces))

    def route(self, seabed: Seabed, step: float, altitude: float = 0.0) -> list[Vector3]:
        """Return points (NED, m) along it about every `step` m, `altitude` m above its axis; none on land."""
        points = [point for pair in self.pieces(seabed, step) for point in pair]
        distinct = [point for k, point in enumerate(points) if not k or point != points[k - 1]]
        return [(north, east, down - altitude) for north, east, down in distinct]

    def distance(
        self, seabed: Seabed, spacing: float, north: float, east: float, highest: float, lowest: float, within: float
    ) -> float:
        """Return the horizontal distance (m) of a position from its side, where that is between two depths.

        inf if there is no such part within `within` m.
        """
        radius, least = 0.5 * self.diameter, inf
        for one, other in self.pieces(seabed, spacing, north, east, within + radius):
            if min(one[2], other[2]) - radius < lowest and max(one[2], other[2]) + radius > highest:
                least = min(least, hypot(*off_line(north, east, *one[:2], *other[:2])) - radius)
        return least


class Stretch(NamedTuple):
    """A straight part of a pipeline as an obstacle for collisions; `top` (m) is that of its part near the vehicle."""

    pipeline: Pipeline
    top: float
    bottom: float = inf

    @property
    def label(self) -> str:
        """Name for messages."""
        return self.pipeline.label

    def separation(self, north: float, east: float) -> Separation:
        """Return the horizontal distance (m) from its side, and the direction away from its axis."""
        return self.pipeline.separation(north, east)

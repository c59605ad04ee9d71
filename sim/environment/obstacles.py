"""Upright obstacles: each has a horizontal outline and reaches from its `top` down to its `bottom`, or the seabed."""

from math import cos, sin, sqrt
from typing import Annotated, Literal, NamedTuple, Protocol

from hil.common.schema import Range

Coordinate = Annotated[float, Range(-1e5, 1e5, "m")]
Length = Annotated[float, Range(0.01, 1e4, "m")]
# The depth of the upper end. The default is 100 m above the water, so that nothing passes over it.
Top = Annotated[float, Range(-100.0, 11_000.0, "m")]
# The depth of the lower end. The default is below any seabed, so that the obstacle stands on it.
STANDING = 20_000.0
Bottom = Annotated[float, Range(-100.0, STANDING, "m")]
Heading = Annotated[float, Range(-6.2832, 6.2832, "rad")]

ZoneKind = Literal["restricted", "anchorage", "dumping", "military", "cable", "pipeline", "farm"]

# Distance in m (negative inside) and the horizontal unit vector away from the obstacle, north and east.
Separation = tuple[float, float, float]


class Obstacle(Protocol):
    """Interface of every obstacle."""

    @property
    def top(self) -> float:
        """The depth of its upper end in m."""

    @property
    def bottom(self) -> float:
        """The depth of its lower end in m; below the seabed if it stands on the seabed."""

    @property
    def label(self) -> str:
        """Name for messages: its own, or its kind and position."""

    def separation(self, north: float, east: float) -> Separation:
        """Return the distance of its side from a point (m, NED), and the direction away from it."""


class Cylinder(NamedTuple):
    """A pile: the centre of its axis and its radius. With a `bottom` it hangs or floats.

    If `hidden` it is not on any planner's map; `name` is for reports.
    """

    north: Coordinate
    east: Coordinate
    radius: Length
    top: Top = -100.0
    hidden: bool = False
    name: str = ""
    bottom: Bottom = STANDING

    @property
    def label(self) -> str:
        """Name for messages."""
        return self.name or f"the pile at ({self.north:g}, {self.east:g})"

    def separation(self, north: float, east: float) -> Separation:
        """Return the distance from the side and the direction away from the axis; north on the axis itself."""
        x, y = north - self.north, east - self.east
        distance = sqrt(x * x + y * y)
        if distance == 0.0:
            return -self.radius, 1.0, 0.0
        return distance - self.radius, x / distance, y / distance


class Box(NamedTuple):
    """A block: its centre and its sizes along its own two horizontal axes, the first of which points at `heading`.

    With a `bottom` it hangs or floats. If `hidden` it is not on any planner's map; `name` is for reports.
    """

    north: Coordinate
    east: Coordinate
    size_north: Length
    size_east: Length
    heading: Heading = 0.0
    top: Top = -100.0
    hidden: bool = False
    name: str = ""
    bottom: Bottom = STANDING

    @property
    def label(self) -> str:
        """Name for messages."""
        return self.name or f"the block at ({self.north:g}, {self.east:g})"

    def separation(self, north: float, east: float) -> Separation:
        """Return the distance from the nearest side or corner and the direction away from it."""
        c, s = cos(self.heading), sin(self.heading)
        x, y = north - self.north, east - self.east
        along, across = c * x + s * y, c * y - s * x
        beyond_x, beyond_y = abs(along) - 0.5 * self.size_north, abs(across) - 0.5 * self.size_east
        if beyond_x > 0.0 and beyond_y > 0.0:
            distance = sqrt(beyond_x * beyond_x + beyond_y * beyond_y)
            out_x, out_y = beyond_x / distance, beyond_y / distance
        elif beyond_x > beyond_y:
            distance, out_x, out_y = beyond_x, 1.0, 0.0
        else:
            distance, out_x, out_y = beyond_y, 0.0, 1.0
        out_x = out_x if along >= 0.0 else -out_x
        out_y = out_y if across >= 0.0 else -out_y
        return distance, c * out_x - s * out_y, s * out_x + c * out_y


class Wall(NamedTuple):
    """One side of a pool: there is water where `inward_north` north + `inward_east` east exceeds `offset` (m)."""

    inward_north: float
    inward_east: float
    offset: float
    top: float = -100.0
    bottom: float = STANDING

    @property
    def label(self) -> str:
        """Name of the pool's side, such as "the south wall"."""
        side = ("south", "north") if self.inward_north else ("west", "east")
        return f"the {side[self.inward_north + self.inward_east < 0.0]} wall"

    def separation(self, north: float, east: float) -> Separation:
        """Return the distance from the wall, and the direction into the water."""
        distance = self.inward_north * north + self.inward_east * east - self.offset
        return distance, self.inward_north, self.inward_east

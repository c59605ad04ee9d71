"""Find contacts of a hull with a seabed that has relief: which points are in the seabed, and how deep."""

from collections.abc import Sequence
from math import ceil, inf
from typing import TYPE_CHECKING, NamedTuple

from hil.common.vectors import Vector3
from sim.environment.contact.impulses import SKIN
from sim.rotations import Rotation
from sim.vehicle.collision_shape import HullShape

if TYPE_CHECKING:
    from sim.environment.terrain import Terrain

_CACHE_RADIUS = 2.0  # m of motion until the shallowest depth around the vehicle is computed again
_SPHERES_PER_CELL = 2  # along a rod, for each cell of the grid
_MAX_SPHERES = 8  # along a rod
_SURFACE_DIRECTIONS = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))


class HullPoints(NamedTuple):
    """Points of a hull relative to its origin (m, NED): spheres x, y, z, radius, and points of their surfaces."""

    spheres: list[tuple[float, float, float, float]]
    surface: list[Vector3]


class SeabedContact:
    """The contact of the hull `shape` with `terrain`. Checked are the ends of its rods, and points between them."""

    def __init__(self, terrain: "Terrain", shape: HullShape) -> None:
        self._terrain = terrain
        self._reach = shape.reach
        self._spheres = list(shape.points)
        for i, j in shape.rods:
            start, end = shape.points[i], shape.points[j]
            length = max(abs(a - b) for a, b in zip(start, end, strict=True))
            count = min(_MAX_SPHERES, ceil(_SPHERES_PER_CELL * length * terrain.scale))
            for k in range(1, count):
                share = k / count
                x, y, z, radius = [a + share * (b - a) for a, b in zip(start, end, strict=True)]
                self._spheres.append((x, y, z, radius))
        # Within _CACHE_RADIUS m of this position the seabed is deeper than this depth.
        self._north, self._east, self._shallowest = inf, inf, 0.0

    def is_far(self, position: Sequence[float]) -> bool:
        """Return True if the seabed around is deeper than the hull can reach at any attitude: the quickest check."""
        north, east, down = position
        away_north, away_east = north - self._north, east - self._east
        if away_north * away_north + away_east * away_east > _CACHE_RADIUS * _CACHE_RADIUS:
            self._north, self._east = north, east
            self._shallowest = self._terrain.shallowest(north, east, self._reach + _CACHE_RADIUS)
        return down + self._reach < self._shallowest

    def is_clear(self, position: Sequence[float], lowest: float) -> bool:
        """Return True if the seabed around is deeper than `lowest` m, the depth of the hull's lower end."""
        if self.is_far(position) or lowest <= self._shallowest:
            return True
        return lowest <= self._terrain.shallowest(position[0], position[1], self._reach)

    def points(self, rotation: Rotation) -> HullPoints:
        """Return the hull's points at that attitude (body to world)."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        spheres, surface = [], []
        for x, y, z, radius in self._spheres:
            north, east, down = xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
            spheres.append((north, east, down, radius))
            if radius:
                surface += [
                    (north + a * radius, east + b * radius, down + c * radius) for a, b, c in _SURFACE_DIRECTIONS
                ]
            else:
                surface.append((north, east, down))
        return HullPoints(spheres, surface)

    def touches(
        self, position: Sequence[float], points: HullPoints, max_depth: float
    ) -> list[tuple[float, Vector3, Vector3]]:
        """Return the contacts: the penetration (m, along the normal), the seabed's normal, and the point (NED, m).

        A point that is deeper than `max_depth` m in the seabed is at a step of the seabed, and is left out.
        """
        north, east, down = position
        contacts: list[tuple[float, Vector3, Vector3]] = []
        for x, y, z, radius in points.spheres:
            below = down + z - self._terrain.depth(north + x, east + y)
            nx, ny, nz = normal = self._terrain.normal(north + x, east + y)
            depth = radius - below * nz  # the normal points up
            if -SKIN < depth <= max_depth:
                contacts.append((depth, normal, (x - radius * nx, y - radius * ny, z - radius * nz)))
        return contacts

    def step_at(self, position: Sequence[float], points: HullPoints, max_depth: float) -> Vector3 | None:
        """Return a surface point that is in the seabed by more than `max_depth` m; None if there is none."""
        for point in points.surface:
            below = self._depth_below(position, point)
            if below > max_depth:
                north, east = position[0] + point[0], position[1] + point[1]
                if -below * self._terrain.normal(north, east)[2] > max_depth:
                    return point
        return None

    def max_penetration(self, position: Sequence[float], points: HullPoints) -> float:
        """Return how far up (m) the hull would have to move to be above the seabed; negative if it is above."""
        return max(self._depth_below(position, point) for point in points.surface)

    def _depth_below(self, position: Sequence[float], point: Vector3) -> float:
        """Return how far (m) a point is below the seabed, measured vertically."""
        return position[2] + point[2] - self._terrain.depth(position[0] + point[0], position[1] + point[1])

"""Contact of a hull with a seabed that has relief: find the places of the hull in the seabed, and how deep they are."""

from collections.abc import Sequence
from math import ceil, inf
from typing import TYPE_CHECKING, NamedTuple

from hil.common.vectors import Vector3
from sim.environment.contact.impulses import SKIN
from sim.rotations import Rotation
from sim.vehicle.collision_shape import HullShape

if TYPE_CHECKING:
    from sim.environment.terrain import Terrain

_ROAM = 2.0  # m: half side of the square of which the shallowest seabed is stored
_PER_CELL = 2  # places along a rod for each cell of the grid
_MOST_PLACES = 8  # along a rod
_ASIDE = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))


class Places(NamedTuple):
    """Places of a hull, from its origin (m, NED): spheres with their radius, and points of its surface."""

    spheres: list[tuple[float, float, float, float]]
    points: list[Vector3]


class SeabedContact:
    """The hull `shape` over `terrain`. The ends of its rods are checked, and places between them."""

    def __init__(self, terrain: "Terrain", shape: HullShape) -> None:
        self._terrain = terrain
        self._reach = shape.reach
        self._spheres = list(shape.points)
        for i, j in shape.rods:
            start, end = shape.points[i], shape.points[j]
            length = max(abs(a - b) for a, b in zip(start, end, strict=True))
            count = min(_MOST_PLACES, ceil(_PER_CELL * length * terrain.scale))
            for k in range(1, count):
                share = k / count
                x, y, z, radius = [a + share * (b - a) for a, b in zip(start, end, strict=True)]
                self._spheres.append((x, y, z, radius))
        # Within _ROAM m of this place the seabed is nowhere as shallow as this depth.
        self._north, self._east, self._shallowest = inf, inf, 0.0

    def is_far(self, position: Sequence[float]) -> bool:
        """Return True if the seabed around is deeper than the hull can reach at any attitude: the quickest check."""
        north, east, down = position
        away_north, away_east = north - self._north, east - self._east
        if away_north * away_north + away_east * away_east > _ROAM * _ROAM:
            self._north, self._east = north, east
            self._shallowest = self._terrain.shallowest(north, east, self._reach + _ROAM)
        return down + self._reach < self._shallowest

    def is_clear(self, position: Sequence[float], lowest: float) -> bool:
        """Return True if the seabed around is deeper than `lowest` m, the depth of the hull's lower end."""
        if self.is_far(position) or lowest <= self._shallowest:
            return True
        return lowest <= self._terrain.shallowest(position[0], position[1], self._reach)

    def places(self, rotation: Rotation) -> Places:
        """Return the hull's places at that attitude (body to world)."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        spheres, points = [], []
        for x, y, z, radius in self._spheres:
            north, east, down = xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
            spheres.append((north, east, down, radius))
            if radius:
                points += [(north + a * radius, east + b * radius, down + c * radius) for a, b, c in _ASIDE]
            else:
                points.append((north, east, down))
        return Places(spheres, points)

    def touches(self, position: Sequence[float], places: Places, most: float) -> list[tuple[float, Vector3, Vector3]]:
        """Return the places in the seabed: the penetration (m, along the normal), the seabed's normal, and the place.

        A place that is deeper than `most` m in it is in a step of the seabed, and is left out.
        """
        north, east, down = position
        found: list[tuple[float, Vector3, Vector3]] = []
        for x, y, z, radius in places.spheres:
            sunk = down + z - self._terrain.depth(north + x, east + y)
            nx, ny, nz = normal = self._terrain.normal(north + x, east + y)
            depth = radius - sunk * nz  # the normal points up
            if -SKIN < depth <= most:
                found.append((depth, normal, (x - radius * nx, y - radius * ny, z - radius * nz)))
        return found

    def step_at(self, position: Sequence[float], places: Places, most: float) -> Vector3 | None:
        """Return a place that is in the seabed by more than `most` m; None if there is none."""
        for place in places.points:
            sunk = self._sunk(position, place)
            if sunk > most:
                north, east = position[0] + place[0], position[1] + place[1]
                if -sunk * self._terrain.normal(north, east)[2] > most:
                    return place
        return None

    def sunk(self, position: Sequence[float], places: Places) -> float:
        """Return how far up (m) the hull would have to move to be above the seabed; negative if it is above."""
        return max(self._sunk(position, place) for place in places.points)

    def _sunk(self, position: Sequence[float], place: Vector3) -> float:
        return position[2] + place[2] - self._terrain.depth(position[0] + place[0], position[1] + place[1])

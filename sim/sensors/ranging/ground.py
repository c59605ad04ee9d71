"""Distances to the seabed and obstacles along the beams of a velocity log or an altimeter."""

from collections.abc import Iterable, Sequence
from math import inf, nan, sqrt
from typing import TYPE_CHECKING

from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.environment.world import World
from sim.rotations import matrix
from sim.sensors.mounting import Mounting

if TYPE_CHECKING:
    from sim.rays.scene import RayScene


class Ground:
    """Finds what thin beams of a sensor hit: the seabed and the obstacles of `world`.

    `beams` are unit vectors along the body axes, `reach` (m) is their length. Casting rays is slow: where only flat
    seabed is in reach, `is_flat` is True and the sensor computes the distances itself. Rays are loaded when they are
    first needed.
    """

    def __init__(self, world: World, mounting: Mounting, beams: Iterable[Vector3], reach: float) -> None:
        self._world = world
        self._mounting = mounting
        self._mounting_distance = sqrt(sum([x * x for x in mounting.position]))
        self._beams = [x for beam in beams for x in beam]
        self._reach = reach
        self._rays: RayScene | None = None
        # Horizontal distance (m) from this position to the nearest obstacle; nan: not measured yet.
        self._north = self._east = 0.0
        self._clearance = nan if world.obstacles() else inf
        if world.terrain is not None:
            self._load_rays()

    def is_flat(self, state: State, across: float) -> bool:
        """Return whether beams that reach `across` m horizontally from their sensor can hit only flat seabed."""
        if self._world.terrain is not None:
            return False
        north, east, _ = state.position
        across += self._mounting_distance
        moved_north, moved_east = north - self._north, east - self._east
        moved = sqrt(moved_north * moved_north + moved_east * moved_east)
        if moved + across < self._clearance:
            return True
        if across - moved >= self._clearance:
            return False
        self._north, self._east, self._clearance = north, east, self._world.clearance(north, east)
        return across < self._clearance

    def ranges(self, state: State) -> Sequence[float]:
        """Return the true distance along each beam (m); inf if nothing is within reach."""
        rays = self._rays or self._load_rays()
        return rays.ranges(
            self._mounting.world_position(state), self._directions, self._reach, matrix(state.quaternion)
        )

    def _load_rays(self) -> "RayScene":
        from array import array

        from sim.rays.scene import RayScene

        self._directions = array("d", self._beams)
        self._rays = RayScene(self._world)
        return self._rays

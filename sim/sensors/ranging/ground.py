"""Distance along the beams of a velocity log or an altimeter to the seabed."""

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
    """The seabed and the obstacles of `world` under thin beams (unit vectors along the body axes) of `reach` m.

    While there is nothing but a flat seabed within reach a sensor does without rays, by a formula of its own; they are
    loaded when they are needed.
    """

    def __init__(self, world: World, mounting: Mounting, beams: Iterable[Vector3], reach: float) -> None:
        self._world = world
        self._mounting = mounting
        self._mounting_distance = sqrt(sum([x * x for x in mounting.position]))
        self._beams = [x for beam in beams for x in beam]
        self._reach = reach
        self._rays: RayScene | None = None
        # The nearest obstacle was `_clearance` m from this place: nan where none was measured yet.
        self._north = self._east = 0.0
        self._clearance = nan if world.obstacles() else inf
        if world.terrain is not None:
            self._load_rays()

    def is_flat(self, state: State, across: float) -> bool:
        """True if beams that go `across` m from above their sensor can meet nothing but a flat seabed."""
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
        """True distance along each beam in m, inf if there is nothing within reach."""
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

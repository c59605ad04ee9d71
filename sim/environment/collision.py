"""Resolve collisions of a vehicle with obstacles and the seabed.

After a step that ends inside something the vehicle is put back on its surface, and the velocity into it is
taken away by one plastic impulse, solved with the full mass matrix. In such a blow kinetic energy can only
fall, by (n'v)² / (2 n' M^-1 n), so no stiffness has to be chosen and no step is too long for it. Towards
the seabed the vehicle is put back by less than it sank in the step, so potential energy is not made either.

The vehicle counts as an upright cylinder about its origin: half the diagonal of its length and width, and
half its height each way. On relief the middle and eight places of the rim of its lower end are looked at, and it is
put back along the normal of the seabed below the one that is deepest in it; from a step (the edge of the grid, a
cell without data) back to where it came from. mesh_contact.py says how it touches meshes. Not modelled: friction,
bounce, the turn that an off-centre blow gives.
"""

from collections.abc import Sequence
from math import hypot, inf, sqrt
from typing import TYPE_CHECKING

from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.environment.obstacles import Obstacle
from sim.environment.world import World
from sim.matrices import Matrix
from sim.rotations import rotate_inverse
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.environment.mesh_contact import MeshContact
    from sim.environment.terrain import Terrain

_SLANT = sqrt(0.5)
# The middle and eight places of the rim, for a radius of 1.
_PLACES = (
    (0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0),
    (_SLANT, _SLANT), (_SLANT, -_SLANT), (-_SLANT, _SLANT), (-_SLANT, -_SLANT),
)  # fmt: skip
_ROAM = 2.0  # m: how far the shallowest seabed around is known
_PASSES = 4  # pushes a step: in a valley one gives the next
_ROUNDING = 1e-3  # m
_NEAR = 20.0  # m: obstacles farther away are left out until the vehicle has come half that far
SEABED = "the seabed"


class Footprint:
    """The lower end of a vehicle over a terrain: a disc of `radius` m, `half_height` m below the origin."""

    def __init__(self, terrain: "Terrain", radius: float, half_height: float) -> None:
        self._terrain = terrain
        self._radius = radius
        self._half_height = half_height
        self._places = [(radius * north, radius * east) for north, east in _PLACES]
        # Within _ROAM m of this place nothing reaches up to this depth.
        self._north, self._east, self._shallowest = inf, inf, 0.0

    def is_clear(self, position: Sequence[float]) -> bool:
        """True if nothing around is as shallow as the disc is deep: a quick look."""
        north, east, down = position
        away_north, away_east = north - self._north, east - self._east
        if away_north * away_north + away_east * away_east > _ROAM * _ROAM:
            self._north, self._east = north, east
            self._shallowest = self._terrain.shallowest(north, east, self._radius + _ROAM)
        return down + self._half_height <= self._shallowest

    def deepest(self, position: Sequence[float], most: float = inf) -> tuple[float, Vector3]:
        """Return the greatest depth of the disc in the seabed (m, across it), and the seabed's normal there.

        What is in by more than `most` m has come into a step, and does not count. -inf if nothing counts.
        """
        depths = [self._depth(position, place) for place in self._places]
        return max([touch for touch in depths if touch[0] <= most], default=(-inf, (0.0, 0.0, -1.0)))

    def sunk(self, position: Sequence[float]) -> float:
        """Return how far straight up in m the disc would have to go to be free; negative if it is."""
        north, east, down = position
        depth = self._terrain.depth
        return down + self._half_height - min([depth(north + x, east + y) for x, y in self._places])

    def is_in_step(self, position: Sequence[float], most: float) -> bool:
        """True if some place is in the seabed by more than `most` m."""
        return any(self._depth(position, place)[0] > most for place in self._places)

    def _depth(self, position: Sequence[float], place: tuple[float, float]) -> tuple[float, Vector3]:
        north, east = position[0] + place[0], position[1] + place[1]
        sunk = position[2] + self._half_height - self._terrain.depth(north, east)
        if sunk <= 0.0:
            return sunk, (0.0, 0.0, -1.0)
        normal = self._terrain.normal(north, east)
        return sunk * -normal[2], normal


class Contact:
    """Contact of one vehicle with one world. `touching` is that of the last step, `count` the contacts so far.

    `what` names the thing that it touched last, `impulse` (N s, body axes) is what that gave in the last step in which
    it touched something. `inverse_mass` is the inverse of M = M_RB + M_A, 6x6; it changes with what the vehicle drops.
    """

    def __init__(self, vehicle: Vehicle, world: World, inverse_mass: Matrix) -> None:
        length, width, height = vehicle.dimensions
        self.radius = 0.5 * sqrt(length * length + width * width)
        self.half_height = 0.5 * height
        self.count = 0
        self.touching = False
        self.what = ""
        self.impulse: Vector3 = (0.0, 0.0, 0.0)
        self.inverse_mass = inverse_mass
        self._seabed = world.depth
        self._footprint = Footprint(world.terrain, self.radius, self.half_height) if world.terrain else None
        self._last: Sequence[float] | None = None  # where it was free
        self._obstacles = world.upright()
        self._meshes: MeshContact | None = None
        if world.mesh or world.pipeline:
            from sim.environment import mesh_contact

            self._meshes = mesh_contact.MeshContact(world, self.radius, self.half_height)
        # Those within _NEAR m of that place, and how far all others are at least from there.
        self._near: Sequence[Obstacle] = ()
        self._near_place = (inf, inf)
        self._beyond = 0.0
        # As long as the vehicle is within `_free` m of this place it cannot touch any of them.
        self._north = self._east = 0.0
        self._free = 0.0 if world.obstacles() else inf

    def resolve(self, state: State) -> bool:
        """Move `state` out of whatever it is in; True if it was in something. A new touch counts once."""
        before, self.touching = self.touching, False
        if self._footprint is not None:
            self._resolve_terrain(self._footprint, state)
        elif state.position[2] + self.half_height > self._seabed:
            self._push(state, state.position[2] + self.half_height - self._seabed, (0.0, 0.0, -1.0), SEABED)
        if self._free < inf:
            north, east, _ = state.position
            away_north, away_east = north - self._north, east - self._east
            if away_north * away_north + away_east * away_east >= self._free * self._free:
                self._resolve_obstacles(state)
        if self.touching and not before:
            self.count += 1
        return self.touching

    def room(self) -> tuple[float, float, float, float]:
        """North and east of a place, a distance from it, and a depth (all m): where `resolve` would do nothing.

        That is less than so far from the place, with the lower end of the vehicle no deeper. -inf is no depth: after a
        touch, which the next `resolve` has to end, and over relief.
        """
        apart = self.touching or self._footprint is not None
        return self._north, self._east, self._free, -inf if apart else self._seabed

    def _resolve_terrain(self, footprint: Footprint, state: State) -> None:
        """Push the vehicle out of the seabed: out of a step the way it came, out of a slope along its normal."""
        last = self._last
        if not footprint.is_clear(state.position):
            share = inf
            if last is not None:
                share = _ROUNDING + sqrt(sum([(a - b) ** 2 for a, b in zip(state.position, last, strict=True)]))
                if footprint.is_in_step(state.position, share):
                    self._step_back(footprint, state, last, share)
            for _ in range(_PASSES):
                depth, normal = footprint.deepest(state.position, share)
                if depth <= 0.0:
                    break
                self._push(state, depth, normal, SEABED)
            if last is not None and footprint.is_in_step(state.position, share):  # a slope has pushed it there
                self._step_back(footprint, state, last, share)
                self._push(state, max(0.0, footprint.sunk(state.position)), (0.0, 0.0, -1.0), SEABED)
        self._last = tuple(state.position)

    def _step_back(self, footprint: Footprint, state: State, last: Sequence[float], share: float) -> None:
        """Move back in north, in east or in both: the first that leaves the obstacle."""
        north, east, down = state.position
        for place in ((last[0], east, down), (north, last[1], down), (last[0], last[1], down)):
            if not footprint.is_in_step(place, share):
                break
        for axis in (0, 1):
            back = place[axis] - state.position[axis]
            if back:
                normal = [0.0, 0.0, 0.0]
                normal[axis] = 1.0 if back > 0.0 else -1.0
                self._push(state, 0.0, normal, SEABED)
        state.position = list(place)

    def _resolve_obstacles(self, state: State) -> None:
        self._free = self._find_near(state)
        self._north, self._east, _ = state.position
        for obstacle in self._near:
            north, east, down = state.position
            distance, out_north, out_east = obstacle.separation(north, east)
            self._free = min(self._free, max(0.0, distance - self.radius))
            into_side, into_top = self.radius - distance, down + self.half_height - obstacle.top
            into_bottom = obstacle.bottom - (down - self.half_height)
            if into_side > 0.0 and into_top > 0.0 and into_bottom > 0.0:
                if into_side <= into_top and into_side <= into_bottom:
                    self._push(state, into_side, (out_north, out_east, 0.0), obstacle.label)
                elif into_top <= into_bottom:  # it came from above
                    self._push(state, into_top, (0.0, 0.0, -1.0), obstacle.label)
                else:
                    self._push(state, into_bottom, (0.0, 0.0, 1.0), obstacle.label)

        if self._meshes:
            self._free = min(self._free, self._resolve_meshes(self._meshes, state))

    def _resolve_meshes(self, meshes: "MeshContact", state: State) -> float:
        """Push the vehicle out of the meshes; return how far (m) it may go before it can touch one."""
        north, east, _ = state.position
        away = meshes.away(north, east) - self.radius
        for _ in range(_PASSES if away < 0.0 else 0):
            depth, normal, what = meshes.deepest(state.position)
            if depth <= 0.0:
                break
            self._push(state, depth, normal, what)
        return max(0.0, away)

    def _find_near(self, state: State) -> float:
        """Look again for what is near, once the vehicle is half out of it; return how far (m) the rest is at least."""
        north, east, _ = state.position
        (from_north, from_east), limit = self._near_place, self.radius + _NEAR
        away = hypot(north - from_north, east - from_east)
        if not away < 0.5 * _NEAR:
            apart = [(obstacle.separation(north, east)[0], obstacle) for obstacle in self._obstacles]
            self._near = [obstacle for distance, obstacle in apart if distance <= limit]
            self._near_place, away = (north, east), 0.0
            self._beyond = min([distance for distance, _ in apart if distance > limit], default=inf)
        return max(0.0, self._beyond - self.radius - away)

    def _push(self, state: State, depth: float, normal: Sequence[float], what: str) -> None:
        """Move it out of `what` by `depth` m along `normal` (NED, away from it); stop its motion against it."""
        if not self.touching:  # the first in this step
            self.impulse = (0.0, 0.0, 0.0)
        self.touching, self.what = True, what
        state.position = [x + depth * n for x, n in zip(state.position, normal, strict=True)]
        x, y, z = rotate_inverse(state.quaternion, normal)
        closing = x * state.nu[0] + y * state.nu[1] + z * state.nu[2]
        if closing >= 0.0:
            return
        answer = [row[0] * x + row[1] * y + row[2] * z for row in self.inverse_mass]  # M^-1 n
        impulse = -closing / (x * answer[0] + y * answer[1] + z * answer[2])
        state.nu = [v + impulse * a for v, a in zip(state.nu, answer, strict=True)]
        u, v, w = self.impulse
        self.impulse = (u + impulse * x, v + impulse * y, w + impulse * z)


def starts_inside(vehicle: Vehicle, world: World, position: Sequence[float]) -> bool:
    """True if a vehicle at `position` (NED, m) would touch an obstacle or the seabed."""
    length, width, height = vehicle.dimensions
    north, east, down = position
    lowest = down + 0.5 * height
    radius = 0.5 * sqrt(length * length + width * width)
    if world.terrain is not None:
        aground = Footprint(world.terrain, radius, 0.5 * height).deepest(position)[0] > 0.0
    else:
        aground = lowest > world.depth
    return aground or world.clearance(north, east, lowest, height=height) < radius

"""Resolve collisions of a vehicle with obstacles and the seabed.

When a step ends with a part of the hull inside an object, impulses are applied at the points of contact
(sim/environment/contact/impulses.py). They stop the motion into the object, with friction and restitution, and turn the
vehicle if a point is off its centre. They act at the time of the impact within the step: from then on the vehicle moves
with the new velocity. The remaining penetration is removed by the displacement with the least mass-weighted norm. So
there is no contact stiffness to choose, no step is too long, and a vehicle at rest stays at rest.

The hull has the shape of sim/vehicle/collision_shape.py: a capsule, a box or spheres, at the present attitude. Contact
with upright obstacles and the flat seabed is found anywhere on the shape; contact with relief only at the ends of its
rods and at points between them (contact/seabed.py); contact with meshes only at points of its surface
(contact/meshes.py). At a step of the seabed (the edge of the grid, a cell without data) the vehicle is moved back to
where it came from. Not modelled: a seabed or a wall that deforms, friction that resists turning about one point.
"""

from collections.abc import Sequence
from math import hypot, inf, sqrt
from typing import TYPE_CHECKING

from hil.common.vectors import Vector3
from sim import rotations
from sim.dynamics import State
from sim.environment.contact.impulses import SKIN, ApplyImpulses, Separate, Touch, apply_impulses, separate
from sim.environment.contact.solids import touches as solid_touches
from sim.environment.obstacles import Box, Cylinder, Obstacle, Wall
from sim.environment.world import World
from sim.matrices import Matrix
from sim.rotations import Rotation
from sim.vehicle.collision_shape import Collision, make_shape
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.environment.contact.meshes import MeshContact
    from sim.environment.contact.seabed import SeabedContact

_PASSES = 4  # of the position correction in a step; each one neglects the rotation of the vehicle
_ROUNDING = 1e-3  # m
_NEAR = 20.0  # m: obstacles farther away are not checked until the vehicle has moved half of this
_FAR = 500.0  # m: the distance to obstacles farther away is not computed
_TOUCHING = 2e-5  # m: a smaller gap counts as contact, because rounding would interrupt contacts otherwise
_MAX_TOUCHES = 8
_MAX_DEPTH_LEFT = 1e-6  # m of penetration that is not corrected
_MAX_TURN = 0.05  # rad by which the position correction may turn a vehicle
SEABED = "the seabed"


class Contact:
    """Contact of one vehicle with one world.

    `touching` is whether there was contact in the last step, `count` the number of contacts so far, `what` the name of
    the object touched last, and `impulse` (N s and N m s about the origin, body axes) the impulse in the last step with
    contact. `inverse_mass` is the inverse of M = M_RB + M_A, 6x6; it changes when the vehicle drops a weight. `dt` is
    the duration of a step in s, `radius` (m) the greatest distance of a point of the hull from the origin. `solvers`
    compute the impulses and the correction of the position.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        world: World,
        inverse_mass: Matrix,
        dt: float = 0.0,
        solvers: tuple[ApplyImpulses, Separate] = (apply_impulses, separate),
    ) -> None:
        keys = vehicle.collision or Collision()
        self.shape = make_shape(keys, vehicle.dimensions)
        self.radius = self.shape.reach
        self.count = 0
        self.touching = False
        self.what = ""
        self.impulse: Sequence[float] = (0.0,) * 6
        self.inverse_mass = inverse_mass
        self._friction, self._restitution = keys.friction, keys.restitution
        self._dt = dt
        self._solve_impulses, self._separate = solvers
        self._seabed = world.depth
        self._floor = world.depth - _TOUCHING
        self._relief: SeabedContact | None = None
        if world.terrain:
            from sim.environment.contact import seabed

            self._relief = seabed.SeabedContact(world.terrain, self.shape)
        # The last position and attitude without contact, and how far (m) the hull can have moved into a slope since.
        self._last: tuple[Sequence[float], Sequence[float]] | None = None
        self._max_depth = inf
        self._world = world
        self._meshes: MeshContact | None = None
        if world.mesh or world.pipeline:
            from sim.environment.contact import meshes

            self._meshes = meshes.MeshContact(world, self.shape)
        # The obstacles within _NEAR m of `_near_position`, and the least distance of all others from there.
        self._near: list[Obstacle] = []
        self._near_position = (inf, inf)
        self._beyond = 0.0
        # While the vehicle is within `_free` m of this position it cannot touch an obstacle.
        self._north = self._east = 0.0
        self._free = 0.0 if world.obstacles() else inf

    def resolve(self, state: State) -> bool:
        """Resolve the contacts of `state` and return True if there were any. A contact is counted in its first step."""
        before, self.touching = self.touching, False
        relief = self._relief
        is_far = relief is not None and relief.is_far(state.position)
        is_low = not is_far and self._is_low(state)
        if is_low or (self._free < inf and self._is_near(state)):
            self._resolve_contacts(state, relief if is_low and self._last is not None else None)
        if relief is not None:
            self._last = None if is_far else (state.position, state.quaternion)
        if self.touching and not before:
            self.count += 1
        return self.touching

    def clearance(self) -> tuple[float, float, float, float]:
        """Return where `resolve` is not needed: north, east and radius of a circle, and a depth (all m).

        While the vehicle's origin is in that circle and its lowest point is above that depth, no contact is possible.
        The depth is -inf over relief, and after a contact, because the next `resolve` has to end it.
        """
        needs_resolve = self.touching or self._relief is not None
        return self._north, self._east, self._free, -inf if needs_resolve else self._floor

    def find(self, state: State) -> list[Touch]:
        """Return the points of contact, the deepest penetration first; none if the hull is only close to an object."""
        rotation, position = rotations.matrix(state.quaternion), state.position
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        points = [
            (xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z, radius)
            for x, y, z, radius in self.shape.points
        ]
        contacts: list[tuple[float, Vector3, Vector3, str]] = []
        if self._relief is not None:
            if self._is_low(state):
                relief_points = self._relief.points(rotation)
                touches = self._relief.touches(position, relief_points, self._max_depth)
                contacts += [(*touch, SEABED) for touch in touches]
        else:
            altitude = self._seabed - position[2]
            for x, y, z, radius in points:
                depth = z + radius - altitude
                if depth > -SKIN:
                    contacts.append((depth, (0.0, 0.0, -1.0), (x, y, z + radius), SEABED))
        if self._is_near(state):
            contacts += self._find_solids(state, points, rotation)
        if not contacts or max([touch[0] for touch in contacts]) <= -_TOUCHING:
            return []
        contacts.sort(key=lambda touch: -round(touch[0] / SKIN))
        return [
            Touch(depth, _to_body(rotation, normal), _to_body(rotation, point), what)
            for depth, normal, point, what in contacts[:_MAX_TOUCHES]
        ]

    def _is_low(self, state: State) -> bool:
        """Return False if the hull cannot touch the seabed. FusedStep does the same quick check."""
        down = state.position[2]
        if self._relief is None and not down + self.radius > self._floor:
            return False
        x, y, z, radius = self.shape.extent
        a, b, c = rotations.down_axis(state.quaternion)
        lowest = down + (abs(a) * x + abs(b) * y + abs(c) * z + radius)
        if self._relief is None:
            return lowest > self._floor
        return not self._relief.is_clear(state.position, lowest + _TOUCHING)

    def _is_near(self, state: State) -> bool:
        """Return False if the hull cannot touch any obstacle."""
        if self._free == inf:
            return False
        away_north, away_east = state.position[0] - self._north, state.position[1] - self._east
        return away_north * away_north + away_east * away_east >= self._free * self._free

    def is_inside(self, state: State) -> bool:
        """Return True if the hull is inside an object by more than SKIN. A hull that rests on the seabed is not."""
        if any(touch.depth > SKIN for touch in self.find(state)):
            return True
        if self._relief is None:
            return False
        points = self._relief.points(rotations.matrix(state.quaternion))
        return self._relief.max_penetration(state.position, points) > SKIN

    def _resolve_contacts(self, state: State, relief: "SeabedContact | None") -> None:
        """Apply the impulses of all contacts and correct the position; also at steps of the seabed in `relief`."""
        self._max_depth = self._max_displacement(state)
        if relief is not None:
            self._leave_step(relief, state)
        touches = self.find(state)
        if not touches and not self.touching:
            return
        if touches:
            self._collide(state, touches)
        for _ in range(_PASSES):
            touches = self.find(state)
            if not touches or touches[0].depth <= _MAX_DEPTH_LEFT:
                break
            if not self.touching:  # there was no contact at the end of the step, but there is one after a correction
                self._apply_impulses(state, touches)
            self._correct_position(state, touches)
        if relief is not None and self._leave_step(relief, state):  # the correction at a slope has moved it there
            points = relief.points(rotations.matrix(state.quaternion))
            north, east, down = state.position
            state.position = [north, east, down - max(0.0, relief.max_penetration(state.position, points))]

    def _collide(self, state: State, touches: Sequence[Touch]) -> None:
        """Apply the impulses at the time of the impact, and repeat the rest of the step with the new velocity."""
        before, since = state.nu, 0.0
        for touch in touches:
            closing = -_speed(touch, before)
            if closing > 0.0 and touch.depth > 0.0:
                since = max(since, touch.depth / closing)
        since = min(since, self._dt)
        if self._restitution and since:  # the velocity gained after the impact has no restitution
            gained = [since * x for x in state.nu_dot]
            state.nu = [a - b for a, b in zip(before, gained, strict=True)]
            self._apply_impulses(state, touches)
            state.nu = [a + b for a, b in zip(state.nu, gained, strict=True)]
            self._apply_impulses(state, touches, 0.0)
        else:
            self._apply_impulses(state, touches)
        if since:
            self._move(state, [since * (a - b) for a, b in zip(state.nu, before, strict=True)])

    def _apply_impulses(self, state: State, touches: Sequence[Touch], max_restitution: float = 1.0) -> None:
        """Stop the motion into the touched objects, with a restitution of at most `max_restitution`."""
        if not self.touching:  # the first contact in this step
            self.impulse = (0.0,) * 6
        self.touching, self.what = True, touches[0].what
        state.nu, impulse = self._solve_impulses(
            touches, self.inverse_mass, state.nu, self._friction, min(self._restitution, max_restitution)
        )
        self.impulse = [a + b for a, b in zip(self.impulse, impulse, strict=True)]

    def _correct_position(self, state: State, touches: Sequence[Touch]) -> None:
        shift = self._separate(touches, self.inverse_mass)
        if max(map(abs, shift[3:])) > _MAX_TURN:  # motion cannot bring it so deep: the vehicle was placed there
            depth, normal = touches[0][:2]
            shift = [*(depth * x for x in normal), 0.0, 0.0, 0.0]
        self._move(state, shift)

    def _move(self, state: State, shift: Sequence[float]) -> None:
        """Move and turn the vehicle by `shift` (3 numbers in m, 3 in rad, body axes)."""
        moved = rotations.rotate(state.quaternion, shift[:3])
        state.position = [a + b for a, b in zip(state.position, moved, strict=True)]
        if any(shift[3:]):
            state.quaternion = rotations.integrate(state.quaternion, shift[3:], 1.0)

    def _max_displacement(self, state: State) -> float:
        """Return the greatest distance (m) a point of the hull can have moved since it was last without contact."""
        if self._last is None:
            return inf
        position, quaternion = self._last
        shift = sqrt(sum([(a - b) ** 2 for a, b in zip(state.position, position, strict=True)]))
        turn = sqrt(sum([(a - b) ** 2 for a, b in zip(state.quaternion, quaternion, strict=True)]))
        return _ROUNDING + shift + 2.0 * turn * self.radius

    def _leave_step(self, relief: "SeabedContact", state: State) -> bool:
        """Move the hull out of a step of the seabed; return True if it was in one.

        It tries the last north, the last east, and both; then the last position and attitude without contact.
        """
        assert self._last is not None
        rotation = rotations.matrix(state.quaternion)
        points = relief.points(rotation)
        hit = relief.step_at(state.position, points, self._max_depth)
        if hit is None:
            return False
        last, attitude = self._last
        north, east, down = state.position
        for position in ((last[0], east, down), (north, last[1], down), (last[0], last[1], down)):
            if relief.step_at(position, points, self._max_depth) is None:
                break
        else:
            position = last[0], last[1], last[2]
            state.quaternion = attitude
            state.nu = [0.0] * 6
        lever = _to_body(rotation, hit)
        self.touching, self.what = True, SEABED
        for axis in (0, 1):
            back = position[axis] - state.position[axis]
            if back:
                normal = [0.0, 0.0, 0.0]
                normal[axis] = 1.0 if back > 0.0 else -1.0
                self._apply_impulses(state, [Touch(0.0, _to_body(rotation, normal), lever, SEABED)])
        state.position = list(position)
        return True

    def _find_solids(
        self, state: State, points: Sequence[tuple[float, float, float, float]], rotation: Rotation
    ) -> list[tuple[float, Vector3, Vector3, str]]:
        """Return the contacts with obstacles; update how far the vehicle can move before another one is possible."""
        self._free = self._find_near(state)
        position = self._north, self._east, down = state.position
        contacts: list[tuple[float, Vector3, Vector3, str]] = []
        needs_rays = False
        for obstacle in self._near:
            away = obstacle.separation(self._north, self._east)[0] - self.radius
            self._free = min(self._free, max(0.0, away))
            if away < 0.0 and down + self.radius > obstacle.top and down - self.radius < obstacle.bottom:
                if not isinstance(obstacle, (Cylinder, Box, Wall)):
                    needs_rays = True
                    continue
                touches = solid_touches(obstacle, self.shape, position, points)
                contacts += [(*touch, obstacle.label) for touch in touches]
        if needs_rays:
            assert self._meshes
            contacts += self._meshes.touches(position, rotation)
        return contacts

    def _find_near(self, state: State) -> float:
        """Update the list of near obstacles if needed; return a lower bound (m) of the distance to all others."""
        north, east, _ = state.position
        (from_north, from_east), limit = self._near_position, self.radius + _NEAR
        away = hypot(north - from_north, east - from_east)
        if not away < 0.5 * _NEAR:
            world = self._world
            candidates = world.within(north, east, _FAR)
            distances = [(one.separation(north, east)[0], one) for one in (*candidates, *world.mesh)]
            self._near = [obstacle for distance, obstacle in distances if distance <= limit]
            self._near_position, away = (north, east), 0.0
            self._beyond = min([distance for distance, _ in distances if distance > limit], default=inf)
            if len(candidates) < len(world.upright()):
                self._beyond = min(self._beyond, _FAR)
            for pipeline in world.pipeline:
                distance = pipeline.separation(north, east)[0]
                if distance <= limit:
                    self._near += pipeline.stretches(world.seabed, world.spacing(), north, east, limit)
                self._beyond = min(self._beyond, max(limit, distance))
        return max(0.0, self._beyond - self.radius - away)


def _speed(touch: Touch, nu: Sequence[float]) -> float:
    """Return the speed (m/s) at which a point of contact moves away from the touched object."""
    (a, b, c), (x, y, z), (u, v, w, p, q, r) = touch.normal, touch.lever, nu
    return a * (u + q * z - r * y) + b * (v + r * x - p * z) + c * (w + p * y - q * x)


def _to_body(rotation: Rotation, world: Sequence[float]) -> Vector3:
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
    x, y, z = world
    return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


def starts_inside(
    vehicle: Vehicle, world: World, position: Sequence[float], quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
) -> bool:
    """True if a vehicle at `position` (NED, m), attitude w x y z (body to world) is in an obstacle or the seabed."""
    return Contact(vehicle, world, []).is_inside(State(position, quaternion))

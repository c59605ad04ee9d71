"""What keeps a vehicle out of obstacles and the seabed.

After a step that ends inside something the vehicle is put back on its surface, and the velocity into it is
taken away by one plastic impulse, solved with the full mass matrix. In such a blow kinetic energy can only
fall, by (n'v)² / (2 n' M^-1 n), so no stiffness has to be chosen and no step is too long for it. Towards
the seabed the vehicle is put back by less than it sank in the step, so potential energy is not made either.

The vehicle counts as an upright cylinder about its origin: half the diagonal of its length and width, and
half its height each way. Not modelled: friction, bounce, the turn that an off-centre blow gives.
"""

from collections.abc import Sequence
from math import inf, sqrt

from sim.dynamics import State
from sim.matrices import Matrix
from sim.rotations import rotate_inverse
from sim.vehicle import Vehicle
from sim.world import World


class Contact:
    """Keeps one vehicle out of one world. `touching` tells the last step, `count` the blows so far.

    `inverse_mass` is the inverse of M = M_RB + M_A, 6x6; it changes with what the vehicle drops.
    """

    def __init__(self, vehicle: Vehicle, world: World, inverse_mass: Matrix) -> None:
        length, width, height = vehicle.dimensions
        self.radius = 0.5 * sqrt(length * length + width * width)
        self.half_height = 0.5 * height
        self.count = 0
        self.touching = False
        self.inverse_mass = inverse_mass
        self._seabed = world.depth
        self._obstacles = world.obstacles()
        # As long as the vehicle is within `_free` m of this place it cannot touch anything.
        self._north = self._east = 0.0
        self._free = 0.0 if self._obstacles else inf

    def resolve(self, state: State) -> bool:
        """Move `state` out of whatever it is in; True if it was in something. A new touch counts once."""
        before, self.touching = self.touching, False
        sunk = state.position[2] + self.half_height - self._seabed
        if sunk > 0.0:
            self._push(state, sunk, (0.0, 0.0, -1.0))
        north, east, _ = state.position
        away_north, away_east = north - self._north, east - self._east
        if away_north * away_north + away_east * away_east >= self._free * self._free:
            self._resolve_obstacles(state)
        if self.touching and not before:
            self.count += 1
        return self.touching

    def _resolve_obstacles(self, state: State) -> None:
        self._free = inf
        self._north, self._east, _ = state.position
        for obstacle in self._obstacles:
            north, east, down = state.position
            distance, out_north, out_east = obstacle.separation(north, east)
            self._free = min(self._free, max(0.0, distance - self.radius))
            into_side, into_top = self.radius - distance, down + self.half_height - obstacle.top
            if into_side > 0.0 and into_top > 0.0:
                if into_top < into_side:  # it came from above
                    self._push(state, into_top, (0.0, 0.0, -1.0))
                else:
                    self._push(state, into_side, (out_north, out_east, 0.0))

    def _push(self, state: State, depth: float, normal: Sequence[float]) -> None:
        """Out by `depth` m along `normal` (NED, away from the obstacle), and no velocity against it."""
        self.touching = True
        state.position = [x + depth * n for x, n in zip(state.position, normal, strict=True)]
        x, y, z = rotate_inverse(state.quaternion, normal)
        closing = x * state.nu[0] + y * state.nu[1] + z * state.nu[2]
        if closing >= 0.0:
            return
        answer = [row[0] * x + row[1] * y + row[2] * z for row in self.inverse_mass]  # M^-1 n
        impulse = -closing / (x * answer[0] + y * answer[1] + z * answer[2])
        state.nu = [v + impulse * a for v, a in zip(state.nu, answer, strict=True)]


def starts_inside(vehicle: Vehicle, world: World, position: Sequence[float]) -> bool:
    """True if a vehicle at `position` (NED, m) would touch an obstacle or the seabed."""
    length, width, height = vehicle.dimensions
    north, east, down = position
    lowest = down + 0.5 * height
    radius = 0.5 * sqrt(length * length + width * width)
    return lowest > world.depth or world.clearance(north, east, lowest) < radius

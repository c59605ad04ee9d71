"""Buoyancy of a hull that may be partly out of the water.

The displaced volume is distributed over eight points in two layers of four. Their positions are chosen so that the
water plane has the same second moments as that of a box of the vehicle's size. Each point is a short column that fills
in proportion to its depth. So the buoyancy is continuous, its centre moves to the part under water, and a tilted hull
rights itself. The force of a point depends only on its own depth, hence it has a potential: energy is conserved. For a
level hull the buoyancy is exactly that of a box.

Waves and density layers are added by sim/environment/stratification.py. Not modelled: the hull's true form, loss of
added mass and damping out of the water.
"""

from math import sqrt
from typing import TYPE_CHECKING

from sim.rotations import Rotation
from sim.vehicle.vehicle import Vehicle, displaced_volume

if TYPE_CHECKING:
    from sim.forces import Buoyancy


class Hull:
    """The buoyancy of one vehicle in water of `density` kg/m³ under `gravity` m/s².

    `points` are the eight points (m, body axes), `full` is the buoyancy of the submerged hull (N). The hull is
    submerged in any attitude if its origin is at least `reach` m deep.
    """

    def __init__(self, vehicle: Vehicle, density: float, gravity: float) -> None:
        length, width, height = vehicle.dimensions
        x, y, z = vehicle.center_of_buoyancy
        along, across, up = length / sqrt(12.0), width / sqrt(12.0), 0.25 * height
        self.points = [
            (x + i * along, y + j * across, z + k * up) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)
        ]  # fmt: skip
        self.full = density * gravity * displaced_volume(vehicle, density)
        self._share = self.full / len(self.points)
        self._filling = 0.5 / up
        self._submerged: Buoyancy = (self.full, self.full * x, self.full * y, self.full * z)
        self.reach = up + max(sqrt(a * a + b * b + c * c) for a, b, c in self.points)

    def numbers(self) -> list[float]:
        """Return all numbers that `buoyancy` uses: points, share of each, filling, submerged buoyancy, reach."""
        points = [x for point in self.points for x in point]
        return [*points, self._share, self._filling, *self._submerged, self.reach]

    def buoyancy(self, depth: float, rotation: Rotation) -> "Buoyancy":
        """Return the buoyancy (N), and it times its centre (N m, body axes), with the origin at `depth` m."""
        if depth >= self.reach:
            return self._submerged
        _, _, _, _, _, _, zx, zy, zz = rotation
        total = total_x = total_y = total_z = 0.0
        for x, y, z in self.points:
            filled = 0.5 + self._filling * (depth + zx * x + zy * y + zz * z)
            if filled <= 0.0:
                continue
            force = self._share if filled >= 1.0 else self._share * filled
            total += force
            total_x += force * x
            total_y += force * y
            total_z += force * z
        return total, total_x, total_y, total_z

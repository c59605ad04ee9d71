"""Buoyancy of a hull that may be partly out of the water.

The displaced volume is spread over eight points, two layers of four, at the places where a box of the
vehicle's size has the same second moments of its water plane. Each point is a short column that fills in
proportion to its depth. So lift is continuous, the centre of buoyancy moves to the part under water, a
tilted hull rights itself, and as the lift of a point depends on its own depth alone there is a potential:
energy is neither made nor lost. For a level hull the lift is exactly that of a box.

Waves and layers come on top (sim/environment/stratification.py). Not modelled: the hull's true form, loss of added
mass and
damping out of the water.
"""

from math import sqrt
from typing import TYPE_CHECKING

from sim.rotations import Rotation
from sim.vehicle.vehicle import Vehicle, displaced_volume

if TYPE_CHECKING:
    from sim.forces import Lift


class Hull:
    """The lift on one vehicle in water of `density` kg/m³ under `gravity` m/s²; all of it from `reach` m down."""

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
        self._submerged: Lift = (self.full, self.full * x, self.full * y, self.full * z)
        self.reach = up + max(sqrt(a * a + b * b + c * c) for a, b, c in self.points)

    def numbers(self) -> list[float]:
        """Return all that `lift` uses, in a row: points, share of each, filling, lift when submerged, reach."""
        points = [x for point in self.points for x in point]
        return [*points, self._share, self._filling, *self._submerged, self.reach]

    def lift(self, depth: float, rotation: Rotation) -> "Lift":
        """Return lift (N), and lift times the centre of buoyancy (N m, body axes), with the origin at `depth` m."""
        if depth >= self.reach:
            return self._submerged
        _, _, _, _, _, _, zx, zy, zz = rotation
        lift = lift_x = lift_y = lift_z = 0.0
        for x, y, z in self.points:
            filled = 0.5 + self._filling * (depth + zx * x + zy * y + zz * z)
            if filled <= 0.0:
                continue
            part = self._share if filled >= 1.0 else self._share * filled
            lift += part
            lift_x += part * x
            lift_y += part * y
            lift_z += part * z
        return lift, lift_x, lift_y, lift_z

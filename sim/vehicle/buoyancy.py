"""Buoyancy of a hull that may be partly out of the water.

The hull is a closed surface of triangles (sim/vehicle/hull_form.py): a box of the vehicle's dimensions unless its file
describes another form. The water surface is a plane. The triangles are cut at it, and the volume below is a sum of
tetrahedra: each part of a triangle under water, with a common corner in the plane, so that the cut itself needs no
lid. Volume and centre are exact for the form, at any attitude and immersion. So the buoyancy is continuous, and it has
a potential: energy is conserved.

The form is placed with its centroid in the centre of buoyancy and its lift is scaled, so that the submerged hull
displaces exactly the vehicle's volume, of which an open frame has less than its box.

Waves and density layers are added by sim/environment/stratification.py. Not modelled: loss of added mass and damping
out of the water.
"""

from collections.abc import Sequence
from math import sqrt
from typing import TYPE_CHECKING

from sim.vehicle.hull_form import make_triangles
from sim.vehicle.vehicle import Vehicle, displaced_volume

if TYPE_CHECKING:
    from sim.forces import Buoyancy

Corner = tuple[float, float, float]


class Hull:
    """The buoyancy of one vehicle in water of `density` kg/m³ under `gravity` m/s².

    `triangles` are nine numbers each: three corners (m, body axes), counterclockwise from outside. `full` is the
    buoyancy of the submerged hull (N), `submerged` what `buoyancy` returns for it. The hull is submerged in any
    attitude if its origin is at least `reach` m deep.
    """

    def __init__(self, vehicle: Vehicle, density: float, gravity: float) -> None:
        x, y, z = vehicle.center_of_buoyancy
        form = make_triangles(vehicle.hull, vehicle.dimensions)
        volume, (a, b, c) = volume_and_centroid(form)
        move = (x - a, y - b, z - c) * 3
        self.triangles = [tuple([p + d for p, d in zip(row, move, strict=True)]) for row in form]
        self.full = density * gravity * displaced_volume(vehicle, density)
        self._scale = self.full / (6.0 * volume)
        self.submerged: Buoyancy = (self.full, self.full * x, self.full * y, self.full * z)
        self.reach = max(sqrt(r[i] ** 2 + r[i + 1] ** 2 + r[i + 2] ** 2) for r in self.triangles for i in (0, 3, 6))

    def numbers(self) -> list[float]:
        """Return the numbers that `buoyancy` uses besides the triangles: scale, submerged buoyancy, reach."""
        return [self._scale, *self.submerged, self.reach]

    def buoyancy(self, depth: float, down: Sequence[float]) -> "Buoyancy":
        """Return the buoyancy (N), and it times its centre (N m, body axes), with the origin at `depth` m.

        `down` is the gradient of the depth below the surface along the body axes: the world's down axis for calm
        water, whose length is 1; with the slopes of a wave added for a sloping surface.
        """
        nx, ny, nz = down
        square = nx * nx + ny * ny + nz * nz
        if depth > 0.0 and depth * depth >= self.reach * self.reach * square:
            return self.submerged
        lean = -depth / square
        px, py, pz = lean * nx, lean * ny, lean * nz  # the point of the surface next to the origin
        total = total_x = total_y = total_z = 0.0
        for row in self.triangles:
            heights = [depth + nx * row[i] + ny * row[i + 1] + nz * row[i + 2] for i in (0, 3, 6)]
            for (ax, ay, az), (bx, by, bz), (cx, cy, cz) in _wet_parts(row, *heights):
                ux, uy, uz = bx - px, by - py, bz - pz
                vx, vy, vz = cx - px, cy - py, cz - pz
                part = (
                    (ax - px) * (uy * vz - uz * vy) + (ay - py) * (uz * vx - ux * vz) + (az - pz) * (ux * vy - uy * vx)
                )
                total += part
                total_x += part * (ax + bx + cx + px)
                total_y += part * (ay + by + cy + py)
                total_z += part * (az + bz + cz + pz)
        quarter = 0.25 * self._scale
        return self._scale * total, quarter * total_x, quarter * total_y, quarter * total_z


def volume_and_centroid(triangles: Sequence[Sequence[float]]) -> tuple[float, Corner]:
    """Return the volume (m³) inside closed `triangles`, nine numbers each, and its centroid (m)."""
    total = total_x = total_y = total_z = 0.0
    for ax, ay, az, bx, by, bz, cx, cy, cz in triangles:
        part = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        total += part
        total_x += part * (ax + bx + cx)
        total_y += part * (ay + by + cy)
        total_z += part * (az + bz + cz)
    return total / 6.0, (0.25 * total_x / total, 0.25 * total_y / total, 0.25 * total_z / total)


def _wet_parts(row: Sequence[float], ha: float, hb: float, hc: float) -> list[tuple[Corner, Corner, Corner]]:
    """Return the part of a triangle under water as up to two triangles; `ha` ... are the depths of its corners (m)."""
    if ha <= 0.0 and hb <= 0.0 and hc <= 0.0:
        return []
    a, b, c = (row[0], row[1], row[2]), (row[3], row[4], row[5]), (row[6], row[7], row[8])
    if ha >= 0.0 and hb >= 0.0 and hc >= 0.0:
        return [(a, b, c)]
    # Turned so that `a` is the only corner under water, or the only one above it.
    if (hb > 0.0) != (ha > 0.0) and (hb > 0.0) != (hc > 0.0):
        a, b, c, ha, hb, hc = b, c, a, hb, hc, ha
    elif (hc > 0.0) != (ha > 0.0) and (hc > 0.0) != (hb > 0.0):
        a, b, c, ha, hb, hc = c, a, b, hc, ha, hb
    ab, ac = _crossing(a, b, ha, hb), _crossing(a, c, ha, hc)
    return [(a, ab, ac)] if ha > 0.0 else [(ab, b, c), (ab, c, ac)]


def _crossing(a: Corner, b: Corner, ha: float, hb: float) -> Corner:
    """Return the point of the edge from `a` to `b` that lies in the surface."""
    share = ha / (ha - hb)
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])

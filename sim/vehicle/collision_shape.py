"""The shape of a hull for collisions: points and rods, each with a radius, in body axes.

[collision]                # a table of the vehicle's file; all keys have defaults
shape = "capsule"          # a cylinder along x with round ends; "box"; or "spheres", with:
spheres = [[0.6, 0.0, 0.0, 0.1], [-0.6, 0.0, 0.0, 0.1]]    # x, y, z, radius in m
friction = 0.4
restitution = 0.2

Without `shape` the shape follows from the vehicle's `dimensions`: a hull at least three times as long as it is wide and
high is a capsule, any other one a box. A box consists of its twelve edges, and of capsules along x inside of them that
are as high as the box (or as wide, if it is higher than wide). Not modelled: fins, propellers, openings of a frame.
"""

from math import ceil, sqrt
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range

Coordinate = Annotated[float, Range(-25.0, 25.0, "m")]
Radius = Annotated[float, Range(0.0, 25.0, "m")]
_CAPSULE_RATIO = 3.0  # length over thickness from which a hull is a capsule
_MAX_SPHERES = 32


class Collision(NamedTuple):
    """The keys of the [collision] table of a vehicle's file: see the top of this module.

    `friction` is Coulomb's coefficient, for sliding and sticking, against every surface. `restitution` is the share of
    the closing speed that remains, reversed, after a collision. The defaults are assumptions: wet plastic or steel on
    sand or concrete has a friction of 0.3 to 0.6, and the restitution under water is less than in air.
    """

    shape: Literal["auto", "capsule", "box", "spheres"] = "auto"
    spheres: tuple[tuple[Coordinate, Coordinate, Coordinate, Radius], ...] = ()
    friction: Annotated[float, Range(0.0, 10.0)] = 0.4
    restitution: Annotated[float, Range(0.0, 1.0)] = 0.2

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if (self.shape == "spheres") != bool(self.spheres):
            return 'spheres: give them with shape = "spheres", and only then'
        if len(self.spheres) > _MAX_SPHERES:
            return f"spheres: {len(self.spheres)} are more than {_MAX_SPHERES}: take fewer and larger ones"
        return None


class HullShape(NamedTuple):
    """A collision shape: points x, y, z with a radius (m, body axes), and rods between two points of equal radius.

    A rod is two indices of `points`. `reach` (m) is the radius of a sphere about the origin that contains the shape.
    `extent` is a rounded box about the origin that contains it: three half sizes and the rounding radius (m). Along a
    unit vector n the shape extends no farther than |n_x| x + |n_y| y + |n_z| z + radius.
    """

    points: tuple[tuple[float, float, float, float], ...]
    rods: tuple[tuple[int, int], ...]
    reach: float
    extent: tuple[float, float, float, float]


def make_shape(collision: Collision, dimensions: tuple[float, float, float]) -> HullShape:
    """Return the shape of a hull of length, width and height `dimensions` (m)."""
    length, width, height = dimensions
    kind = collision.shape
    if kind == "auto":
        kind = "capsule" if length >= _CAPSULE_RATIO * max(width, height) else "box"
    if kind == "spheres":
        return _shape(list(collision.spheres), [])
    radius = 0.5 * max(width, height)
    if kind == "capsule":
        half = max(0.0, 0.5 * length - radius)
        return _shape([(half, 0.0, 0.0, radius), (-half, 0.0, 0.0, radius)], [(0, 1)])
    return _box(0.5 * length, 0.5 * width, 0.5 * height)


def _box(x: float, y: float, z: float) -> HullShape:
    """Return a box of these half sizes in m."""
    signs = (-1.0, 1.0)
    points = [(a * x, b * y, c * z, 0.0) for a in signs for b in signs for c in signs]
    rods = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    radius = min(x, y, z)
    count = ceil(max(y, z) / radius)
    for k in range(count):
        off = (2.0 * k / (count - 1) - 1.0) * (max(y, z) - radius) if count > 1 else 0.0
        across, down = (off, 0.0) if y >= z else (0.0, off)
        rods.append((len(points), len(points) + 1))
        points += [(x - radius, across, down, radius), (radius - x, across, down, radius)]
    return _shape(points, rods)


def _shape(points: list[tuple[float, float, float, float]], rods: list[tuple[int, int]]) -> HullShape:
    reach = max(sqrt(x * x + y * y + z * z) + r for x, y, z, r in points)
    radii = {r for *_, r in points}
    common = radii.pop() if len(radii) == 1 else 0.0
    sizes = [max(abs(point[axis]) + point[3] - common for point in points) for axis in range(3)]
    return HullShape(tuple(points), tuple(rods), reach, (sizes[0], sizes[1], sizes[2], common))

"""Find contacts of a hull with one upright obstacle: which of its points and rods penetrate it."""

from collections.abc import Iterator, Sequence
from math import sqrt

from hil.common.vectors import Vector3
from sim.environment.contact.impulses import SKIN
from sim.environment.obstacles import Obstacle
from sim.vehicle.collision_shape import HullShape

_BISECTIONS = 8  # of a rod, in the search for its deepest point
_MIN_DIFFERENCE = 1e-4  # m: a point between the ends of a rod counts if it is deeper than both by this

Sphere = tuple[float, float, float, float]  # from the origin of the vehicle, NED in m, and a radius
Surface = tuple[float, float, float, float]  # distance (m, negative inside) and the unit vector outwards, NED


def distance_to(obstacle: Obstacle, north: float, east: float, down: float) -> Surface:
    """Return the distance of a point (NED, m) from an obstacle, and the direction out of it."""
    side, out_north, out_east = obstacle.separation(north, east)
    above, below = obstacle.top - down, down - obstacle.bottom
    end, up = (above, -1.0) if above >= below else (below, 1.0)
    if side > 0.0 and end > 0.0:
        distance = sqrt(side * side + end * end)
        return distance, out_north * side / distance, out_east * side / distance, up * end / distance
    return (side, out_north, out_east, 0.0) if side >= end else (end, 0.0, 0.0, up)


def touches(
    obstacle: Obstacle, shape: HullShape, position: Sequence[float], points: Sequence[Sphere]
) -> Iterator[tuple[float, Vector3, Vector3]]:
    """Yield each contact of the hull with the obstacle: penetration (m, along the normal), normal, point (m, NED).

    `points` are those of `shape` relative to the origin, along NED. An obstacle is convex, so along a rod the distance
    to it has one minimum, which is found by bisection.
    """
    north, east, down = position
    surfaces = [distance_to(obstacle, north + x, east + y, down + z) for x, y, z, _ in points]
    for point, surface in zip(points, surfaces, strict=True):
        if surface[0] < point[3] + SKIN:
            yield _touch(point, surface)
    for i, j in shape.rods:
        start, end, radius = surfaces[i], surfaces[j], points[i][3]
        along = [b - a for a, b in zip(points[i][:3], points[j][:3], strict=True)]
        length = sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2])
        if start[0] + end[0] - length >= 2.0 * radius or not (_slope(start, along) < 0.0 < _slope(end, along)):
            continue
        low, high = 0.0, 1.0
        for _ in range(_BISECTIONS):
            share = 0.5 * (low + high)
            x, y, z = [a + share * b for a, b in zip(points[i], along, strict=False)]
            surface = distance_to(obstacle, north + x, east + y, down + z)
            low, high = (share, high) if _slope(surface, along) < 0.0 else (low, share)
        if surface[0] < radius and surface[0] < min(start[0], end[0]) - _MIN_DIFFERENCE:
            yield _touch((x, y, z, radius), surface)


def _slope(surface: Surface, along: Sequence[float]) -> float:
    return surface[1] * along[0] + surface[2] * along[1] + surface[3] * along[2]


def _touch(point: Sphere, surface: Surface) -> tuple[float, Vector3, Vector3]:
    x, y, z, radius = point
    distance, a, b, c = surface
    return radius - distance, (a, b, c), (x - radius * a, y - radius * b, z - radius * c)

"""How a vehicle floats at rest: draught, water plane, trim and metacentric heights, from its hull's form."""

from collections.abc import Sequence
from math import cos, sin
from typing import NamedTuple

from sim.vehicle.buoyancy import Hull
from sim.vehicle.vehicle import Vehicle

_TILT = 1e-4  # rad


class Afloat(NamedTuple):
    """A vehicle afloat: `depth` of its origin and `draught` (m), area of its `waterplane` (m²), `trim` (rad, bow up).

    `metacentres` are the heights (m) of the metacentre for roll and pitch above the centre of gravity.
    """

    depth: float
    draught: float
    waterplane: float
    trim: float
    metacentres: tuple[float, float]


def afloat(vehicle: Vehicle, density: float, gravity: float) -> Afloat | None:
    """Return how `vehicle` floats upright in water of `density` kg/m³ under `gravity` m/s²; None if it does not."""
    hull, weight = Hull(vehicle, density, gravity), vehicle.mass * gravity
    if not weight < hull.full:
        return None

    def righting(down: Sequence[float]) -> tuple[float, float]:
        """Return the moments (N m) about the roll and pitch axes at the depth where the lift is the weight."""
        _, *lifts = hull.buoyancy(_depth(hull, weight, down), down)
        a, b, c = (weight * g - lift for g, lift in zip(vehicle.center_of_gravity, lifts, strict=True))
        return b * down[2] - c * down[1], c * down[0] - a * down[2]

    level = (0.0, 0.0, 1.0)
    depth, (_, pitch) = _depth(hull, weight, level), righting(level)
    steps = righting((0.0, sin(_TILT), cos(_TILT)))[0], righting((-sin(_TILT), 0.0, cos(_TILT)))[1] - pitch
    heights = -steps[0] / (weight * _TILT), -steps[1] / (weight * _TILT)
    lifts = [hull.buoyancy(depth + side * _TILT, level)[0] for side in (-1.0, 1.0)]
    return Afloat(
        depth,
        depth + max(row[i] for row in hull.triangles for i in (2, 5, 8)),
        (lifts[1] - lifts[0]) / (2.0 * _TILT * density * gravity),
        pitch / (weight * heights[1]),
        heights,
    )


def _depth(hull: Hull, weight: float, down: Sequence[float]) -> float:
    """Return the depth (m) of the origin at which the lift is `weight` N, by bisection."""
    low, high = -hull.reach, hull.reach
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if hull.buoyancy(middle, down)[0] > weight else (middle, high)
    return 0.5 * (low + high)

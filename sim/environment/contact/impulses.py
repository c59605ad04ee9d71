"""Solve the impulses of a collision, with Coulomb friction and restitution.

Each contact is a point of the hull with a normal, and has two impulses: one along the normal that can only push, and
one against the sliding, at most `friction` times the first. They are solved one after the other, repeatedly (projected
Gauss-Seidel; Catto 2005, "Iterative dynamics with temporal coherence"), with the full 6x6 mass matrix. So a contact at
the nose turns the vehicle, and the collision includes the added mass.

Energy. The work of the impulses is sum(impulse * (speed before + speed after) / 2) over their points; this needs no
mass matrix. Newton's restitution can add energy if there is friction (Kane & Levinson 1985). A collision that would add
energy is solved again without restitution and friction, which leaves the least energy.

This is the specification; sim/native/impulses.h is its C twin, equal to the last bit.
"""

from collections.abc import Callable, Sequence
from math import sqrt
from typing import NamedTuple

from hil.common.vectors import Vector3
from sim.matrices import Matrix

SKIN = 1e-4  # m: in a collision, points this near count as contacts, too; else the hull would rock from step to step
_MAX_ROUNDS = 30
_TOLERANCE = 1e-4  # of the greatest closing speed: an iteration that changes less is the last
_MIN_SPEED = 1e-12  # m/s: slower sliding has no direction
_REST_SPEED = 0.03  # m/s: a slower contact has no restitution, so that a vehicle comes to rest

Six = Sequence[float]
ApplyImpulses = Callable[["Sequence[Touch]", Matrix, Six, float, float], tuple[list[float], list[float]]]
Separate = Callable[["Sequence[Touch]", Matrix], list[float]]


class Touch(NamedTuple):
    """A point of contact: the penetration (m, along the normal), the normal out of the obstacle, and the point (m).

    Normal and point are along the body axes.
    """

    depth: float
    normal: Vector3
    lever: Vector3
    what: str


class _Row:
    """One impulse, along a unit vector at a point of the hull. `response` is the change of nu by an impulse of 1 N s.

    `row` converts nu to the speed of the point along the vector, `before` is that speed before the collision, `inertia`
    the apparent mass (kg), `target` the requested speed after the collision.
    """

    __slots__ = ("before", "impulse", "inertia", "response", "row", "target")

    def __init__(self, direction: Vector3, lever: Vector3, inverse_mass: Matrix, nu: Six) -> None:
        a, b, c = direction
        x, y, z = lever
        self.row = d = (a, b, c, y * c - z * b, z * a - x * c, x * b - y * a)
        self.response = [
            m[0] * d[0] + m[1] * d[1] + m[2] * d[2] + m[3] * d[3] + m[4] * d[4] + m[5] * d[5] for m in inverse_mass
        ]
        self.inertia = 1.0 / self.speed(self.response)
        self.before = self.speed(nu)
        self.target = self.impulse = 0.0

    def speed(self, nu: Six) -> float:
        a, b, c, d, e, f = self.row
        return a * nu[0] + b * nu[1] + c * nu[2] + d * nu[3] + e * nu[4] + f * nu[5]


def apply_impulses(
    touches: Sequence[Touch], inverse_mass: Matrix, nu: Six, friction: float, restitution: float
) -> tuple[list[float], list[float]]:
    """Return the nu after a collision at these points, and the impulse about the origin (N s, N m s, body axes)."""
    normals = [_Row(touch.normal, touch.lever, inverse_mass, nu) for touch in touches]
    if min([row.before for row in normals]) >= 0.0:
        return list(nu), [0.0] * 6
    slides: list[_Row | None] = [None] * len(touches)
    if friction > 0.0:
        slides = [_sliding(touch, row, inverse_mass, nu) for touch, row in zip(touches, normals, strict=True)]
    for row in normals:
        row.target = -restitution * row.before if row.before < -_REST_SPEED else 0.0
    after = _solve(normals, slides, nu, friction)
    rows = normals + [slide for slide in slides if slide is not None]
    energy = 0.0
    for row in rows:
        energy += row.impulse * (row.before + row.speed(after))
    if energy > 0.0:
        for row in rows:
            row.impulse = row.target = 0.0
        after, rows = _solve(normals, [None] * len(normals), nu, 0.0), normals
    total = [0.0] * 6
    for row in rows:
        total = [a + row.impulse * b for a, b in zip(total, row.row, strict=True)]
    return after, total


def separate(touches: Sequence[Touch], inverse_mass: Matrix) -> list[float]:
    """Return the displacement (m, rad, body axes) of least mass-weighted norm that removes all these penetrations."""
    zero_velocity = [0.0] * 6
    rows = [_Row(touch.normal, touch.lever, inverse_mass, zero_velocity) for touch in touches]
    for row, touch in zip(rows, touches, strict=True):
        row.target = touch.depth
    return _solve(rows, [None] * len(rows), zero_velocity, 0.0)


def _sliding(touch: Touch, normal: _Row, inverse_mass: Matrix, nu: Six) -> _Row | None:
    """Return the friction impulse of a point, along its sliding velocity; None if it does not slide."""
    u, v, w, p, q, r = nu
    x, y, z = touch.lever
    a, b, c = touch.normal
    closing = normal.before
    u = u + q * z - r * y - closing * a
    v = v + r * x - p * z - closing * b
    w = w + p * y - q * x - closing * c
    speed = sqrt(u * u + v * v + w * w)
    return _Row((u / speed, v / speed, w / speed), touch.lever, inverse_mass, nu) if speed > _MIN_SPEED else None


def _solve(normals: Sequence[_Row], slides: Sequence[_Row | None], nu: Six, friction: float) -> list[float]:
    """Compute the impulses of all rows; return the nu after them.

    Each point then separates at its target speed or faster, and does not slide if friction is sufficient.
    """
    nu = list(nu)
    closing = max([row.target - row.before for row in normals])
    for _ in range(_MAX_ROUNDS):
        largest = 0.0
        for row, slide in zip(normals, slides, strict=True):
            change = (row.target - row.speed(nu)) * row.inertia
            if change < -row.impulse:
                change = -row.impulse
            if change:
                largest = max(largest, abs(change) / row.inertia)
                row.impulse += change
                nu = [v + change * a for v, a in zip(nu, row.response, strict=True)]
            if slide is not None:
                limit = friction * row.impulse
                target = slide.impulse - slide.speed(nu) * slide.inertia
                target = -limit if target < -limit else min(target, limit)
                change = target - slide.impulse
                if change:
                    slide.impulse = target
                    nu = [v + change * a for v, a in zip(nu, slide.response, strict=True)]
        if largest <= _TOLERANCE * closing or largest < _MIN_SPEED:
            break
    return nu

"""The blow that a vehicle gets where it touches things: impulses with Coulomb friction and restitution.

Each touch is a point of the hull with a normal, and takes two impulses: one along the normal that only pushes, and one
against the sliding, at most `friction` times the other. They are found one after the other, again and again
(projected Gauss-Seidel; Catto 2005, "Iterative dynamics with temporal coherence"), with the whole 6x6 mass matrix, so a
nose that touches turns the vehicle, and its added mass takes part in the blow.

Energy. What impulses give is sum(impulse * (speed before + speed after) / 2) of their points, without the mass
matrix. Restitution as Newton has it can make energy where there is friction (Kane & Levinson 1985); a blow that would
is found again without restitution and friction, where each impulse is that which leaves the least energy.

This is the specification; sim/native/impulses.h is its C twin, equal to the last bit.
"""

from collections.abc import Callable, Sequence
from math import sqrt
from typing import NamedTuple

from hil.common.vectors import Vector3
from sim.matrices import Matrix

SKIN = 1e-4  # m: where a hull touches, what is so near touches too; else it would rock from one step to the next
_ROUNDS = 30
_ENOUGH = 1e-4  # of the greatest closing speed: a round that changes less is the last
_LEAST = 1e-12  # m/s
_QUIET = 0.03  # m/s: what closes slower does not bounce, so that a vehicle comes to rest

Six = Sequence[float]
Blow = Callable[["Sequence[Touch]", Matrix, Six, float, float], tuple[list[float], list[float]]]
Separate = Callable[["Sequence[Touch]", Matrix], list[float]]


class Touch(NamedTuple):
    """A point of the hull in something: how deep (m, across), the normal out of it, and the point, in body axes."""

    depth: float
    normal: Vector3
    lever: Vector3
    what: str


class _Row:
    """One impulse: along a unit vector at a point of the hull. `answer` is the nu that an impulse of 1 N s gives."""

    __slots__ = ("answer", "before", "impulse", "inertia", "row", "target")

    def __init__(self, direction: Vector3, lever: Vector3, inverse_mass: Matrix, nu: Six) -> None:
        a, b, c = direction
        x, y, z = lever
        self.row = d = (a, b, c, y * c - z * b, z * a - x * c, x * b - y * a)  # of the 6 numbers of nu
        self.answer = [
            m[0] * d[0] + m[1] * d[1] + m[2] * d[2] + m[3] * d[3] + m[4] * d[4] + m[5] * d[5] for m in inverse_mass
        ]
        self.inertia = 1.0 / self.speed(self.answer)
        self.before = self.speed(nu)
        self.target = self.impulse = 0.0

    def speed(self, nu: Six) -> float:
        a, b, c, d, e, f = self.row
        return a * nu[0] + b * nu[1] + c * nu[2] + d * nu[3] + e * nu[4] + f * nu[5]


def blow(
    touches: Sequence[Touch], inverse_mass: Matrix, nu: Six, friction: float, restitution: float
) -> tuple[list[float], list[float]]:
    """Return the nu after a blow at these touches, and the impulse about the origin (N s, N m s, body axes)."""
    normals = [_Row(touch.normal, touch.lever, inverse_mass, nu) for touch in touches]
    if min([row.before for row in normals]) >= 0.0:
        return list(nu), [0.0] * 6
    slides: list[_Row | None] = [None] * len(touches)
    if friction > 0.0:
        slides = [_sliding(touch, row, inverse_mass, nu) for touch, row in zip(touches, normals, strict=True)]
    for row in normals:
        row.target = -restitution * row.before if row.before < -_QUIET else 0.0
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
    """Return the least way (m, rad, body axes; least in the measure of the mass) that undoes all these depths."""
    rest = [0.0] * 6
    rows = [_Row(touch.normal, touch.lever, inverse_mass, rest) for touch in touches]
    for row, touch in zip(rows, touches, strict=True):
        row.target = touch.depth
    return _solve(rows, [None] * len(rows), rest, 0.0)


def _sliding(touch: Touch, normal: _Row, inverse_mass: Matrix, nu: Six) -> _Row | None:
    """Return the impulse along which a point slides; None if it does not."""
    u, v, w, p, q, r = nu
    x, y, z = touch.lever
    a, b, c = touch.normal
    closing = normal.before
    u = u + q * z - r * y - closing * a
    v = v + r * x - p * z - closing * b
    w = w + p * y - q * x - closing * c
    speed = sqrt(u * u + v * v + w * w)
    return _Row((u / speed, v / speed, w / speed), touch.lever, inverse_mass, nu) if speed > _LEAST else None


def _solve(normals: Sequence[_Row], slides: Sequence[_Row | None], nu: Six, friction: float) -> list[float]:
    """Set the impulses so that no point moves in slower than its target, and none slides that friction can hold."""
    nu = list(nu)
    closing = max([row.target - row.before for row in normals])
    for _ in range(_ROUNDS):
        most = 0.0
        for row, slide in zip(normals, slides, strict=True):
            change = (row.target - row.speed(nu)) * row.inertia
            if change < -row.impulse:
                change = -row.impulse
            if change:
                most = max(most, abs(change) / row.inertia)
                row.impulse += change
                nu = [v + change * a for v, a in zip(nu, row.answer, strict=True)]
            if slide is not None:
                limit = friction * row.impulse
                wanted = slide.impulse - slide.speed(nu) * slide.inertia
                wanted = -limit if wanted < -limit else min(wanted, limit)
                change = wanted - slide.impulse
                if change:
                    slide.impulse = wanted
                    nu = [v + change * a for v, a in zip(nu, slide.answer, strict=True)]
        if most <= _ENOUGH * closing or most < _LEAST:
            break
    return nu

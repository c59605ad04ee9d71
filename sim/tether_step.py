"""One implicit step of a chain of masses and springs: the line of sim/tether.py.

The unknowns are the velocities v of the nodes at the end of a step of dt s (backward Euler; Baraff & Witkin 1998,
"Large steps in cloth simulation"). A spring from node a to node b, along the unit vector t, then pulls with

    stiffness (stretch + dt t.w) + damping t.w  along t,  and  pull / size (1 - t t') dt w  across it,  w = v_b - v_a

The first term keeps a stiff spring stable, the second a taut line. Both are linear in v, and each node depends only on
its two neighbours: a block-tridiagonal system, solved from the anchor on. Springs cannot push: a spring that would push
is left out, and the system is solved again. A spring that becomes taut within the step takes up the pull at once.
"""

from collections.abc import Sequence
from typing import NamedTuple

from hil.common.vectors import Vector3

_MAX_ROUNDS = 12  # of solutions, each with another set of taut springs
_GROUND_MASS = 1e8  # vertical mass of a node that rests on the ground, in masses of a node
_TOLERANCE = 0.1  # change of a pull in the last round, relative to the greatest pull

# A symmetric 3x3 matrix: xx, xy, xz, yy, yz, zz.
Symmetric = tuple[float, float, float, float, float, float]


class Chain(NamedTuple):
    """The state at the beginning of a step, in N, kg, m, s and NED. Node 0 is the anchor; its velocity is constant.

    `loads` are the forces on the nodes besides the springs, and `drags` their decrease with the speed (N s/m). `mass`
    is that of a node between the ends, `inertia` that of the last node, or None if its velocity is constant, too.
    `rest_length` is the unstretched length of a segment, `pulls` are those of the last step. The ground carries the
    nodes that are `lying` as long as they press on it.
    """

    positions: Sequence[Sequence[float]]
    velocities: Sequence[Sequence[float]]
    loads: Sequence[Sequence[float]]
    drags: Sequence[float]
    mass: float
    inertia: Symmetric | None
    rest_length: float
    stiffness: float
    damping: float
    pulls: Sequence[float]
    lying: Sequence[bool]


class _Spring(NamedTuple):
    """A spring from node a to b, along `unit`. Its pull (N) is `offset` + `slope` times the speed of its growth."""

    unit: Vector3
    size: float
    stretch: float
    offset: float
    slope: float


def step_chain(chain: Chain, dt: float) -> tuple[list[list[float]], list[float], list[float]]:
    """Return the node velocities after `dt` s, the pull of each spring, and that of the last one on the last node."""
    springs = [_make_spring(a, b, chain, dt) for a, b in zip(chain.positions, chain.positions[1:], strict=False)]
    velocities = [list(velocity) for velocity in chain.velocities]
    pulls = [last or now for last, now in zip(chain.pulls, _pulls(springs, velocities, dt), strict=True)]
    terms: list[tuple[float, float] | None] = []
    grounded = list(chain.lying)
    for _ in range(_MAX_ROUNDS):
        terms = [(dt * pull / s.size * dt, dt * s.slope) if pull > 0.0 else None
                 for s, pull in zip(springs, pulls, strict=True)]  # fmt: skip
        velocities = _solve(chain, springs, terms, grounded, dt)
        last, pulls = pulls, _pulls(springs, velocities, dt)
        pressed = [lies and velocity[2] >= 0.0 for lies, velocity in zip(grounded, velocities, strict=True)]
        same = pressed == grounded and all((a > 0.0) == (b > 0.0) for a, b in zip(last, pulls, strict=True))
        grounded = pressed
        change = max(abs(a - b) for a, b in zip(last, pulls, strict=True))
        if same and change <= _TOLERANCE * max(pulls):
            break
    if terms[-1] is None:
        return velocities, pulls, [0.0, 0.0, 0.0]
    (across, along), last_spring = terms[-1], springs[-1]
    back = [(a - b) / dt for a, b in zip(velocities[-2], velocities[-1], strict=True)]
    force = [-last_spring.offset * x for x in last_spring.unit]
    return velocities, pulls, _add_coupling(force, last_spring.unit, across, along - across, back)


def _make_spring(a: Sequence[float], b: Sequence[float], chain: Chain, dt: float) -> _Spring:
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    size = (x * x + y * y + z * z) ** 0.5 or 1e-9
    stretch = size - chain.rest_length
    slope = chain.stiffness * dt + chain.damping
    return _Spring((x / size, y / size, z / size), size, stretch, chain.stiffness * stretch, slope)


def _pulls(springs: Sequence[_Spring], velocities: Sequence[Sequence[float]], dt: float) -> list[float]:
    """Return the pull (N) of each spring for these node velocities, 0 if it is slack at the end of the step."""
    pulls = []
    for spring, (au, av, aw), (bu, bv, bw) in zip(springs, velocities, velocities[1:], strict=False):
        x, y, z = spring.unit
        growth = x * (bu - au) + y * (bv - av) + z * (bw - aw)
        taut = spring.stretch + dt * growth > 0.0
        pulls.append(max(0.0, spring.offset + spring.slope * growth) if taut else 0.0)
    return pulls


def _solve(
    chain: Chain,
    springs: Sequence[_Spring],
    terms: Sequence[tuple[float, float] | None],
    grounded: Sequence[bool],
    dt: float,
) -> list[list[float]]:
    """Return the velocities of the nodes that solve the linear system of the step.

    `terms` are the coefficients (kg) across and along each taut spring: impulse over speed; None for slack ones.
    """
    count = len(springs)
    velocities = [list(velocity) for velocity in chain.velocities]
    mass, last = chain.mass, chain.inertia
    weights: list[Symmetric] = [(mass, 0.0, 0.0, mass, 0.0, mass)] * count
    if last is not None:
        weights.append(last)
    inverses: list[Symmetric] = []
    sides: list[list[float]] = []
    for i in range(1, len(weights)):
        xx, xy, xz, yy, yz, zz = weights[i]
        u, v, w = velocities[i]
        drag = dt * chain.drags[i]
        fx, fy, fz = chain.loads[i]
        xx, yy, zz = xx + drag, yy + drag, zz + drag
        right = [
            xx * u + xy * v + xz * w + dt * fx,
            xy * u + yy * v + yz * w + dt * fy,
            xz * u + yz * v + zz * w + dt * fz,
        ]
        for side, k in ((-1.0, i - 1), (1.0, i)):
            term = terms[k] if k < count else None
            if term is None:
                continue
            (x, y, z), (across, along) = springs[k].unit, term
            more = along - across
            xx, xy, xz = xx + across + more * x * x, xy + more * x * y, xz + more * x * z
            yy, yz, zz = yy + across + more * y * y, yz + more * y * z, zz + across + more * z * z
            pull = side * dt * springs[k].offset
            right = [right[0] + pull * x, right[1] + pull * y, right[2] + pull * z]
        block: Symmetric = (xx, xy, xz, yy, yz, zz + _GROUND_MASS * mass if grounded[i] else zz)
        before: Sequence[float] = velocities[0]
        term = terms[i - 1]
        if term is not None:  # eliminate the node before it
            unit, (across, along) = springs[i - 1].unit, term
            if i > 1:
                before = _times(inverses[-1], sides[-1])
                block = _eliminate(block, inverses[-1], unit, across, along - across)
            right = _add_coupling(right, unit, across, along - across, before)
        inverses.append(_inverse(*block))
        sides.append(right)
    for i in range(len(weights) - 1, 0, -1):
        right = sides[i - 1]
        term = terms[i] if i < count else None
        if term is not None:
            across, along = term
            right = _add_coupling(right, springs[i].unit, across, along - across, velocities[i + 1])
        velocities[i] = list(_times(inverses[i - 1], right))
    return velocities


def _eliminate(block: Symmetric, p: Symmetric, t: Sequence[float], across: float, more: float) -> Symmetric:
    """Return block - e p e, with the coupling e = across + more t t'."""
    q = _times(p, t)
    square, product = across * across, across * more
    own = more * more * (q[0] * t[0] + q[1] * t[1] + q[2] * t[2])
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    xx, xy, xz, yy, yz, zz = [
        a - square * b - product * (q[i] * t[j] + q[j] * t[i]) - own * t[i] * t[j]
        for a, b, (i, j) in zip(block, p, pairs, strict=True)
    ]
    return xx, xy, xz, yy, yz, zz


def _add_coupling(
    right: Sequence[float], unit: Sequence[float], across: float, more: float, speed: Sequence[float]
) -> list[float]:
    """Return `right` plus the spring's coupling to the velocity of the node at its other end."""
    along = more * (unit[0] * speed[0] + unit[1] * speed[1] + unit[2] * speed[2])
    return [a + across * b + along * c for a, b, c in zip(right, speed, unit, strict=True)]


def _times(a: Symmetric, x: Sequence[float]) -> tuple[float, float, float]:
    xx, xy, xz, yy, yz, zz = a
    u, v, w = x
    return xx * u + xy * v + xz * w, xy * u + yy * v + yz * w, xz * u + yz * v + zz * w


def _inverse(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> Symmetric:
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    scale = 1.0 / (xx * a + xy * b + xz * c)
    return (
        a * scale, b * scale, c * scale, (xx * zz - xz * xz) * scale, (xy * xz - xx * yz) * scale,
        (xx * yy - xy * xy) * scale,
    )  # fmt: skip

"""Generate the triangles of simple bodies: tubes, boxes, panels, chain links. Axes: forward, right, down, in m."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from math import asinh, cos, cosh, hypot, pi, sin, sinh, sqrt

from hil.common.vectors import Vector3, cross, minus, unit

Triangle = tuple[Vector3, Vector3, Vector3]
_BISECTIONS = 60  # of an interval in the search for a root


def quad(a: Vector3, b: Vector3, c: Vector3, d: Vector3) -> list[Triangle]:
    """Return two triangles of a rectangle, with right angles at their first corners, where a net's lattice starts."""
    return [(a, b, d), (c, d, b)]


def ring(radius: float, down: float, sides: int) -> list[Vector3]:
    """Return the corners of a level regular polygon of `radius` m about the vertical axis, at the depth `down` m."""
    turns = [2.0 * pi * k / sides for k in range(sides)]
    return [(radius * cos(turn), radius * sin(turn), down) for turn in turns]


def tube(line: Sequence[Vector3], upright: Vector3, radius: float, sides: int, closed: bool = False) -> list[Triangle]:
    """Return a tube about a line in a plane normal to `upright` (a unit vector), with lids unless it is `closed`."""
    rims = []
    ends = (line[-1], line[0]) if closed else (line[0], line[-1])
    for before, (x, y, z), after in zip((ends[0], *line), line, (*line[1:], ends[1]), strict=False):
        side = unit(cross(minus(after, before), upright))
        turns = [2.0 * pi * (i + 0.5) / sides for i in range(sides)]
        rims.append([
            (
                x + radius * (cos(t) * side[0] + sin(t) * upright[0]),
                y + radius * (cos(t) * side[1] + sin(t) * upright[1]),
                z + radius * (cos(t) * side[2] + sin(t) * upright[2]),
            )
            for t in turns
        ])  # fmt: skip
    pairs = list(zip(rims, rims[1:] + rims[:1], strict=True))
    triangles = [
        triangle
        for one, other in (pairs if closed else pairs[:-1])
        for i in range(sides)
        for triangle in quad(one[i - 1], one[i], other[i], other[i - 1])
    ]
    if not closed:
        triangles += [(line[end], rims[end][i - 1], rims[end][i]) for end in (0, -1) for i in range(sides)]
    return triangles


def cuboid(low: Vector3, high: Vector3) -> list[Triangle]:
    """Return a box between two corners."""
    lower, upper = (_rectangle(low, high, down) for down in (low[2], high[2]))
    return prism(lower, upper)


def prism(rim: Sequence[Vector3], other_rim: Sequence[Vector3], with_rim: bool = True) -> list[Triangle]:
    """Return a prism between two polygons with equal numbers of corners, without the first one if not `with_rim`."""
    sides = [t for k in range(len(rim)) for t in quad(rim[k - 1], rim[k], other_rim[k], other_rim[k - 1])]
    faces = (rim, other_rim) if with_rim else (other_rim,)
    return sides + [(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)]


def disc(rim: Sequence[Vector3], middle: Vector3) -> list[Triangle]:
    """Return the face of a regular polygon in right-angled triangles, which a net's lattice needs."""
    triangles = []
    for k, corner in enumerate(rim):
        between = tuple(0.5 * (a + b) for a, b in zip(rim[k - 1], corner, strict=True))
        triangles += [(between, middle, rim[k - 1]), (between, middle, corner)]
    return triangles  # type: ignore[return-value]


def links(line: Sequence[Vector3], bar: float) -> list[Triangle]:
    """Return a chain along a line in the forward-down plane; its links have a bar diameter of `bar` m.

    A link is 6 bars long and 3.6 wide, as in a studless anchor chain (ISO 1704); links follow each other every 4 bars.
    """
    triangles: list[Triangle] = []
    right = (0.0, 1.0, 0.0)
    for number, ((x, y, z), along) in enumerate(_along(line, 4.0 * bar)):
        across = cross(along, right)
        plane, normal = (right, across) if number % 2 else (across, right)
        outline = [(2.5, 0.0), (1.2, 1.3), (-1.2, 1.3), (-2.5, 0.0), (-1.2, -1.3), (1.2, -1.3)]
        loop = [
            (
                x + bar * (a * along[0] + b * plane[0]),
                y + bar * (a * along[1] + b * plane[1]),
                z + bar * (a * along[2] + b * plane[2]),
            )
            for a, b in outline
        ]
        triangles += tube(loop, normal, 0.5 * bar, 4, closed=True)
    return triangles


def hanging(span: float, drop: float, length: float, count: int) -> list[Vector3]:
    """Return `count` points of a catenary of `length` m from the origin to `span` m forward and `drop` m down.

    Parts that would hang below its lower end lie at the depth of that end.
    """
    chord = hypot(span, drop)
    if span < 1e-6 or length <= 1.0001 * chord:
        shares = [k / (count - 1) for k in range(count)]
        return [(share * span, 0.0, share * drop) for share in shares]
    # length² - drop² = (2 a sinh(span / 2a))²: a falls as the length grows.
    target = sqrt(length * length - drop * drop)
    slack = _root(lambda x: sinh(x) / x - target / span, 1e-6, 50.0)
    a = 0.5 * span / slack
    lowest = 0.5 * span + a * asinh(drop / (2.0 * a * sinh(slack)))  # of the curve, forward of the origin
    top = a * cosh(lowest / a)
    places = [span * k / (count - 1) for k in range(count)]
    return [(x, 0.0, min(top - a * cosh((x - lowest) / a), max(drop, 0.0))) for x in places]


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of an increasing function, by bisection."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if function(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)


def _along(line: Sequence[Vector3], step: float) -> Iterable[tuple[Vector3, Vector3]]:
    """Yield points every `step` m along a line, the first after half a step, and the line's direction there."""
    ahead = 0.5 * step
    for start, end in pairwise(line):
        x, y, z = minus(end, start)
        length = sqrt(x * x + y * y + z * z)
        if not length:
            continue
        along = (x / length, y / length, z / length)
        while ahead <= length:
            yield (start[0] + ahead * along[0], start[1] + ahead * along[1], start[2] + ahead * along[2]), along
            ahead += step
        ahead -= length


def _rectangle(low: Vector3, high: Vector3, down: float) -> list[Vector3]:
    return [(low[0], low[1], down), (high[0], low[1], down), (high[0], high[1], down), (low[0], high[1], down)]

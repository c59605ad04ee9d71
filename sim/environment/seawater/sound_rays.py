"""The path of sound between two points in water whose speed of sound changes with depth: a ray, or a shadow.

By Snell's law the cosine of a ray's angle to the horizontal, divided by the speed of sound, is constant along the ray.
Where the speed is linear in depth a ray is an arc of a circle, and the distance, time and length in a layer have a
closed form (Medwin and Clay, Fundamentals of Acoustical Oceanography, 1998, 3.3; Jensen et al., Computational Ocean
Acoustics, 3.3). The formulas here avoid differences of nearly equal numbers, so that layers of constant speed, level
rays and steep rays are no special cases.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import islice, pairwise
from math import asin, atanh, hypot, inf, sqrt
from typing import NamedTuple

_STEPS = 8  # intervals of turning depths in each layer in which rays are searched
_TOLERANCE = 1e-10  # of the distance: a ray that ends this near to the point reaches it
_MAX_ITERATIONS = 60  # of a search, which takes five to ten
_VERTICAL = 1e9  # times the speed of sound: the inverse of Snell's constant of a ray that counts as vertical

Piece = tuple[float, float, float]  # of a layer: its height (m) and the speeds at its two sides (m/s)


class Ray(NamedTuple):
    """One path of sound: its time (s), its length (m), and the sines of its slope at both ends, downwards positive."""

    time: float
    length: float
    departure: float
    arrival: float


class SoundRays:
    """Rays in water with `speeds` (m/s) at growing `depths` (m), linear in between and constant beyond them.

    `bottom` (m) is the depth of a level seabed. If there are several rays, the one without a turning point is used,
    else the one that arrives first. Not modelled: reflected rays, sound that is scattered or diffracted into a shadow,
    caustics.
    """

    def __init__(self, depths: Sequence[float], speeds: Sequence[float], bottom: float = inf) -> None:
        self._rows = list(zip(depths, speeds, strict=True))
        self._bottom = bottom

    def between(self, level: float, start: float, end: float) -> Ray | None:
        """Return the ray over a horizontal distance of `level` m from depth `start` to depth `end` (m).

        None if the end is in a shadow.
        """
        top, low = min(start, end), max(start, end)
        across = list(self._pieces(top, low))
        speeds = [speed for _, *both in across for speed in both]
        straight = hypot(level, low - top)
        if min(speeds) == max(speeds) if low > top else self._is_even_at(top):
            slope = (end - start) / straight if straight else 0.0
            return Ray(straight / speeds[0], straight, slope, slope)
        vertex = _direct(level, across)
        if vertex is not None:
            _, time, length = _sums(across, vertex)
            down = 1.0 if end > start else -1.0
            return Ray(time, length, down * _sine(self._speed(start), vertex), down * _sine(self._speed(end), vertex))
        turned = [*self._turning(level, start, end, low, 1.0), *self._turning(level, start, end, top, -1.0)]
        return min(turned, default=None)

    def _is_even_at(self, depth: float) -> bool:
        """Return True if the layer above or below has a constant speed, so that a level ray stays level."""
        return any(near == far for down in (1.0, -1.0) for _, near, far in islice(self._layers_beyond(depth, down), 1))

    def _turning(self, level: float, start: float, end: float, extreme: float, down: float) -> Iterator[Ray]:
        """Yield rays that turn below the deeper end, or with `down` -1 above the shallower end, at `extreme` m."""
        across = list(self._pieces(min(start, end), max(start, end)))
        fastest = max([speed for _, *both in across for speed in both])
        beyond: list[Piece] = []  # layers from `extreme` to that in which the ray turns
        for height, near, far in self._layers_beyond(extreme, down):
            if far > fastest:
                first = max(0.0, (fastest - near) / (far - near))

                def path_to(
                    share: float, before: Sequence[Piece] = tuple(beyond), layer: Piece = (height, near, far)
                ) -> tuple[float, list[Piece]]:
                    speed = layer[1] + share * (layer[2] - layer[1])
                    down_leg = [*before, (share * layer[0], layer[1], speed)]
                    return speed, [*across, *down_leg, *down_leg]

                shares = [first + (1.0 - first) * step / _STEPS for step in range(_STEPS + 1)]
                misses = [_sums(pieces, speed)[0] - level for speed, pieces in map(path_to, shares)]
                for k in range(_STEPS):
                    if misses[k] == 0.0 or misses[k] * misses[k + 1] < 0.0:
                        share = _root(
                            lambda x: _sums(*path_to(x)[::-1])[0] - level, shares[k : k + 2], misses[k : k + 2], level
                        )
                        vertex, pieces = path_to(share)
                        _, time, length = _sums(pieces, vertex)
                        away, back = _sine(self._speed(start), vertex), _sine(self._speed(end), vertex)
                        yield Ray(time, length, down * away, -down * back)
                fastest = far
            beyond.append((height, near, far))

    def _pieces(self, top: float, low: float) -> Iterator[Piece]:
        """Yield the layers between two depths, downwards; one of height 0 if the depths are equal."""
        inner = [depth for depth, _ in self._rows if top < depth < low]
        bounds = [top, *inner, low]
        for upper, lower in pairwise(bounds):
            yield lower - upper, self._speed(upper), self._speed(lower)

    def _layers_beyond(self, depth: float, down: float) -> Iterator[Piece]:
        """Yield the layers from `depth` to the bottom, or with `down` -1 to the surface."""
        if down > 0.0:
            yield from self._pieces(depth, max(depth, min(self._bottom, max(depth, self._rows[-1][0]))))
        elif depth > 0.0:
            yield from [(height, lower, upper) for height, upper, lower in [*self._pieces(0.0, depth)][::-1]]

    def _speed(self, depth: float) -> float:
        rows = self._rows
        if depth <= rows[0][0]:
            return rows[0][1]
        for (upper, fast), (lower, slow) in pairwise(rows):
            if depth <= lower:
                return fast + (slow - fast) * ((depth - upper) / (lower - upper))
        return rows[-1][1]


def _direct(level: float, across: Sequence[Piece]) -> float | None:
    """Return the vertex speed (m/s, the inverse of Snell's constant) of the ray without a turning point, or None.

    The unknown is the slope where sound is fastest, because height over distance is nearly linear in it.
    """
    height, fastest = sum([piece[0] for piece in across]), max([max(piece[1:]) for piece in across])
    if height == 0.0:
        return None
    if level < _TOLERANCE * height:
        return _VERTICAL * fastest

    def vertex(slope: float) -> float:
        return fastest * sqrt(1.0 + slope * slope)

    def miss(slope: float) -> float:
        reached = _sums(across, vertex(slope))[0]
        return (height / reached if reached < inf else 0.0) - height / level

    steepest = height / level
    flat, steep = miss(0.0), miss(steepest)
    if flat > 0.0:
        return None
    return vertex(_root(miss, (0.0, steepest), (flat, max(steep, 0.0)), height / level))


def _root(miss: Callable[[float], float], ends: Sequence[float], values: Sequence[float], scale: float) -> float:
    """Return the root of `miss` between two `ends`, where its `values` have different signs, by the Illinois method."""
    (low, high), (at_low, at_high) = ends, values
    side = 0
    for _ in range(_MAX_ITERATIONS):
        if at_low == at_high:
            break
        estimate = (low * at_high - high * at_low) / (at_high - at_low)
        value = miss(estimate)
        if abs(value) <= _TOLERANCE * scale:
            return estimate
        if (value > 0.0) == (at_high > 0.0):
            high, at_high = estimate, value
            at_low = 0.5 * at_low if side > 0 else at_low
            side = 1
        else:
            low, at_low = estimate, value
            at_high = 0.5 * at_high if side < 0 else at_high
            side = -1
    return low if abs(at_low) < abs(at_high) else high


def _sine(speed: float, vertex: float) -> float:
    """Return the sine of a ray's slope where the speed of sound is `speed` (m/s)."""
    return sqrt(max(0.0, (vertex - speed) * (vertex + speed))) / vertex


def _sums(pieces: Sequence[Piece], vertex: float) -> tuple[float, float, float]:
    """Return horizontal distance (m), time (s) and length (m) of the ray with a vertex speed through layers."""
    level = time = length = 0.0
    constant = 1.0 / vertex
    for height, near, far in pieces:
        if height == 0.0:
            continue
        a, b, total = _sine(near, vertex), _sine(far, vertex), near + far
        if a + b == 0.0:  # a level ray in a layer of constant speed never leaves it
            return inf, inf, inf
        gradient = (far - near) / height
        level += constant * total * height / (a + b)
        part = total * height * (1.0 + a * b) / ((a + b) * (near * near + far * far - (constant * near * far) ** 2))
        time += _over(part * gradient, atanh) * part
        part = height * total / (far * a + near * b)
        length += _over(constant * gradient * part, asin) * part
    return level, time, length


def _over(x: float, function: Callable[[float], float]) -> float:
    """Return function(x) / x, 1 at 0, for an odd function with slope 1 there; x is limited to ±1 against rounding."""
    return function(min(max(x, -1.0), 1.0)) / x if x else 1.0

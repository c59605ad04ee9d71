"""A tether: an elastic line of lumped masses between an anchor and the vehicle, with weight, drag and a winch.

[tether]                       # a section of the scenario
length = "40 m"
anchor = [0.0, 0.0, 0.0]       # NED in m: on a ship, a pier, a buoy
attachment = [-0.2, 0.0, -0.1] # of the vehicle, body axes in m

The line is `segments` straight springs with a mass at each joint (Buckham et al. 2004, Ocean Engineering 31). Springs
pull, never push, and damp. On a joint act the weight in water (in air above the surface), the drag of half of both
segments (across and along each, by the square of the speed through the water where it is), and the seabed, on which it
lies. `begin` moves it on from step to step, the end at the vehicle where that was seen last, led by half a step. Where
a step is too long for the springs it is divided, up to _MOST_PARTS times; beyond that the joints are given more inertia
than they have, so that a stiff or short line is stable too: what it comes to rest at is the same.

A winch at the anchor pays out and hauls in with `winch_speed`: all segments become longer or shorter. Cost: about
10 us a segment and part on a desktop's core. Not modelled: bending, torsion, friction on the seabed along the line,
vortex-induced vibration, waves at the line.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import ceil, isfinite, pi, sqrt
from typing import TYPE_CHECKING, Annotated, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range
from sim.rotations import Rotation

if TYPE_CHECKING:
    from sim.environment.world import World
    from sim.forces import Wrench

Place = Annotated[float, Range(-1e5, 1e5, "m")]
Speed = Annotated[float, Range(-20.0, 20.0, "m/s")]
MOST_LENGTH = 10_000.0  # m
LEAST_LENGTH = 0.5  # m
_MOST_PARTS = 8  # of a step
_PACE = 0.5  # of a joint's 1 / omega: stable to where pace^2 + 4 damping pace is 1
_FINE = 200  # places along the arc in which it begins
_DAMPING = 0.2  # of the critical one of a joint between two springs

Flow = Callable[[Sequence[float]], Sequence[float]]


class TetherKeys(NamedTuple):
    """The keys of [tether]. The defaults are those of a neutrally buoyant ROV tether of 7.6 mm.

    `length` is paid out at the start and without tension; `anchor` where it is held (NED, m), which moves with
    `anchor_velocity`; `attachment` the place at the vehicle (body axes, m). `diameter` in m, `mass` in kg a metre in
    air, `stiffness` EA in N: how much pull would double its length. `drag` and `drag_along` are the coefficients across
    (with the diameter) and along (with the circumference). `winch_speed` is how fast a new length is paid out.
    """

    length: Annotated[float, Range(LEAST_LENGTH, MOST_LENGTH, "m")]
    anchor: tuple[Place, Place, Place] = (0.0, 0.0, 0.0)
    anchor_velocity: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    attachment: tuple[Place, Place, Place] = (0.0, 0.0, 0.0)
    diameter: Annotated[float, Range(1e-4, 0.5, "m")] = 0.0076
    mass: Annotated[float, Range(1e-4, 100.0)] = 0.0465
    stiffness: Annotated[float, Range(1.0, 1e9)] = 20_000.0
    drag: Annotated[float, Range(0.0, 10.0)] = 1.2
    drag_along: Annotated[float, Range(0.0, 1.0)] = 0.01
    winch_speed: Annotated[float, Range(0.0, 20.0, "m/s")] = 0.5
    segments: Annotated[int, Range(2, 100)] = 10


def require_length(length: float) -> None:
    """Raise ConfigError for a length (m) that cannot be."""
    if not (isfinite(length) and LEAST_LENGTH <= length <= MOST_LENGTH):
        raise ConfigError(f"tether: length {length:g} m is outside {LEAST_LENGTH:g} to {MOST_LENGTH:g} m")


class Tether:
    """The force of a tether on a vehicle in `world`, as sim.forces.Force. `flow` gives the water's velocity (NED, m/s).

    `tension` is the pull at the vehicle in N, `anchor_tension` that at the anchor, `length` what is paid out now, in m,
    `nodes` the places of the joints from anchor to vehicle (NED, m). `dt` is the time of a step in s.
    """

    def __init__(self, keys: TetherKeys, world: "World", dt: float, flow: Flow | None = None) -> None:
        self.keys = keys
        self.length = self._wanted = keys.length
        self.tension = self.anchor_tension = 0.0
        self.nodes: list[list[float]] = []
        self._speeds: list[list[float]] = []
        self._world, self._dt = world, dt
        self._flow: Flow = flow or (lambda _: world.current)
        self._area = 0.25 * pi * keys.diameter**2
        self._force: Sequence[float] = (0.0, 0.0, 0.0)
        self._time_ns = -1
        self._seen: list[Sequence[float]] = []  # the last two places of the attachment
        self._waits = True  # for the place in this step

    def set_length(self, length: float) -> None:
        """Pay out or haul in to `length` m, at the winch's speed. Raises ConfigError for a length that cannot be."""
        require_length(length)
        self._wanted = length

    def restart(self) -> None:
        """Hang the line again in the next step: the vehicle was put elsewhere, and did not move there."""
        self.nodes, self._seen, self._force = [], [], (0.0, 0.0, 0.0)

    def begin(self, time_ns: int) -> None:
        """Move the line on to the beginning of a step."""
        if time_ns <= self._time_ns:
            return
        if self._seen and self._time_ns >= 0:
            self._advance(time_ns * 1e-9)
        self._time_ns, self._waits = time_ns, True

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> "Wrench":
        """Return the pull at the vehicle: see sim.forces.Force."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        x, y, z = self.keys.attachment
        if self._waits:
            north, east, down = position
            place = (
                north + xx * x + xy * y + xz * z,
                east + yx * x + yy * y + yz * z,
                down + zx * x + zy * y + zz * z,
            )
            self._seen = [*self._seen[-1:], place]
            self._waits = False
            if not self.nodes:
                self._hang(place)
        north, east, down = self._force
        u = xx * north + yx * east + zx * down
        v = xy * north + yy * east + zy * down
        w = xz * north + yz * east + zz * down
        return u, v, w, y * w - z * v, z * u - x * w, x * v - y * u

    def _hang(self, end: Sequence[float]) -> None:
        """Put the line between anchor and vehicle in an arc of its length, or straight where it is too short."""
        start, count = self._anchor(self._time_ns * 1e-9), self.keys.segments
        down = 1.0 if self.keys.mass > self._world.density * self._area else -1.0
        low, high = 0.0, self.length
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _lengths(_arc(start, end, down * middle))[-1] < self.length else (low, middle)
        arc = _arc(start, end, down * low)
        lengths = _lengths(arc)
        for k in range(count + 1):  # at equal distances along it, or the springs would begin with a jerk
            way = lengths[-1] * k / count
            at = min(bisect_right(lengths, way), _FINE) - 1
            share = (way - lengths[at]) / (lengths[at + 1] - lengths[at] or 1.0)
            self.nodes.append([a + share * (b - a) for a, b in zip(arc[at], arc[at + 1], strict=True)])
        self._speeds = [[0.0, 0.0, 0.0] for _ in range(count + 1)]

    def _anchor(self, time: float) -> list[float]:
        return [a + time * v for a, v in zip(self.keys.anchor, self.keys.anchor_velocity, strict=True)]

    def _advance(self, time: float) -> None:
        keys, dt = self.keys, self._dt
        change = min(abs(self._wanted - self.length), keys.winch_speed * dt)
        self.length += change if self._wanted > self.length else -change
        rest = self.length / keys.segments
        spring = keys.stiffness / rest
        mass = (keys.mass + self._world.density * self._area) * rest  # with the water that goes along
        parts = min(_MOST_PARTS, ceil(dt * sqrt(spring / mass) / _PACE))
        part = dt / parts
        mass = max(mass, spring * (part / _PACE) ** 2)
        last, older = self._seen[-1], self._seen[0]
        velocity = [(a - b) / dt for a, b in zip(last, older, strict=True)]
        end = [a + 0.5 * dt * v for a, v in zip(last, velocity, strict=True)]
        start = self._anchor(time)
        from_start, from_end = self.nodes[0], self.nodes[-1]
        self._speeds[0], self._speeds[-1] = list(keys.anchor_velocity), velocity
        total, held = [0.0, 0.0, 0.0], 0.0
        for k in range(1, parts + 1):
            share = k / parts
            self.nodes[0] = [a + share * (b - a) for a, b in zip(from_start, start, strict=True)]
            self.nodes[-1] = [a + share * (b - a) for a, b in zip(from_end, end, strict=True)]
            forces = self._forces(rest, spring, mass)
            total = [a + b for a, b in zip(total, forces[-1], strict=True)]
            held += sqrt(sum([x * x for x in forces[0]]))
            self._move(forces, mass, part)
        self._force = [x / parts for x in total]
        self.tension = sqrt(sum([x * x for x in self._force]))
        self.anchor_tension = held / parts

    def _forces(self, rest: float, spring: float, mass: float) -> list[list[float]]:
        """Return the force on each joint (N, NED)."""
        keys, density = self.keys, self._world.density
        forces = [[0.0, 0.0, 0.0] for _ in self.nodes]
        damping = 2.0 * _DAMPING * sqrt(spring * mass)
        across, along = 0.5 * density * keys.drag * keys.diameter, 0.5 * density * keys.drag_along * pi * keys.diameter
        wet, dry = 0.5 * rest * (keys.mass - density * self._area), 0.5 * rest * keys.mass
        gravity = self._world.gravity
        for i in range(len(self.nodes) - 1):
            (ax, ay, az), (bx, by, bz) = self.nodes[i], self.nodes[i + 1]
            (au, av, aw), (bu, bv, bw) = self._speeds[i], self._speeds[i + 1]
            x, y, z = bx - ax, by - ay, bz - az
            size = sqrt(x * x + y * y + z * z) or 1e-9
            x, y, z = x / size, y / size, z / size
            stretch = size - rest
            pull = 0.0
            if stretch > 0.0:
                pull = spring * stretch + damping * (x * (bu - au) + y * (bv - av) + z * (bw - aw))
                pull = max(pull, 0.0)
            weight = gravity * (wet if az + bz > 0.0 else dry)
            fx = fy = 0.0
            fz = weight
            if az + bz > 0.0:
                north, east, down = self._flow((0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)))
                u, v, w = north - 0.5 * (au + bu), east - 0.5 * (av + bv), down - 0.5 * (aw + bw)
                slide = u * x + v * y + w * z
                u, v, w = u - slide * x, v - slide * y, w - slide * z
                push = 0.5 * size * across * sqrt(u * u + v * v + w * w)
                rub = 0.5 * size * along * abs(slide) * slide
                fx, fy, fz = push * u + rub * x, push * v + rub * y, fz + push * w + rub * z
            one, other = forces[i], forces[i + 1]
            one[0] += fx + pull * x
            one[1] += fy + pull * y
            one[2] += fz + pull * z
            other[0] += fx - pull * x
            other[1] += fy - pull * y
            other[2] += fz - pull * z
        return forces

    def _move(self, forces: Sequence[Sequence[float]], mass: float, part: float) -> None:
        """Move the joints between the ends on by `part` s; they lie on the seabed, and float on the surface."""
        floats = self.keys.mass < self._world.density * self._area
        for i in range(1, len(self.nodes) - 1):
            speed = [v + part * f / mass for v, f in zip(self._speeds[i], forces[i], strict=True)]
            node = [a + part * v for a, v in zip(self.nodes[i], speed, strict=True)]
            bed = self._world.seabed(node[0], node[1])
            if node[2] > bed:
                node[2], speed = bed, [0.0, 0.0, min(0.0, speed[2])]
            elif floats and node[2] < 0.0:
                node[2], speed[2] = 0.0, max(0.0, speed[2])
            self.nodes[i], self._speeds[i] = node, speed


def _arc(start: Sequence[float], end: Sequence[float], sag: float) -> list[list[float]]:
    """Return places along a parabola between two, `sag` m below their middle."""
    shares = [k / _FINE for k in range(_FINE + 1)]
    bent = [(0.0, 0.0, 4.0 * sag * s * (1.0 - s)) for s in shares]
    return [
        [a + s * (b - a) + c for a, b, c in zip(start, end, off, strict=True)]
        for s, off in zip(shares, bent, strict=True)
    ]


def _lengths(places: Sequence[Sequence[float]]) -> list[float]:
    """Return how far (m) each place is along a line of them."""
    lengths = [0.0]
    for one, other in pairwise(places):
        lengths.append(lengths[-1] + sqrt(sum([(a - b) ** 2 for a, b in zip(one, other, strict=True)])))
    return lengths

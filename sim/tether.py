"""A tether: an elastic line of lumped masses between an anchor and the vehicle, with weight, drag and a winch.

[tether]                       # a section of the scenario
length = "40 m"
anchor = [0.0, 0.0, 0.0]       # NED in m: on a ship, a pier, a buoy
attachment = [-0.2, 0.0, -0.1] # at the vehicle, body axes in m

The line consists of `segments` straight springs with a mass at each node (Buckham et al. 2004, Ocean Engineering 31).
Springs pull and damp, but never push. Three forces act on a node: its weight in water (in air above the surface), half
the drag of both segments at it (normal and tangential, proportional to the square of the speed through the local
water), and the contact force of the seabed. `begin` solves the motion of line and vehicle through the step together
(sim/tether_step.py); the vehicle is represented by its inertia at the attachment, and the resulting pull is constant
during the step. So a short or stiff line is stable with steps of any length, and a vehicle at its end comes to rest
where the pull balances the other forces.

Limits: vibrations along the line with periods of a few steps and the rebound after a snatch load are damped out. The
vehicle's end yields by pull / inertia dt^2 too much (0.3 mm for 2 m/s^2 at 100 Hz). The stiffness of a spring is
limited to _MAX_STIFFNESS times a node's mass / dt^2: at 100 Hz, with the default diameter and mass, EA is at most
9e8 N/m^2 times a segment's length squared.

A winch at the anchor pays out and hauls in with `winch_speed`: all segments become longer or shorter. Cost: about 14 us
a segment on a desktop's core, twice that while the pull changes quickly. Not modelled: bending, torsion, friction on
the seabed along the line, vortex-induced vibration, waves at the line.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import isfinite, pi, sqrt
from typing import TYPE_CHECKING, Annotated, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range
from sim.matrices import Matrix, cross_matrix, inverse, product, transpose
from sim.rotations import Rotation, matrix, rotate
from sim.tether_step import Chain, Symmetric, step_chain

if TYPE_CHECKING:
    from sim.dynamics import State
    from sim.environment.world import World
    from sim.forces import Wrench

Coordinate = Annotated[float, Range(-1e5, 1e5, "m")]
Speed = Annotated[float, Range(-20.0, 20.0, "m/s")]
MAX_LENGTH = 10_000.0  # m
MIN_LENGTH = 0.5  # m
MIN_SEGMENT = 0.025  # m
_MAX_STIFFNESS = 1e6  # of a spring, times dt^2 / mass of a node; above it, rounding and bends make errors
_ARC_STEPS = 200  # straight pieces of the arc in which the line starts
_DAMPING_RATIO = 0.2  # of a node between two springs

Flow = Callable[[Sequence[float]], Sequence[float]]  # a position (NED, m) to the velocity of the water (NED, m/s)
ReadBody = Callable[[], "tuple[State, Matrix]"]  # returns the vehicle's state and inverse mass matrix


class TetherKeys(NamedTuple):
    """The keys of [tether]. The defaults are those of a neutrally buoyant ROV tether of 7.6 mm.

    `length` is the unstretched length paid out at the start; `anchor` the position of its fixed end (NED, m), which
    moves with `anchor_velocity`; `attachment` the other end at the vehicle (body axes, m). `diameter` is in m, `mass`
    in kg a metre in air, `stiffness` is EA in N: the pull that would double the length. `drag` and `drag_along` are
    the coefficients normal (based on the diameter) and tangential (based on the circumference). `winch_speed` is how
    fast the paid-out length changes.
    """

    length: Annotated[float, Range(MIN_LENGTH, MAX_LENGTH, "m")]
    anchor: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    anchor_velocity: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    attachment: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    diameter: Annotated[float, Range(1e-4, 0.5, "m")] = 0.0076
    mass: Annotated[float, Range(1e-4, 100.0, "kg/m")] = 0.0465
    stiffness: Annotated[float, Range(1.0, 1e9, "N")] = 20_000.0
    drag: Annotated[float, Range(0.0, 10.0)] = 1.2
    drag_along: Annotated[float, Range(0.0, 1.0)] = 0.01
    winch_speed: Annotated[float, Range(0.0, 20.0, "m/s")] = 0.5
    segments: Annotated[int, Range(2, 100)] = 10

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if self.length < self.segments * MIN_SEGMENT:
            limit = int(self.length / MIN_SEGMENT)
            return f"segments: {self.segments} of {self.length:g} m are too short to compute: use at most {limit}"
        return None

    def require_length(self, length: float) -> None:
        """Raise ConfigError for a length (m) that the winch cannot pay out."""
        least = max(MIN_LENGTH, self.segments * MIN_SEGMENT)
        if not (isfinite(length) and least <= length <= MAX_LENGTH):
            raise ConfigError(
                f"tether: length {length:g} m of {self.segments} segments is outside {least:g} to {MAX_LENGTH:g} m"
            )


class Tether:
    """The force of a tether on a vehicle in `world`; implements sim.forces.Force.

    `tension` is the pull at the vehicle in N, `length` the length that is paid out
    now in m, `nodes` the positions of the nodes from anchor to vehicle (NED, m). `dt` is the time of a step in s.
    `read_body` returns the state of the vehicle and its inverse mass matrix; with a matrix of zeros the vehicle's end
    does not yield. `flow` returns the velocity of the water (NED, m/s) at a position.
    """

    def __init__(
        self, keys: TetherKeys, world: "World", dt: float, read_body: ReadBody, flow: Flow | None = None
    ) -> None:
        self.keys = keys
        self.length = self._target_length = keys.length
        self.tension = 0.0
        self.nodes: list[list[float]] = []
        self._velocities: list[list[float]] = []
        self._pulls: list[float] = []  # of the springs
        self._world, self._dt, self._read_body = world, dt, read_body
        self._inverse_mass: Matrix | None = None
        self._inertia: Matrix | None = None  # at the attachment, body axes
        self._flow: Flow = flow or (lambda _: world.current)
        self._area = 0.25 * pi * keys.diameter**2
        self._force: Sequence[float] = (0.0, 0.0, 0.0)
        self._time_ns = -1

    def set_length(self, length: float) -> None:
        """Pay out or haul in to `length` m at the winch's speed. Raises ConfigError for an impossible length."""
        self.keys.require_length(length)
        self._target_length = length

    def restart(self) -> None:
        """Put the line into its initial shape in the next step. Call it after the vehicle was set to a new position."""
        self.nodes = []

    def begin(self, time_ns: int) -> None:
        """Advance the line, and with it the vehicle's end, through the step that begins at `time_ns`."""
        if time_ns <= self._time_ns:
            return
        self._time_ns = time_ns
        end = self._vehicle_end()
        if not self.nodes:
            self._set_initial_shape(end.position)
        self._advance(end)

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> "Wrench":
        """Return the pull at the vehicle: see sim.forces.Force."""
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        x, y, z = self.keys.attachment
        north, east, down = self._force
        u = xx * north + yx * east + zx * down
        v = xy * north + yy * east + zy * down
        w = xz * north + yz * east + zz * down
        return u, v, w, y * w - z * v, z * u - x * w, x * v - y * u

    def _vehicle_end(self) -> "_VehicleEnd":
        state, inverse_mass = self._read_body()
        if inverse_mass is not self._inverse_mass:
            self._inverse_mass, self._inertia = inverse_mass, _inertia_at(self.keys.attachment, inverse_mass)
        lever = rotate(state.quaternion, self.keys.attachment)
        position = [a + b for a, b in zip(state.position, lever, strict=True)]
        u, v, w, p, q, r = state.nu
        x, y, z = self.keys.attachment
        velocity = rotate(state.quaternion, (u + q * z - r * y, v + r * x - p * z, w + p * y - q * x))
        if self._inertia is None:
            return _VehicleEnd(position, velocity, None)
        xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix(state.quaternion)
        turn = [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]
        (a, b, c), (_, d, e), (_, _, f) = product(product(turn, self._inertia), transpose(turn))
        return _VehicleEnd(position, velocity, (a, b, c, d, e, f))

    def _set_initial_shape(self, end: Sequence[float]) -> None:
        """Lay the line from the anchor to `end` along an arc of its length, or straight if it is too short."""
        start, count = self._anchor(self._time_ns * 1e-9), self.keys.segments
        down = 1.0 if self.keys.mass > self._world.density * self._area else -1.0
        low, high = 0.0, self.length
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _lengths(_arc(start, end, down * middle))[-1] < self.length else (low, middle)
        arc = _arc(start, end, down * low)
        lengths = _lengths(arc)
        for k in range(count + 1):  # nodes at equal distances along the arc, or the springs would start with a jerk
            distance = lengths[-1] * k / count
            at = min(bisect_right(lengths, distance), _ARC_STEPS) - 1
            share = (distance - lengths[at]) / (lengths[at + 1] - lengths[at] or 1.0)
            self.nodes.append([a + share * (b - a) for a, b in zip(arc[at], arc[at + 1], strict=True)])
        self._velocities = [[0.0, 0.0, 0.0] for _ in range(count + 1)]
        self._pulls = [0.0] * count

    def _anchor(self, time: float) -> list[float]:
        return [a + time * v for a, v in zip(self.keys.anchor, self.keys.anchor_velocity, strict=True)]

    def _advance(self, end: "_VehicleEnd") -> None:
        """Advance the line by a step, and compute its mean pull on the vehicle during the step."""
        keys, dt = self.keys, self._dt
        change = min(abs(self._target_length - self.length), keys.winch_speed * dt)
        self.length += change if self._target_length > self.length else -change
        rest_length = self.length / keys.segments
        mass = (keys.mass + self._world.density * self._area) * rest_length  # with added mass
        spring = min(keys.stiffness / rest_length, _MAX_STIFFNESS * mass / dt**2)
        self.nodes[0], self.nodes[-1] = self._anchor(self._time_ns * 1e-9), list(end.position)
        self._velocities[0], self._velocities[-1] = list(keys.anchor_velocity), list(end.velocity)
        loads, drags = self._loads(rest_length)
        damping = 2.0 * _DAMPING_RATIO * sqrt(spring * mass)
        last = keys.segments
        lying = [0 < i < last and z >= self._world.seabed(x, y) for i, (x, y, z) in enumerate(self.nodes)]
        chain = Chain(
            self.nodes, self._velocities, loads, drags, mass, end.inertia, rest_length, spring, damping,
            self._pulls, lying,
        )  # fmt: skip
        self._velocities, self._pulls, force = step_chain(chain, dt)
        self._force = [a + b for a, b in zip(force, loads[-1], strict=True)]
        self.tension = sqrt(sum([x * x for x in self._force]))
        self._move(dt)

    def _loads(self, rest_length: float) -> tuple[list[list[float]], list[float]]:
        """Return weight plus drag of each node (N, NED), and the slope of its drag over the speed (N s/m)."""
        keys, density = self.keys, self._world.density
        loads, drags = [[0.0, 0.0, 0.0] for _ in self.nodes], [0.0 for _ in self.nodes]
        across, along = 0.5 * density * keys.drag * keys.diameter, 0.5 * density * keys.drag_along * pi * keys.diameter
        wet, dry = 0.5 * rest_length * (keys.mass - density * self._area), 0.5 * rest_length * keys.mass
        gravity = self._world.gravity
        for i in range(len(self.nodes) - 1):
            (ax, ay, az), (bx, by, bz) = self.nodes[i], self.nodes[i + 1]
            (au, av, aw), (bu, bv, bw) = self._velocities[i], self._velocities[i + 1]
            x, y, z = bx - ax, by - ay, bz - az
            size = sqrt(x * x + y * y + z * z) or 1e-9
            x, y, z = x / size, y / size, z / size
            fx = fy = resistance = 0.0
            fz = gravity * (wet if az + bz > 0.0 else dry)
            if az + bz > 0.0:
                north, east, down = self._flow((0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)))
                u, v, w = north - 0.5 * (au + bu), east - 0.5 * (av + bv), down - 0.5 * (aw + bw)
                slide = u * x + v * y + w * z
                u, v, w = u - slide * x, v - slide * y, w - slide * z
                resistance = 0.5 * size * across * sqrt(u * u + v * v + w * w)
                rub = 0.5 * size * along * abs(slide) * slide
                fx, fy, fz = resistance * u + rub * x, resistance * v + rub * y, fz + resistance * w + rub * z
            for k in (i, i + 1):
                load = loads[k]
                load[0], load[1], load[2] = load[0] + fx, load[1] + fy, load[2] + fz
                drags[k] += resistance
        return loads, drags

    def _move(self, dt: float) -> None:
        """Move all nodes by `dt` s. Nodes between the ends stop at the seabed, and at the surface if they float."""
        floats = self.keys.mass < self._world.density * self._area
        for i, speed in enumerate(self._velocities):
            node = [a + dt * v for a, v in zip(self.nodes[i], speed, strict=True)]
            if 0 < i < self.keys.segments:
                bed = self._world.seabed(node[0], node[1])
                if node[2] > bed:
                    node[2], speed[:] = bed, [0.0, 0.0, min(0.0, speed[2])]
                elif floats and node[2] < 0.0:
                    node[2], speed[2] = 0.0, max(0.0, speed[2])
            self.nodes[i] = node


class _VehicleEnd(NamedTuple):
    """The vehicle's end of the line: position (m), velocity (m/s), and the inertia there (kg), all NED."""

    position: Sequence[float]
    velocity: Sequence[float]
    inertia: Symmetric | None


def _inertia_at(lever: Sequence[float], inverse_mass: Matrix) -> Matrix | None:
    """Return the apparent mass for a force at `lever` (m) of the body (kg, 3x3, body axes); None if it cannot move."""
    arms = [[float(i == j) for j in range(3)] + [-x for x in row] for i, row in enumerate(cross_matrix(lever))]
    mobility = product(product(arms, inverse_mass), transpose(arms))
    return inverse(mobility) if any(map(any, mobility)) else None


def _arc(start: Sequence[float], end: Sequence[float], sag: float) -> list[list[float]]:
    """Return points of a parabola from `start` to `end` that passes `sag` m below their middle."""
    shares = [k / _ARC_STEPS for k in range(_ARC_STEPS + 1)]
    bent = [(0.0, 0.0, 4.0 * sag * s * (1.0 - s)) for s in shares]
    return [
        [a + s * (b - a) + c for a, b, c in zip(start, end, off, strict=True)]
        for s, off in zip(shares, bent, strict=True)
    ]


def _lengths(points: Sequence[Sequence[float]]) -> list[float]:
    """Return the distance (m) of each point from the first, measured along the line through the points."""
    lengths = [0.0]
    for one, other in pairwise(points):
        lengths.append(lengths[-1] + sqrt(sum([(a - b) ** 2 for a, b in zip(one, other, strict=True)])))
    return lengths

"""A sonar's ping: rays into the world, split where there are small things, and what they bring back.

sim/sensors/imaging/echoes.py has the equations.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hil.common.vectors import Quaternion
from sim.dynamics import State
from sim.environment.bottom import PROPERTIES
from sim.environment.texture import smooth_slopes
from sim.rays.scene import SEABED, RayScene
from sim.rays.solids import Solid, half_space
from sim.rays.splitting import Cells, Lattice, split
from sim.rotations import matrix, multiply
from sim.sensors.imaging.echoes import (
    MARGIN,
    STRETCH,
    Aperture,
    Bins,
    Echoes,
    Floats,
    Ground,
    Mirrors,
    Rays,
    View,
    pattern,
)
from sim.sensors.imaging.multipath import second_echoes
from sim.sensors.imaging.ping_motion import PingMotion, motion_of
from sim.sensors.imaging.reverberation import volume_echoes
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion

_STEEP = 0.3  # of a unit normal's z: what is steeper is a cliff of the grid
_NONE = -200.0  # dB: of a strength
_SLOPE = 0.1  # rms of the slopes of what is smooth, which is how wide its glint is


class Strengths(Protocol):
    """The keys of a sonar's model for how strongly things echo: 10 lg mu in dB."""

    @property
    def seabed_strength(self) -> float:
        """The seabed."""

    @property
    def object_strength(self) -> float:
        """Obstacles, meshes and vehicles."""

    @property
    def surface_strength(self) -> float:
        """The water's surface from below."""

    @property
    def glint(self) -> float:
        """The gain of objects at a right angle, in dB."""


class Pinger:
    """Sends pings through an aperture into the world of `scene`.

    `reach` m is the farthest range of interest, `absorption` dB/m, `strengths` are 10 lg mu in dB. `surface` is the
    number of the water's surface among the objects.
    """

    def __init__(
        self, scene: Scene, mounting: Mounting, aperture: Aperture, reach: float,
        absorption: float, strengths: Strengths, mirrors: Mirrors | None = None,
    ) -> None:  # fmt: skip
        self._scene, self._mounting, self._aperture = scene, mounting, aperture
        self._reach, self.absorption, self._mirrors = MARGIN * reach, absorption, mirrors
        self._rays = RayScene(scene.world)
        self.surface = surface = self._rays.add(half_space((0.0, 0.0, 1.0), 0.0))
        self._object_strength = 10.0 ** (strengths.object_strength / 10.0)
        self._glint = 10.0 ** (strengths.glint / 10.0) - 1.0
        self._strengths = np.full(surface + 2, self._object_strength)  # by object; NOTHING is the last one
        bottom = scene.world.bottom
        kind = PROPERTIES[bottom.kind].echo if bottom else 0.0
        self._strengths[0] = 10.0 ** ((strengths.seabed_strength + kind) / 10.0)
        for number, _, echo in scene.world.appearances():
            self._strengths[number] *= 10.0 ** (echo / 10.0)
        from_below = strengths.surface_strength
        self._strengths[surface] = 10.0 ** (from_below / 10.0) if from_below > _NONE else 0.0
        self._strengths[-1] = 0.0
        beams, rays = aperture.weights.shape
        self._flat = np.ascontiguousarray(aperture.directions.reshape(-1, 3), dtype=float)
        edges = aperture.edges[:, :-1], aperture.edges[:, 1:], *aperture.sides
        self._edges = tuple(edge.reshape(-1, 3) for edge in edges)
        self._beam = np.repeat(np.arange(beams), rays)

    def add(self, solid: Solid, state: State) -> None:
        """Add a solid that moves with a vehicle's `state`; it echoes as the objects do."""
        number = self._rays.add(solid, state)
        self._strengths = np.insert(self._strengths, number, self._object_strength)

    def ping(self, time_ns: int, state: State, turned: Quaternion | None = None) -> Echoes | None:
        """Return what comes back to where the sonar is by then; None out of the water.

        `turned` is how a head stands in the sensor's axes, for one that turns.
        """
        place = self._mounting.place(state)
        if place[2] <= 0.0 or submersion(self._scene, time_ns, place) <= 0.0:
            return None
        attitude = self._mounting.attitude(state)
        turn = np.array(matrix(multiply(attitude, turned) if turned else attitude)).reshape(3, 3)
        weights = self._aperture.weights.ravel()
        rays = self._cast(place, turn, self._flat, self._edges, weights, self._beam)
        motion = motion_of(state, self._mounting, turned)
        found, facing = self._echoes(rays, turn, motion, self._aperture.weights.shape)
        lattice = self._aperture.lattice
        cells = lattice and split(lattice, self._rays, place, turn, self._reach, rays.object)
        several = [found]
        if lattice and cells:
            found.energy[cells.parent] = 0.0
            several.append(self._echoes(self._cast(place, turn, *self._smaller(lattice, cells)), turn, motion)[0])
        if self._mirrors:
            several += self._second(self._mirrors, place, turn, rays)
        ground = Ground(place, rays.points, facing, self._aperture.weights.shape)
        ranges, near, far, energy, beam, objects = (
            np.concatenate(part) for part in zip(*[part[:-1] for part in several], strict=True)
        )
        near, far = _within(near, far, ranges, energy, objects)
        return Echoes(ranges, near, far, energy, beam, objects, ground)

    def with_water(self, shares: Floats, echoes: Echoes, bins: Bins, strength: float) -> Floats:
        """Return `shares` of `echoes` (beams x bins) and what the water adds, whose 10 lg s_v is `strength`."""
        if strength <= _NONE:
            return shares
        return shares + volume_echoes(echoes, bins, self._aperture.weights, strength, self.absorption)

    def _cast(
        self, place: Any, turn: Floats, directions: Floats, edges: tuple[Floats, ...], weights: Floats,
        beam: NDArray[np.int64],
    ) -> Rays:  # fmt: skip
        hits = self._rays.hits(place, directions, self._reach, turn.ravel().tolist())
        normals = np.frombuffer(hits.normals).reshape(-1, 3)
        points, objects = np.frombuffer(hits.points).reshape(-1, 3), np.frombuffer(hits.objects, np.int32)
        return Rays(directions, edges, weights, beam, np.frombuffer(hits.distances), points, normals, objects)

    def _smaller(self, lattice: Lattice, cells: Cells) -> tuple[Floats, tuple[Floats, ...], Floats, Any]:
        """Return directions, edges, weights and beams of split rays."""
        upper, lower = cells.down - cells.half_down, cells.down + cells.half_down
        weights = 2.0 * cells.half_across * (np.sin(lower) - np.sin(upper))
        weights *= pattern(cells.down, self._aperture.height) ** 2
        if self._aperture.columns is not None:
            weights *= self._aperture.columns[cells.column]
        edges = lattice.unit(cells.across, upper), lattice.unit(cells.across, lower)
        return lattice.unit(cells.across, cells.down), edges, weights, cells.column

    def _echoes(
        self, rays: Rays, turn: Floats, motion: PingMotion | None, shape: tuple[int, ...] | None = None
    ) -> tuple[Echoes, Floats]:
        """Return the echoes, and the cosines of incidence; `shape` if all rays of each beam are there."""
        strengths = self._strengths[rays.object]
        if kinds := self._scene.world.bottom_map:
            bed = rays.object == SEABED
            strengths[bed] *= kinds.echoes(rays.points[bed, 0], rays.points[bed, 1], self._scene.world.bottom)
        echoing = (strengths > 0.0) & (rays.ranges > 0.0)
        ranges = np.where(echoing, rays.ranges, 1.0)
        normals = np.where(echoing[:, None], rays.normals @ turn, -rays.directions)
        facing = _facing(normals, rays.directions)
        first, second, *sides = (ranges * _farther(facing, _facing(normals, edge)) for edge in rays.edges)
        if shape:
            first, second = _between(first, second, ranges, np.where(echoing, rays.object, -1), shape)
        facing = self._smoothed(facing, rays, turn)
        if self._glint:
            strengths *= self._glints(facing, rays.object)
        energy = np.where(echoing, strengths * facing * rays.weights / ranges**2, 0.0)
        energy *= 10.0 ** (-0.2 * self.absorption * ranges)
        near, far = ranges, ranges
        for edge in (first, second, *sides):
            near, far = np.minimum(near, edge), np.maximum(far, edge)
        echoes = Echoes(np.where(echoing, ranges, np.inf), near, far, energy, rays.beam, rays.object)
        return motion.apply(echoes, rays.directions, self._aperture.receive) if motion else echoes, facing

    def _glints(self, facing: Floats, objects: NDArray[np.int32]) -> Floats:
        """Return how many times as strong as by Lambert's rule each ray's echo is, by its cosine of incidence.

        A smooth thing's facets mirror the sound that meets them at a right angle; their slopes are normally
        distributed. The seabed, the surface and second echoes have no glint.
        """
        smooth = (objects > SEABED) & (objects != self.surface)
        squares = np.maximum(facing * facing, 1e-4)  # of the cosine; the tangent's follow
        lobe: Floats = np.exp((1.0 - 1.0 / squares) / (2.0 * _SLOPE * _SLOPE))
        return np.where(smooth, 1.0 + self._glint * lobe, 1.0)

    def _smoothed(self, facing: Floats, rays: Rays, turn: Floats) -> Floats:
        """Return the cosines of incidence without the facets of the seabed's grid."""
        terrain = self._scene.world.terrain
        level = (rays.object == SEABED) & (rays.normals[:, 2] < -_STEEP) if terrain else np.zeros(1, bool)
        if terrain is None or not level.any():
            return facing
        to_north, to_east = smooth_slopes(terrain, rays.points[level, 0], rays.points[level, 1])
        along = rays.directions[level] @ turn.T
        cosines = (along[:, 2] - to_north * along[:, 0] - to_east * along[:, 1]) / np.sqrt(
            to_north * to_north + to_east * to_east + 1.0
        )
        facing = facing.copy()
        facing[level] = np.maximum(cosines, 0.0)
        return facing

    def _second(self, mirrors: Mirrors, place: Any, turn: Floats, rays: Rays) -> list[Echoes]:
        view = View(np.asarray(place), turn, self._aperture.lattice, self._aperture.height, self._reach)
        return second_echoes(mirrors, self._rays, view, rays, self._strengths, self.surface, self.absorption)


def _facing(normals: Floats, directions: Floats) -> Floats:
    cosines: Floats = -np.einsum("ri,ri->r", normals, directions)
    return cosines


def _farther(middle: Floats, edge: Floats) -> Floats:
    """Return how many times as far as its middle a plane's edge is, from the cosines of incidence of the two."""
    grazing = edge * STRETCH <= middle
    times: Floats = np.where(grazing, STRETCH, middle / np.where(grazing, 1.0, edge))
    return np.maximum(times, 1.0 / STRETCH)


def _between(
    first: Floats, second: Floats, ranges: Floats, objects: Any, shape: tuple[int, ...]
) -> tuple[Floats, Floats]:
    """Return the edges, none beyond what the next ray of the beam has met of the same thing.

    On a plane they never are; where the surface bends away, its tangent does not show how far it goes.
    """
    first, second, ranges, objects = (x.reshape(shape) for x in (first, second, ranges, objects))
    same = objects[:, 1:] == objects[:, :-1]
    low, high = np.minimum(ranges[:, 1:], ranges[:, :-1]), np.maximum(ranges[:, 1:], ranges[:, :-1])
    low, high = np.where(same, low, 0.0), np.where(same, high, np.inf)
    first[:, 1:] = np.clip(first[:, 1:], low, high)
    second[:, :-1] = np.clip(second[:, :-1], low, high)
    return first.ravel(), second.ravel()


def _within(near: Floats, far: Floats, ranges: Floats, energy: Floats, objects: Any) -> tuple[Floats, Floats]:
    """Return the edges, none before the first place that any ray has met of the same object, none far behind the last.

    The tangent at the side of a ball comes far nearer than the ball does, and goes far behind it. An edge is at most as
    far behind its ray's hit as all hits of the object are apart, which leaves those of a plane as they are.
    """
    on = (objects > SEABED) & (energy > 0.0)
    if not on.any():
        return near, far
    number = int(objects.max()) + 1
    first, last = np.full(number, np.inf), np.zeros(number)
    met = objects[on]
    np.minimum.at(first, met, ranges[on])
    np.maximum.at(last, met, ranges[on])
    near, far = near.copy(), far.copy()
    near[on] = np.maximum(near[on], first[met])
    far[on] = np.minimum(far[on], ranges[on] + (last - first)[met])
    return near, far

"""A sonar's ping: rays into the world, split at small objects, and the echoes that they return.

The equations are in sim/sensors/imaging/echoes.py.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.common.vectors import Quaternion
from sim.dynamics import State
from sim.environment.bottom import PROPERTIES
from sim.environment.seawater.absorption import francois_garrison
from sim.environment.texture import Texture, smooth_slopes
from sim.rays.scene import SEABED, RayScene
from sim.rays.solids import Solid, half_space
from sim.rays.splitting import Cells, Lattice, split
from sim.rotations import matrix, multiply
from sim.sensors.imaging.bottom_echo import apply_texture
from sim.sensors.imaging.echoes import (
    MARGIN,
    STRETCH,
    Aperture,
    Bins,
    Echoes,
    Floats,
    Ground,
    Rays,
    beam_pattern,
)
from sim.sensors.imaging.ping_motion import PingMotion, sonar_motion
from sim.sensors.imaging.reverberation import volume_echoes
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion

_CLIFF = 0.3  # of a unit normal's z: steeper faces are cliffs, whose slope is not smoothed
_NO_ECHO = -200.0  # dB: a strength that stands for none
_GLINT_SLOPE = 0.1  # rms slope of the facets of a smooth surface: the width of its glint


class Pinger:
    """Sends pings through an aperture into the world of `scene`.

    `model` is that of an imaging sonar. `absorption` is in dB/m, `surface` the object number of the water's surface.
    """

    def __init__(self, scene: Scene, mounting: Mounting, aperture: Aperture, model: Any) -> None:
        self._scene, self._mounting, self._aperture = scene, mounting, aperture
        self._reach, self._volume_strength = MARGIN * model.max_range, model.volume_strength
        self.absorption = francois_garrison(model.frequency, model.temperature, model.salinity)
        self._rays = RayScene(scene.world)
        self.surface = surface = self._rays.add(half_space((0.0, 0.0, 1.0), 0.0))
        self._object_strength = 10.0 ** (model.object_strength / 10.0)
        self._glint = 10.0 ** (model.glint / 10.0) - 1.0
        self._strengths = np.full(surface + 2, self._object_strength)  # by object; NOTHING is the last one
        bottom = scene.world.bottom
        self._texture = Texture(bottom) if bottom else None
        kind_gain = PROPERTIES[bottom.kind].echo if bottom else 0.0
        self._strengths[0] = 10.0 ** ((model.seabed_strength + kind_gain) / 10.0)
        for number, _, echo in scene.world.appearances():
            self._strengths[number] *= 10.0 ** (echo / 10.0)
        has_surface = model.surface_strength > _NO_ECHO
        self._strengths[surface] = 10.0 ** (model.surface_strength / 10.0) if has_surface else 0.0
        self._strengths[-1] = 0.0
        beams, rays = aperture.weights.shape
        self._directions = np.ascontiguousarray(aperture.directions.reshape(-1, 3), dtype=float)
        edges = aperture.edges[:, :-1], aperture.edges[:, 1:], *aperture.side_edges
        self._edges = tuple(edge.reshape(-1, 3) for edge in edges)
        self._beam = np.repeat(np.arange(beams), rays)

    def add(self, solid: Solid, state: State) -> None:
        """Add a solid that moves with a vehicle's `state`; it has the strength of objects."""
        number = self._rays.add(solid, state)
        self._strengths = np.insert(self._strengths, number, self._object_strength)

    def ping(self, time_ns: int, state: State, head_rotation: Quaternion | None = None) -> Echoes | None:
        """Return the echoes of one ping, with the effects of the sonar's motion; None out of the water.

        `head_rotation` turns the axes of a rotating head to the sensor's.
        """
        position = self._mounting.world_position(state)
        if position[2] <= 0.0 or submersion(self._scene, time_ns, position) <= 0.0:
            return None
        attitude = self._mounting.attitude(state)
        rotation = np.array(matrix(multiply(attitude, head_rotation) if head_rotation else attitude)).reshape(3, 3)
        weights = self._aperture.weights.ravel()
        rays = self._cast(position, rotation, self._directions, self._edges, weights, self._beam)
        motion = sonar_motion(state, self._mounting, head_rotation)
        echoes, cos_incidence = self._echoes(rays, rotation, motion, self._aperture.weights.shape)
        lattice = self._aperture.lattice
        cells = lattice and split(lattice, self._rays, position, rotation, self._reach, rays.object)
        groups = [echoes]
        if lattice and cells:
            echoes.energy[cells.parent] = 0.0
            groups.append(
                self._echoes(self._cast(position, rotation, *self._split_rays(lattice, cells)), rotation, motion)[0]
            )
        ground = Ground(position, rays.points, cos_incidence, self._aperture.weights.shape)
        ranges, near, far, energy, beam, objects = (
            np.concatenate(part) for part in zip(*[part[:-1] for part in groups], strict=True)
        )
        near, far = _limit_by_hits(near, far, ranges, energy, objects)
        return Echoes(ranges, near, far, energy, beam, objects, ground)

    def distribute(self, echoes: Echoes, bins: Bins, stride: int = 1) -> Floats:
        """Return the echoes by beam and bin (beams x bins, echo / source), with texture and the water's reverberation.

        `stride` is that of sim.sensors.imaging.bottom_echo.apply_texture.
        """
        weights = self._aperture.weights
        if self._texture is None:
            echoed = bins.distribute(echoes, len(weights))
        else:
            seabed = echoes.object == SEABED
            on_seabed = bins.distribute(echoes, len(weights), seabed)
            echoed = bins.distribute(echoes, len(weights), ~seabed)
            echoed = echoed + apply_texture(on_seabed, echoes, bins, self._texture, stride)
        if self._volume_strength <= _NO_ECHO:
            return echoed
        return echoed + volume_echoes(echoes, bins, weights, self._volume_strength)

    def _cast(
        self, position: Any, rotation: Floats, directions: Floats, edges: tuple[Floats, ...], weights: Floats,
        beam: NDArray[np.int64],
    ) -> Rays:  # fmt: skip
        hits = self._rays.hits(position, directions, self._reach, rotation.ravel().tolist())
        normals, points = (np.frombuffer(vectors).reshape(directions.shape) for vectors in (hits.normals, hits.points))
        objects = np.frombuffer(hits.objects, np.int32)
        return Rays(directions, edges, weights, beam, np.frombuffer(hits.distances), points, normals, objects)

    def _split_rays(self, lattice: Lattice, cells: Cells) -> tuple[Floats, tuple[Floats, ...], Floats, Any]:
        """Return the directions, edges, weights and beams of split rays."""
        upper, lower = cells.down - cells.half_down, cells.down + cells.half_down
        weights = 2.0 * cells.half_across * (np.sin(lower) - np.sin(upper))
        weights *= beam_pattern(cells.down, self._aperture.height) ** 2
        if self._aperture.column_weights is not None:
            weights *= self._aperture.column_weights[cells.column]
        edges = lattice.unit(cells.across, upper), lattice.unit(cells.across, lower)
        return lattice.unit(cells.across, cells.down), edges, weights, cells.column

    def _echoes(
        self, rays: Rays, rotation: Floats, motion: PingMotion, shape: tuple[int, ...] | None = None
    ) -> tuple[Echoes, Floats]:
        """Return the echoes of rays and their cosines of incidence; `shape` (beams x rays) for the aperture's own."""
        strengths = self._strengths[rays.object]
        if kinds := self._scene.world.bottom_map:
            bed = rays.object == SEABED
            strengths[bed] *= kinds.echoes(rays.points[bed, 0], rays.points[bed, 1], self._scene.world.bottom)
        echoing = (strengths > 0.0) & (rays.ranges > 0.0)
        ranges = np.where(echoing, rays.ranges, 1.0)
        normals = np.where(echoing[:, None], rays.normals @ rotation, -rays.directions)
        cos_incidence = _cos_incidence(normals, rays.directions)
        first, second, *side_edges = (
            ranges * _range_ratio(cos_incidence, _cos_incidence(normals, edge)) for edge in rays.edges
        )
        if shape:
            first, second = _limit_by_neighbours(first, second, ranges, np.where(echoing, rays.object, -1), shape)
        cos_incidence = self._smooth_incidence(cos_incidence, rays, rotation)
        if self._glint:
            strengths *= self._glint_gain(cos_incidence, rays.object)
        energy = np.where(echoing, strengths * cos_incidence * rays.weights / ranges**2, 0.0)
        energy *= 10.0 ** (-0.2 * self.absorption * ranges)
        near, far = ranges, ranges
        for edge in (first, second, *side_edges):
            near, far = np.minimum(near, edge), np.maximum(far, edge)
        echoes = Echoes(np.where(echoing, ranges, np.inf), near, far, energy, rays.beam, rays.object)
        return motion.apply(echoes, rays.directions, self._aperture.receiver_pattern), cos_incidence

    def _glint_gain(self, cos_incidence: Floats, objects: NDArray[np.int32]) -> Floats:
        """Return the factor of each ray's echo over that of Lambert's rule, by its cosine of incidence.

        The facets of a smooth surface reflect sound specularly at normal incidence. Their slopes are normally
        distributed. The seabed and the water's surface have no glint.
        """
        smooth = (objects > SEABED) & (objects != self.surface)
        squares = np.maximum(cos_incidence * cos_incidence, 1e-4)  # of the cosine; tan² = 1 / cos² - 1
        lobe: Floats = np.exp((1.0 - 1.0 / squares) / (2.0 * _GLINT_SLOPE * _GLINT_SLOPE))
        return np.where(smooth, 1.0 + self._glint * lobe, 1.0)

    def _smooth_incidence(self, cos_incidence: Floats, rays: Rays, rotation: Floats) -> Floats:
        """Return the cosines of incidence on a smooth seabed, without the facets of the terrain grid."""
        terrain = self._scene.world.terrain
        if terrain is None:
            return cos_incidence
        level = (rays.object == SEABED) & (rays.normals[:, 2] < -_CLIFF)
        to_north, to_east = smooth_slopes(terrain, rays.points[level, 0], rays.points[level, 1])
        along = rays.directions[level] @ rotation.T
        cosines = (along[:, 2] - to_north * along[:, 0] - to_east * along[:, 1]) / np.sqrt(
            to_north * to_north + to_east * to_east + 1.0
        )
        cos_incidence = cos_incidence.copy()
        cos_incidence[level] = np.maximum(cosines, 0.0)
        return cos_incidence


def _cos_incidence(normals: Floats, directions: Floats) -> Floats:
    cosines: Floats = -np.einsum("ri,ri->r", normals, directions)
    return cosines


def _range_ratio(middle: Floats, edge: Floats) -> Floats:
    """Return the range of a plane patch's edge over that of its middle, from their cosines of incidence."""
    grazing = edge * STRETCH <= middle
    times: Floats = np.where(grazing, STRETCH, middle / np.where(grazing, 1.0, edge))
    return np.maximum(times, 1.0 / STRETCH)


def _limit_by_neighbours(
    first: Floats, second: Floats, ranges: Floats, objects: Any, shape: tuple[int, ...]
) -> tuple[Floats, Floats]:
    """Return the ranges of the edges, limited by the hits of the beam's next rays on the same object.

    On a plane this changes nothing. On a curved surface the tangent plane would place the edges too far away.
    """
    first, second, ranges, objects = (x.reshape(shape) for x in (first, second, ranges, objects))
    same = objects[:, 1:] == objects[:, :-1]
    low, high = np.minimum(ranges[:, 1:], ranges[:, :-1]), np.maximum(ranges[:, 1:], ranges[:, :-1])
    low, high = np.where(same, low, 0.0), np.where(same, high, np.inf)
    first[:, 1:] = np.clip(first[:, 1:], low, high)
    second[:, :-1] = np.clip(second[:, :-1], low, high)
    return first.ravel(), second.ravel()


def _limit_by_hits(near: Floats, far: Floats, ranges: Floats, energy: Floats, objects: Any) -> tuple[Floats, Floats]:
    """Return the near and far edges (m), limited to the extent of the hits on the same object.

    The tangent plane at the side of a ball extends far in front of the ball and far behind it. A near edge is therefore
    not nearer than the object's nearest hit. A far edge is behind its hit by at most the range between the object's
    nearest and farthest hits, which does not change the edges of a plane.
    """
    on_object = (objects > SEABED) & (energy > 0.0)
    number = int(objects.max()) + 1
    first, last = np.full(number, np.inf), np.zeros(number)
    hit_objects = objects[on_object]
    np.minimum.at(first, hit_objects, ranges[on_object])
    np.maximum.at(last, hit_objects, ranges[on_object])
    near, far = near.copy(), far.copy()
    near[on_object] = np.maximum(near[on_object], first[hit_objects])
    far[on_object] = np.minimum(far[on_object], ranges[on_object] + (last - first)[hit_objects])
    return near, far

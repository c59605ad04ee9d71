"""Common part of sensors that measure along beams: directions of rays, and errors of returns."""

from array import array
from collections.abc import Iterable, Sequence
from math import cos, inf, isfinite, pi, sin, sqrt
from random import Random

from hil.common.vectors import Quaternion, Vector3
from sim.dynamics import State
from sim.rays.scene import Hits, RayScene
from sim.rotations import matrix, multiply
from sim.sensors.error import ErrorModel, ErrorProcess
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion

Limits = tuple[float, float]


class Beams:
    """Thin beams along `directions` (unit vectors in the sensor's axes), up to `reach` m long.

    They hit the seabed and the obstacles of the scene's world. Not modelled: the water's surface, refraction, second
    echoes.
    """

    def __init__(self, scene: Scene, mounting: Mounting, directions: Iterable[Vector3], reach: float) -> None:
        self._scene = scene
        self._mounting = mounting
        self._mounting_rotation = mounting.quaternion
        self._directions = array("d", [x for direction in directions for x in direction])
        self._reach = reach
        self._rays = RayScene(scene.world)
        self._nothing = [inf] * (len(self._directions) // 3)

    def ranges(self, time_ns: int, state: State, head_rotation: Quaternion | None = None) -> Sequence[float]:
        """Return the true distance along each beam (m): inf without an echo, all inf out of the water.

        `head_rotation` turns the axes of a rotating head to the sensor's.
        """
        position = self._mounting.world_position(state)
        if submersion(self._scene, time_ns, position) <= 0.0:
            return self._nothing
        rotation = multiply(self._mounting_rotation, head_rotation) if head_rotation else self._mounting_rotation
        return self._rays.ranges(position, self._directions, self._reach, matrix(multiply(state.quaternion, rotation)))

    def echoes(self, time_ns: int, state: State) -> tuple[Hits, list[float]] | None:
        """Return the hits of the beams, and the cosines of incidence (nan without an echo); None out of the water."""
        position = self._mounting.world_position(state)
        if submersion(self._scene, time_ns, position) <= 0.0:
            return None
        rotation = matrix(multiply(state.quaternion, self._mounting_rotation))
        hits = self._rays.hits(position, self._directions, self._reach, rotation)
        (x, y, z), points, normals = position, hits.points, hits.normals
        cosines = [
            ((x - points[i]) * normals[i] + (y - points[i + 1]) * normals[i + 1] + (z - points[i + 2]) * normals[i + 2])
            / distance if distance else 1.0
            for i, distance in zip(range(0, len(points), 3), hits.distances, strict=True)
        ]  # fmt: skip
        return hits, cosines


class RangeErrors:
    """The errors of one device that measures many distances at once, every `period` s.

    Constant errors and the bias are common to all beams; each beam has its own noise.
    """

    def __init__(self, model: ErrorModel, period: float, random: Random, limits: Limits) -> None:
        slow = model._replace(noise=0.0, noise_density=0.0, noise_share=0.0, outliers=0.0, resolution=0.0, limit=0.0)
        self._drift = ErrorProcess(slow, period, random)
        self._gain = self._drift.numbers()[0]
        self._noise = sqrt(model.noise**2 + model.noise_density**2 / period)
        self._resolution, self._limit = model.resolution, model.limit
        self._noise_share, self._outliers, self._outlier = model.noise_share, model.outliers, model.outlier
        self._gauss, self._uniform = random.gauss, random.random
        self._limits = limits

    def measure(self, true: Sequence[float]) -> tuple[float, ...]:
        """Return one measurement of each `true` distance (m); advance time by one period.

        True distances above the limits give inf, those below give -inf.
        """
        gain, drift, noise, gauss = self._gain, self._drift.measure(0.0), self._noise, self._gauss
        values = [gain * x + drift + gauss(0.0, noise) for x in true] if noise else [gain * x + drift for x in true]
        if share := self._noise_share:
            values = [x + gauss(0.0, share * x) if isfinite(x) else x for x in values]
        if self._outliers:
            values = [x + gauss(0.0, self._outlier) if self._uniform() < self._outliers else x for x in values]
        if step := self._resolution:
            values = [round(x / step) * step if isfinite(x) else x for x in values]
        if limit := self._limit:
            values = [min(x, limit) for x in values]
        return apply_limits(values, true, self._limits)


def apply_limits(values: Sequence[float], true: Sequence[float], limits: Limits) -> tuple[float, ...]:
    """Return `values`, with inf where the `true` distance is above the limits (m), and -inf where it is below."""
    near, far = limits
    return tuple([x if near <= t <= far else inf if t > far else -inf for x, t in zip(values, true, strict=True)])


def cone(width: float, height: float, rings: int) -> list[Vector3]:
    """Return unit vectors that fill a beam about x, `width` rad to the sides (y), `height` rad up and down (z).

    There is one in the middle, and 6, 12, 18, ... on `rings` ellipses. The last ellipse is the edge of the beam.
    """
    directions = [(1.0, 0.0, 0.0)]
    for ring in range(1, rings + 1):
        share = 0.5 * ring / rings
        for i in range(6 * ring):
            angle = 2.0 * pi * i / (6 * ring)
            starboard, down = share * width * cos(angle), share * height * sin(angle)
            directions.append((cos(starboard) * cos(down), sin(starboard) * cos(down), sin(down)))
    return directions

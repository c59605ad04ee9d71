"""Render a camera's picture: cast the rays of its pixels, and compute the light along them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from sim.dynamics import State
from sim.environment.optics import CLEAR, Water, jerlov, underwater
from sim.rays.geometry import Hits
from sim.rays.scene import NOTHING, RayScene
from sim.rays.solids import Solid, half_space
from sim.rotations import matrix
from sim.sensors.imaging.camera.effects import Effects
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.motion import RawPicture
from sim.sensors.imaging.samples import Distortion, Intrinsics
from sim.sensors.imaging.scenery import Scenery, SurfaceHits
from sim.sensors.imaging.shading import Shading
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion
from sim.twins import load_picture

Floats = NDArray[np.floating[Any]]

_DEPTH_STEP = 0.1  # m: steps of depth at which the water's properties are computed, so that they are reused
_UNDISTORTED = 1e-6  # of the focal length: less than a thousandth of a pixel


class PictureRenderer:
    """Renders the world of `scene`; `axial` (n) is the cosine of each pixel's angle to the optical axis."""

    def __init__(
        self, model: CameraModel, intrinsics: Intrinsics, mounting: Mounting, scene: Scene, seed: int = 0
    ) -> None:
        self._model, self._mounting, self._scene = model, mounting, scene
        directions = pixel_rays(model.width, model.height, intrinsics, model.distortion)
        self.axial = directions[:, 0].astype(np.float32)
        self._directions = directions
        self._toward = directions.astype(np.float32)
        self._pixel = 1.0 / intrinsics.fx  # rad in the middle
        self._rays = RayScene(scene.world.as_seen())
        self._surface = self._rays.add(half_space((0.0, 0.0, 1.0), 0.0))
        self._scenery = Scenery(scene.world.as_seen(), self._surface)
        self._water, self._water_depth = CLEAR, np.nan  # m: none yet
        self._effects = Effects(model, intrinsics.fx, self._toward, seed)
        can_shade = self._scenery.bottom_map is None and not self._effects.changes_light
        compiled = load_picture() if can_shade else None
        self._shading = Shading(compiled, self._scenery, self._pixel, model.max_range) if compiled else None

    def add(self, solid: Solid, state: State) -> None:
        """Add a solid that moves with a vehicle's `state`."""
        self._scenery.add(self._rays.add(solid, state))

    def render(self, time_ns: int, state: State) -> tuple[NDArray[np.float32], Floats, NDArray[np.int32]]:
        """Return each pixel's radiance at the lens (n x 3), range (n, m; inf without a hit) and object number (n)."""
        mounting, lights = self._mounting, 1.0
        if accessories := self._scene.accessories:
            lights = accessories.lights(time_ns)
            mounting = mounting.tilted(accessories.tilt(time_ns)) if self._model.tilts else mounting
        position = mounting.world_position(state)
        count = len(self._directions)
        if position[2] <= 0.0 or submersion(self._scene, time_ns, position) <= 0.0:
            return np.zeros((count, 3), np.float32), np.full(count, np.inf), np.full(count, NOTHING, np.int32)
        rotation = matrix(mounting.attitude(state))
        water, effects, axes = self._water_at(position[2]), self._effects, np.array(rotation).reshape(3, 3)
        radiance, ranges, objects = self._trace(position, rotation, axes, water, lights)
        radiance = effects.add_water_effects(radiance, ranges, position, axes, water, lights)
        return effects.apply_motion(RawPicture(radiance, ranges, objects), mounting, state.nu)

    def _trace(
        self, position: Any, rotation: Any, axes: Any, water: Water, lights: float
    ) -> tuple[NDArray[np.float32], Floats, NDArray[np.int32]]:
        """Return the same as `render`, without backscatter, particles and motion."""
        m, shading = self._model, self._shading
        lamps = lights * m.lamps
        if shading and (geometry := self._rays.compiled(position, m.max_range)):
            return shading.cast(geometry, position, rotation, self._directions, lamps, water)
        hits = self._rays.hits(position, self._directions, m.max_range, rotation)
        return self._compute_light(hits, position, axes, water, lamps)

    def _compute_light(
        self, hits: Hits, position: Any, axes: Any, water: Water, lamps: float
    ) -> tuple[NDArray[np.float32], Floats, NDArray[np.int32]]:
        """Return the radiance at the lens (n x 3) of `hits`, with lamps beside the camera, their ranges and objects."""
        ranges, objects = np.asarray(hits.distances), np.asarray(hits.objects)
        points, normals = (_rows(np.asarray(vectors), objects) for vectors in (hits.points, hits.normals))
        cos_incidence = -np.einsum("ir,ri->r", axes.astype(np.float32).T @ normals, self._toward)
        distances = ranges.astype(np.float32)
        surfaces = SurfaceHits(points, normals, objects, distances, cos_incidence, distances * np.float32(self._pixel))
        lights = self._effects.lamp_lights(self._rays, position, axes, surfaces)
        radiance = self._scenery.radiance(surfaces, water.light, lamps, water.attenuation, lights, water.veil)
        return underwater(radiance, ranges, water), ranges, objects

    def points(self, depth: bytes) -> bytes:
        """Return the points of a picture's depths in the sensor's axes (see CameraSample), nan where a depth is inf."""
        ahead = np.frombuffer(depth, np.float32).copy()
        ahead[np.isinf(ahead)] = np.nan
        positions: bytes = (self._toward * (ahead / self.axial)[:, None]).tobytes()
        return positions

    def _water_at(self, depth: float) -> Water:
        """Return the optical properties of the water at a `depth` in m."""
        depth = round(depth / _DEPTH_STEP) * _DEPTH_STEP
        if depth != self._water_depth and not self._model.ground_truth:
            self._water, self._water_depth = jerlov(self._model.water, depth), depth
        return self._water


def _rows(vectors: Floats, objects: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return vectors as 3 x n instead of n x 3, float32, 0 for rays without a hit."""
    rows = np.ascontiguousarray(vectors.reshape(-1, 3).T, np.float32)
    rows[:, objects == NOTHING] = 0.0
    return rows


def pixel_rays(width: int, height: int, intrinsics: Intrinsics, distortion: Distortion) -> NDArray[np.float64]:
    """Return the unit vector of each pixel's ray (n x 3), row by row: x along the optical axis, y right, z down."""
    x, y = np.meshgrid(
        (np.arange(width) - intrinsics.cx) / intrinsics.fx, (np.arange(height) - intrinsics.cy) / intrinsics.fy
    )
    if any(distortion):
        x, y = undistort(x, y, distortion)
    rays = np.stack([np.ones_like(x), x, y], axis=-1).reshape(-1, 3)
    unit: NDArray[np.float64] = rays / np.sqrt((rays * rays).sum(axis=1, keepdims=True))
    return unit


def distort(x: Floats, y: Floats, distortion: Distortion) -> tuple[Floats, Floats]:
    """Return the image of (x, y) on the plane at distance 1 through a lens (Brown 1971; "plumb_bob" in ROS, OpenCV)."""
    k1, k2, p1, p2, k3 = distortion
    r = x * x + y * y
    radial = 1.0 + r * (k1 + r * (k2 + r * k3))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x),
        y * radial + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def undistort(x: Floats, y: Floats, distortion: Distortion) -> tuple[Floats, Floats]:
    """Return the point whose image by `distort` is (x, y), by fixed-point iteration.

    Raises ConfigError for a lens that folds the picture.
    """
    u, v = x, y
    with np.errstate(all="ignore"):
        for _ in range(100):
            a, b = distort(u, v, distortion)
            u, v = u + (x - a), v + (y - b)
        if not np.hypot(x - a, y - b).max() < _UNDISTORTED:
            raise ConfigError("distortion: this lens folds the picture, some pixels see nothing; make k1 to k3 smaller")
    return u, v

"""Render a camera's picture: rays of its pixels, and the light that its sensor records."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from sim.assembly import make_developer, make_shader
from sim.dynamics import State
from sim.environment.optics import CLEAR, GREY, Water, encode, jerlov, underwater
from sim.environment.world import World
from sim.rays.geometry import Hits
from sim.rays.scene import NOTHING, RayScene
from sim.rays.solids import Solid, half_space
from sim.rotations import matrix
from sim.sensors.error import sensor_random
from sim.sensors.imaging.camera.effects import Effects, Shot
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.samples import Distortion, Intrinsics
from sim.sensors.imaging.scenery import Scenery, Seen
from sim.sensors.imaging.shading import Shading
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion

Floats = NDArray[np.floating[Any]]

_DEPTH_STEP = 0.1  # m: how exactly the water knows its depth, so that it need not be computed for every picture
_UNDISTORTED = 1e-6  # of the focal length: less than a thousandth of a pixel
_BRIGHT, _NEARLY_WHITE = 98.0, 0.9  # automatic exposure: this percentile gets this far


class Eye:
    """The rays of a camera into the world of `scene`; `axial` is the cosine of each off the optical axis."""

    def __init__(
        self, model: CameraModel, intrinsics: Intrinsics, mounting: Mounting, scene: Scene, seed: int = 0
    ) -> None:
        self._model, self._mounting, self._scene = model, mounting, scene
        directions = pixel_rays(model.width, model.height, intrinsics, model.distortion)
        self.axial = directions[:, 0].astype(np.float32)
        self._directions = directions
        self._toward = directions.astype(np.float32)
        self._pixel = 1.0 / intrinsics.fx  # rad in the middle
        self._rays = _rays(model, intrinsics.fx, scene.world, directions)
        self._surface = self._rays.add(half_space((0.0, 0.0, 1.0), 0.0))
        self._scenery = Scenery(scene.world, self._surface)
        self._water, self._water_depth = CLEAR, -1.0
        self._effects = Effects(model, intrinsics.fx, self._toward, seed)
        can_shade = self._scenery.bottom_map is None and not self._effects.change_light
        call = make_shader() if can_shade else None
        self._shading = Shading(call, self._scenery, self._toward, self._pixel, model.max_range) if call else None

    def add(self, solid: Solid, state: State) -> None:
        """Put a solid there that goes with a vehicle's `state`."""
        self._scenery.add(self._rays.add(solid, state))

    def render(self, time_ns: int, state: State) -> tuple[NDArray[np.float32], Floats, NDArray[np.int32]]:
        """Return for each pixel the radiance (n x 3) at the lens, range (m, inf for nothing) and object."""
        place = self._mounting.place(state)
        count = len(self._directions)
        if place[2] <= 0.0 or submersion(self._scene, time_ns, place) <= 0.0:
            return np.zeros((count, 3), np.float32), np.full(count, np.inf), np.full(count, NOTHING, np.int32)
        rotation = matrix(self._mounting.attitude(state))
        hits = self._rays.hits(place, self._directions, self._model.max_range, rotation)
        ranges, objects = np.asarray(hits.distances), np.asarray(hits.objects)
        water, effects, turned = self._around(place[2]), self._effects, np.array(rotation).reshape(3, 3)
        if self._shading:
            wet = self._shading.shade(hits, place, rotation, self._model.lamps, water)
        else:
            wet = self._lit(hits, time_ns, place, turned, water)
        wet = effects.water(wet, ranges, place, turned, water)
        return effects.move(Shot(wet, ranges, objects), self._mounting, state.nu)

    def _lit(self, hits: Hits, time_ns: int, place: Any, turned: Any, water: Water) -> NDArray[np.float32]:
        """Return the radiance (n x 3) at the lens of what is met, with all effects of light."""
        ranges, objects = np.asarray(hits.distances), np.asarray(hits.objects)
        points, normals = (_rows(np.asarray(vectors), objects) for vectors in (hits.points, hits.normals))
        facing = -np.einsum("ir,ri->r", turned.astype(np.float32).T @ normals, self._toward)
        distances = ranges.astype(np.float32)
        seen = Seen(points, normals, objects, distances, facing, distances * np.float32(self._pixel))
        effects = self._effects
        lights = effects.beams(self._rays, place, turned, seen), effects.dapple(seen, time_ns)
        radiance = self._scenery.radiance(seen, water.light, self._model.lamps, water.attenuation, *lights)
        return underwater(radiance, ranges, water)

    def points(self, depth: bytes) -> bytes:
        """Return where a picture's depths (see CameraSample) are in the sensor's axes, nan where they are inf."""
        ahead = np.frombuffer(depth, np.float32).copy()
        ahead[np.isinf(ahead)] = np.nan
        places: bytes = (self._toward * (ahead / self.axial)[:, None]).tobytes()
        return places

    def _around(self, depth: float) -> Water:
        """Return the water at a depth in m."""
        depth = round(depth / _DEPTH_STEP) * _DEPTH_STEP
        if depth != self._water_depth and not self._model.ground_truth:
            self._water, self._water_depth = jerlov(self._model.water, depth), depth
        return self._water


class Development:
    """Conversion of radiances to bytes: vignetting, exposure, noise, sRGB; and the errors of depth."""

    def __init__(self, model: CameraModel, axial: Floats, seed: int, topic: str) -> None:
        self._model, self._axial = model, axial
        self._falloff = (1.0 - model.vignetting * (1.0 - axial**4))[:, None].astype(np.float32)
        self._develop = make_developer()
        self._random = np.random.Generator(np.random.SFC64(sensor_random(seed, topic).getrandbits(64)))

    def develop(self, radiance: NDArray[np.float32], ranges: Floats) -> tuple[bytes, bytes]:
        """Return the picture and its depths; radiances n x 3, ranges n."""
        m = self._model
        depth = (ranges * self._axial).astype(np.float32)
        if m.ground_truth:
            signal = radiance * np.float32(m.exposure or automatic_exposure(radiance))
            return encode(signal).tobytes(), depth.tobytes()
        some = slice(None, None, max(1, len(radiance) // 4096))
        gain = m.exposure or automatic_exposure(radiance[some] * self._falloff[some])
        pixels = self._expose(radiance, gain)
        if m.depth and m.depth_noise:
            noise = self._random.standard_normal(depth.shape, np.float32) * np.float32(m.depth_noise)
            depth = np.maximum(depth * (1.0 + noise * np.minimum(depth, np.float32(m.max_range))), 0.0)
        return pixels, depth.astype(np.float32).tobytes()

    def _expose(self, radiance: NDArray[np.float32], gain: float) -> bytes:
        """Return the bytes of a picture with the noise of its electrons."""
        m = self._model
        noise = self._random.standard_normal((3, len(radiance)), np.float32)
        dark = (m.read_noise / m.full_well) ** 2
        if self._develop:
            grey = np.empty(radiance.shape, np.uint8)
            light = np.ascontiguousarray(radiance, np.float32)
            self._develop(gain, m.full_well, dark, light, self._falloff, noise, GREY, grey)
            return grey.tobytes()
        signal = radiance * self._falloff * np.float32(gain)
        shot = signal / np.float32(m.full_well) + np.float32(dark)
        return encode(signal + np.sqrt(shot) * noise.T).tobytes()


def _rays(model: CameraModel, focal: float, world: World, directions: NDArray[np.float64]) -> RayScene:
    """Return whatever finds what the pixels look at. Raises what PictureScene does."""
    if model.renderer == "rays":
        return RayScene(world)
    from sim.rays.opengl import PictureScene

    return PictureScene(world, model.width, model.height, focal, directions if any(model.distortion) else None)


def _rows(vectors: Floats, objects: NDArray[np.int32]) -> NDArray[np.float32]:
    """Three rows instead of three numbers a ray, 0 for nothing."""
    rows = np.ascontiguousarray(vectors.reshape(-1, 3).T, np.float32)
    rows[:, objects == NOTHING] = 0.0
    return rows


def automatic_exposure(light: Floats) -> float:
    """Return the factor that brings the bright parts of a picture (n x 3) nearly to white; 1 for one without light."""
    bright = float(np.percentile(light[:: max(1, len(light) // 4096)].max(axis=1), _BRIGHT))
    return _NEARLY_WHITE / bright if bright > 0.0 else 1.0


def pixel_rays(width: int, height: int, intrinsics: Intrinsics, distortion: Distortion) -> NDArray[np.float64]:
    """Return the unit vector along which each pixel looks, row after row: x along the optical axis, y right, z down."""
    x, y = np.meshgrid(
        (np.arange(width) - intrinsics.cx) / intrinsics.fx, (np.arange(height) - intrinsics.cy) / intrinsics.fy
    )
    if any(distortion):
        x, y = undistorted(x, y, distortion)
    rays = np.stack([np.ones_like(x), x, y], axis=-1).reshape(-1, 3)
    unit: NDArray[np.float64] = rays / np.sqrt((rays * rays).sum(axis=1, keepdims=True))
    return unit


def distorted(x: Floats, y: Floats, distortion: Distortion) -> tuple[Floats, Floats]:
    """Return where a lens puts what is at (x, y) of the plane at distance 1 (Brown 1971; ROS's "plumb_bob", OpenCV)."""
    k1, k2, p1, p2, k3 = distortion
    r = x * x + y * y
    radial = 1.0 + r * (k1 + r * (k2 + r * k3))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x),
        y * radial + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def undistorted(x: Floats, y: Floats, distortion: Distortion) -> tuple[Floats, Floats]:
    """Return what `distorted` puts at (x, y), by repeated correction.

    Raises ConfigError for a lens that folds the picture.
    """
    u, v = x, y
    with np.errstate(all="ignore"):
        for _ in range(100):
            a, b = distorted(u, v, distortion)
            u, v = u + (x - a), v + (y - b)
        if not np.hypot(x - a, y - b).max() < _UNDISTORTED:
            raise ConfigError("distortion: to some pixels nothing leads through this lens; make k1 to k3 smaller")
    return u, v

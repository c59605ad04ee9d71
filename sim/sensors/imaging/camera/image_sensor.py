"""The image sensor of a camera: vignetting, exposure, noise and sRGB encoding of light; noise of depth."""

from functools import lru_cache
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import GREY, encode
from sim.sensors.error import sensor_random
from sim.sensors.imaging.camera.model import CameraModel
from sim.twins import load_picture

Floats = NDArray[np.floating[Any]]

_BRIGHT, _NEARLY_WHITE = 98.0, 0.9  # automatic exposure: this percentile of light becomes this signal (white: 1)
_QUANTILE_BITS = 12
_WEYL, _FIRST, _SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


class ImageSensor:
    """Converts radiances to the bytes of a picture, and adds noise to depth.

    `axial` (n) is the cosine of each pixel's angle to the optical axis. If sim/native/exposure.h is compiled it is used
    instead; its result is equal within one of 256 levels.
    """

    def __init__(self, model: CameraModel, axial: Floats, seed: int, topic: str) -> None:
        self._model, self._axial = model, np.ascontiguousarray(axial, np.float32)
        self._falloff = (1.0 - model.vignetting * (1.0 - axial**4))[:, None].astype(np.float32)
        compiled = load_picture()
        self._develop = compiled.develop if compiled else None
        self._random = sensor_random(seed, topic)

    def develop(self, radiance: NDArray[np.float32], ranges: Floats) -> tuple[bytes, bytes]:
        """Return the bytes of the picture (uint8, n x 3) and of its depths (float32, n, m).

        `radiance` is n x 3, `ranges` (n) in m.
        """
        m = self._model
        if m.ground_truth:
            signal = radiance * np.float32(m.exposure or automatic_exposure(radiance))
            return encode(signal).tobytes(), (ranges * self._axial).astype(np.float32).tobytes()
        sampled = slice(None, None, max(1, len(radiance) // 4096))
        gain = m.exposure or automatic_exposure(radiance[sampled] * self._falloff[sampled])
        dark, key = (m.read_noise / m.full_well) ** 2, self._random.getrandbits(64)
        if not self._develop:
            return self._record_in_numpy(radiance, ranges, gain, dark, key)
        pixels, depths = np.empty(radiance.shape, np.uint8), np.empty(len(ranges), np.float32)
        light, distances = np.ascontiguousarray(radiance, np.float32), np.ascontiguousarray(ranges, np.float64)
        numbers = gain, m.full_well, dark, m.depth_noise, m.max_range
        self._develop(
            key, numbers, light, self._falloff, self._axial, distances, quantiles(), GREY, pixels, depths,
        )  # fmt: skip
        return pixels.tobytes(), depths.tobytes()

    def _record_in_numpy(
        self, radiance: NDArray[np.float32], ranges: Floats, gain: float, dark: float, key: int
    ) -> tuple[bytes, bytes]:
        """Return the bytes of the picture with the noise of its electrons, and those of the depths with noise."""
        m = self._model
        signal = radiance * self._falloff * np.float32(gain)
        variance = signal / np.float32(m.full_well) + np.float32(dark)
        noise = normal_noise(key, len(radiance))
        pixels = encode(signal + np.sqrt(variance) * noise[:3].T)
        depth = (ranges * self._axial).astype(np.float32)
        if m.depth_noise:
            error = noise[3] * np.float32(m.depth_noise) * np.minimum(depth, np.float32(m.max_range))
            depth = np.maximum(depth * (np.float32(1.0) + error), np.float32(0.0))
        return pixels.tobytes(), depth.tobytes()


def normal_noise(key: int, count: int) -> NDArray[np.float32]:
    """Return 4 x `count` normal numbers with standard deviation 1, the same for the same `key` (64 bits).

    The finaliser of splitmix64 (Steele, Lea & Flood 2014, Fast splittable pseudorandom number generators, OOPSLA)
    hashes each column's number to 64 bits. Each row uses twelve of them, so no number is beyond ±3.7.
    """
    bits = np.arange(count, dtype=np.uint64) * np.uint64(_WEYL) + np.uint64(key)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(_FIRST)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(_SECOND)
    bits ^= bits >> np.uint64(31)
    last = np.uint64((1 << _QUANTILE_BITS) - 1)
    return np.stack([quantiles().take((bits >> np.uint64(_QUANTILE_BITS * row)) & last) for row in range(4)])


@lru_cache(maxsize=1)
def quantiles() -> NDArray[np.float32]:
    """Return the middles of equally probable parts of a normal distribution, scaled to standard deviation 1."""
    count = 1 << _QUANTILE_BITS
    normal = NormalDist()
    middles = np.array([normal.inv_cdf((i + 0.5) / count) for i in range(count)])
    scaled: NDArray[np.float32] = (middles / middles.std()).astype(np.float32)
    return scaled


def automatic_exposure(light: Floats) -> float:
    """Return the factor that makes the bright parts of a picture (n x 3) nearly white; 1 without light."""
    bright = float(np.percentile(light[:: max(1, len(light) // 4096)].max(axis=1), _BRIGHT))
    return _NEARLY_WHITE / bright if bright > 0.0 else 1.0

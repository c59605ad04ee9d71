"""Marine snow before a camera, and caustics: sunlight that waves focus on the seabed."""

from itertools import product
from math import ceil, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Water
from sim.sensors.imaging.scenery import SurfaceHits

Floats = NDArray[np.float32]

_CELL = 0.5  # m: side of the cubes of water whose particles are drawn together
_MAX_DISTANCE, _MIN_DISTANCE = 2.5, 0.08  # m
_RADII = (0.0004, 0.003)  # m: least and greatest radius of visible aggregates; most are small
_ALBEDO = 0.5  # share of light that a particle reflects
_MIN_SPREAD, _MAX_SPREAD = 0.6, 12.0  # pixels: least and greatest radius of a particle's image
_FOCUS = 1.0  # m: distance of focus; particles at other distances are blurred
_APERTURE = 0.004  # m

_TILE, _SIDE = 256, 4.0  # nodes and m along a side of the pattern of caustics, which repeats
_WAVES, _FOCAL_DEPTH = 40, 1.2  # number of waves; depth (m) at which they focus best
_RMS_SLOPE = 0.12  # of a surface under a light breeze (Cox & Munk 1954: 0.06 to 0.2)
_BEND = 0.25  # deflection of a ray relative to the slope of the surface: 1 - 1 / 1.33
_DECAY_DEPTH = 7.0  # m of depth by which the contrast falls to 1/e
_GRAVITY = 9.81


class MarineSnow:
    """Marine snow: `density` particles per m³ with fixed positions in the water.

    `size` is the width and height of the picture and `focal` the focal length, in pixels.
    """

    def __init__(self, density: float, size: tuple[int, int], focal: float, seed: int) -> None:
        self._density, self._size, self._focal, self._seed = density, size, focal, seed

    def add_particles(
        self, radiance: Floats, ranges: Any, position: Any, rotation: Any, water: Water, lamps: tuple[float, float]
    ) -> Floats:
        """Return the radiance (n x 3) with the particles in front of a camera.

        `position` (NED, m) and `rotation` (3 x 3, to NED) are those of the camera, `ranges` (n, m) those of its pixels.
        `lamps` are their brightness and their distance beside the camera (m).
        """
        positions, radii = self._particles(np.asarray(position, np.float64))
        local = (positions - position) @ rotation
        ahead, distances = local[:, 0], np.sqrt((local * local).sum(axis=1))
        half = 0.5 * np.array(self._size)
        with np.errstate(divide="ignore", invalid="ignore"):
            centres = local[:, 1:] / ahead[:, None] * self._focal + half - 0.5
            visible = (
                (ahead > _MIN_DISTANCE)
                & (distances < _MAX_DISTANCE)
                & (np.abs(centres - half) < half + _MAX_SPREAD).all(axis=1)
            )
        centres, ahead, distances, radii = centres[visible], ahead[visible], distances[visible], radii[visible]
        sharp = radii / ahead * self._focal
        blurred = 0.5 * _APERTURE * np.abs(1.0 / ahead - 1.0 / _FOCUS) * self._focal
        spread = np.clip(np.hypot(sharp, blurred), _MIN_SPREAD, _MAX_SPREAD)
        # Blur spreads the light of a particle over a larger disc; a small particle covers only a part of a pixel.
        cover = np.minimum(1.0, (sharp / spread) ** 2)
        colours = self._colours(distances, water, lamps)
        transmission, added = np.ones(len(radiance), np.float32), np.zeros(radiance.shape, np.float32)
        reaches = np.ceil(2.0 * spread).astype(int)
        for reach in np.unique(reaches):
            same_size = reaches == reach
            pixels, squares = self._squares(centres[same_size], reach)
            share = np.exp(-squares / spread[same_size, None] ** 2) * cover[same_size, None]
            share *= (pixels >= 0) & (np.asarray(ranges)[pixels] > distances[same_size, None])
            np.multiply.at(transmission, pixels.ravel(), (1.0 - share).astype(np.float32).ravel())
            for channel in range(3):
                light = (share * colours[same_size, channel, None]).astype(np.float32)
                np.add.at(added[:, channel], pixels.ravel(), light.ravel())
        return radiance * transmission[:, None] + added

    def _squares(self, centres: Any, reach: int) -> tuple[NDArray[np.int64], Any]:
        """Return the pixels around each centre (-1 outside the picture) and their squared distances from it."""
        width, height = self._size
        steps = np.arange(-reach, reach + 1)
        columns = np.rint(centres[:, 0]).astype(np.int64)[:, None] + np.tile(steps, len(steps))
        rows = np.rint(centres[:, 1]).astype(np.int64)[:, None] + np.repeat(steps, len(steps))
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        squares = (columns - centres[:, :1]) ** 2 + (rows - centres[:, 1:]) ** 2
        return np.where(inside, rows * width + columns, -1), squares

    @staticmethod
    def _colours(distances: Any, water: Water, lamps: tuple[float, float]) -> Any:
        """Return the radiance (n x 3) of particles at `distances` (m) in daylight and lamplight, through water."""
        brightness, offset = lamps
        lit, attenuation = np.hypot(distances, offset)[:, None], np.array(water.attenuation)
        light = 0.5 * np.array(water.light) + brightness * np.exp(-attenuation * lit) / np.maximum(lit, 0.2) ** 2
        return _ALBEDO * light * np.exp(-attenuation * distances[:, None])

    def _particles(self, position: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return positions (NED, m) and radii (m) of nearby particles; each cube of water has its own."""
        middle = np.floor(position / _CELL).astype(np.int64)
        span = range(-ceil(_MAX_DISTANCE / _CELL), ceil(_MAX_DISTANCE / _CELL) + 1)
        cells = middle + np.array(list(product(span, span, span)), np.int64)
        near = np.linalg.norm((cells + 0.5) * _CELL - position, axis=1) < _MAX_DISTANCE + _CELL
        cells = cells[near]
        max_count = ceil(2.0 * self._density * _CELL**3) + 1
        draws = _uniform_numbers(cells, 5 * max_count + 1, self._seed)
        # The number in a cube is uniform between zero and twice its mean.
        count = np.floor(2.0 * self._density * _CELL**3 * draws[:, 0] + 0.5)
        draws = draws[:, 1:].reshape(len(cells), max_count, 5)
        is_present = np.arange(max_count) < count[:, None]
        positions = ((cells[:, None, :] + draws[..., :3]) * _CELL)[is_present]
        low, high = _RADII
        radii = low * (high / low) ** (draws[..., 3] ** 3)
        return positions, radii[is_present]


def _uniform_numbers(cells: NDArray[np.int64], count: int, seed: int) -> NDArray[np.float64]:
    """Return `count` uniform numbers from 0 to 1 for each cell, always the same for one cell (splitmix64)."""
    with np.errstate(over="ignore"):
        keys = np.full(len(cells), seed, np.uint64)
        for axis in range(3):
            keys = _mix_bits(keys * np.uint64(0x9E3779B97F4A7C15) + cells[:, axis].astype(np.uint64))
        steps = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        values = _mix_bits(keys[:, None] + steps[None, :])
    numbers: NDArray[np.float64] = (values >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return numbers


def _mix_bits(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    values = (values ^ (values >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    values = (values ^ (values >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed: NDArray[np.uint64] = values ^ (values >> np.uint64(31))
    return mixed


class Caustics:
    """Caustics: sunlight that waves on the surface focus on surfaces below; `contrast` is that at the best depth.

    The slopes of a few dozen waves, periodic over 4 m, refract the rays of a sun overhead. The pattern is their density
    on a plane 1.2 m below. It is used at all depths, weaker at greater depth.
    """

    def __init__(self, contrast: float, seed: int) -> None:
        self._contrast = contrast
        random = np.random.default_rng(seed)
        numbers = random.integers(-12, 13, (_WAVES, 2))
        numbers[~numbers.any(axis=1)] = (1, 2)
        self._vectors = numbers * (tau / _SIDE)  # rad/m: whole numbers of waves along a side
        lengths = np.linalg.norm(self._vectors, axis=1)
        self._rates = np.sqrt(_GRAVITY * lengths)  # rad/s, of deep water
        self._phases = random.uniform(0.0, tau, _WAVES)
        # Waves of all lengths have the same slope.
        self._slopes = self._vectors / lengths[:, None] * (_RMS_SLOPE * np.sqrt(2.0 / _WAVES))
        self._time_ns, self._tile = -1, np.ones((_TILE, _TILE), np.float32)

    def daylight_factor(self, surfaces: SurfaceHits, time_ns: int) -> Floats:
        """Return the factor of daylight at each hit (n), 1 on average; surfaces that do not face up have 1."""
        if time_ns != self._time_ns:
            self._time_ns, self._tile = time_ns, self._pattern(time_ns * 1e-9)
        north, east, down = surfaces.points
        scale = np.float32(_TILE / _SIDE)
        rows = (north * scale).astype(np.int64) & (_TILE - 1)
        columns = (east * scale).astype(np.int64) & (_TILE - 1)
        depth = np.maximum(down, np.float32(0.0))
        strength = np.minimum(depth / np.float32(_FOCAL_DEPTH), np.float32(1.0))
        strength *= np.exp((depth - np.float32(_FOCAL_DEPTH)).clip(0.0) * np.float32(-1.0 / _DECAY_DEPTH))
        strength *= np.float32(self._contrast) * np.clip(-surfaces.normals[2], 0.0, 1.0)
        daylight_factor: Floats = np.float32(1.0) + strength * (self._tile[rows, columns] - np.float32(1.0))
        return daylight_factor

    def _pattern(self, time: float) -> Floats:
        """Return the light at each node of the tile at `time` (s), 1 on average."""
        axis = (np.arange(_TILE) + 0.5) * (_SIDE / _TILE)
        phases = self._phases - self._rates * time
        # Each wave is the product of two exponentials, one along each axis.
        along = np.exp(1j * (axis[:, None] * self._vectors[None, :, 0] + phases[None, :]))
        across = np.exp(1j * axis[:, None] * self._vectors[None, :, 1])
        slopes = [((along * self._slopes[None, :, i]) @ across.T).real for i in range(2)]
        displacement = _BEND * _FOCAL_DEPTH * _TILE / _SIDE
        node = np.arange(_TILE)
        rows = (node[:, None] + displacement * slopes[0]).ravel()
        columns = (node[None, :] + displacement * slopes[1]).ravel()
        whole_rows, whole_columns = np.floor(rows).astype(np.int64), np.floor(columns).astype(np.int64)
        a, b = rows - whole_rows, columns - whole_columns
        tile = np.zeros(_TILE * _TILE)
        for i, j in product((0, 1), repeat=2):
            share = (a if i else 1.0 - a) * (b if j else 1.0 - b)
            nodes = ((whole_rows + i) & (_TILE - 1)) * _TILE + ((whole_columns + j) & (_TILE - 1))
            tile += np.bincount(nodes, share, _TILE * _TILE)
        pattern: Floats = _smooth(tile.reshape(_TILE, _TILE)).astype(np.float32)
        return pattern


def _smooth(tile: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smoothed pattern without the noise of single rays; the sun's disc is half a degree wide."""
    for axis in (0, 1):
        tile = 0.25 * np.roll(tile, 1, axis) + 0.5 * tile + 0.25 * np.roll(tile, -1, axis)
    return tile

"""Marine snow before a camera."""

from itertools import product
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Water

Floats = NDArray[np.float32]

_CELL = 0.5  # m: side of the cubes of water whose particles are drawn together
_MAX_DISTANCE, _MIN_DISTANCE = 2.5, 0.08  # m
_RADII = (0.0004, 0.003)  # m: least and greatest radius of visible aggregates; most are small
_ALBEDO = 0.5  # share of light that a particle reflects
_MIN_SPREAD, _MAX_SPREAD = 0.6, 12.0  # pixels: least and greatest radius of a particle's image
_FOCUS = 1.0  # m: distance of focus; particles at other distances are blurred
_APERTURE = 0.004  # m


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

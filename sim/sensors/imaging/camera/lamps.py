"""Lamps beside a camera: their light on surfaces, and its backscatter by the water."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Water
from sim.rays.scene import RayScene
from sim.sensors.imaging.scenery import LampLight, SurfaceHits

Floats = NDArray[np.float32]

# Share of scattered light in a backward direction, 1/sr: 1.83 % of the light that Petzold's particles scatter goes into
# the backward hemisphere (Mobley 1994, Light and Water, table 3.10), with nearly the same intensity in all directions.
_BACKWARD_SHARE = 0.0183 / (2.0 * np.pi)
_TOLERANCE = 0.02  # m: an obstruction this near to a surface is the surface itself
_RANGES, _ANGLES, _STEPS = 96, 33, 400  # size of the table of backscatter; steps of its integral
_BLOCK = 65_536


class Lamps:
    """Two lamps, `offset` m to port and starboard of a camera, which point in its direction.

    `brightness` is the radiance of a white wall 1 m in front of both, relative to full daylight. `shadows` enables cast
    shadows, `backscatter` is a factor on that of Petzold's particles, `reach` the range of the camera (m).
    """

    def __init__(self, offset: float, brightness: float, shadows: bool, backscatter: float, reach: float) -> None:
        self._offset, self._brightness = offset, brightness
        self._shadows, self._backscatter, self._reach = shadows, backscatter, reach
        self._water: Water | None = None
        self._table: Floats  # of that water

    def lamp_lights(self, rays: RayScene, position: Any, starboard: Any, surfaces: SurfaceHits) -> list[LampLight]:
        """Return the light of both lamps at `surfaces`; `position` and `starboard` (y axis) of the camera in NED."""
        lamp_lights = []
        for offset in (-self._offset, self._offset):
            lamp = np.asarray(position, np.float64) + offset * np.asarray(starboard, np.float64)
            paths = surfaces.points - lamp.astype(np.float32)[:, None]
            ranges = np.sqrt(np.einsum("ir,ir->r", paths, paths)) + np.float32(1e-6)
            cos_incidence = -np.einsum("ir,ir->r", surfaces.normals, paths) / ranges
            if self._shadows:
                cos_incidence *= self._find_lit(rays, lamp, paths, ranges, cos_incidence > 0.0)
            ranges[np.isinf(surfaces.ranges)] = np.inf
            lamp_lights.append(LampLight(ranges, cos_incidence))
        return lamp_lights

    def _find_lit(
        self, rays: RayScene, lamp: Any, paths: Floats, ranges: Floats, candidates: NDArray[np.bool_]
    ) -> Floats:
        """Return 1 for surfaces without an obstacle between them and the lamp, else 0; one ray for each candidate."""
        lit = np.ones(len(ranges), np.float32)
        chosen = np.flatnonzero(candidates & (ranges < self._reach))
        for first in range(0, len(chosen), _BLOCK):
            block = chosen[first : first + _BLOCK]
            toward = np.ascontiguousarray((paths[:, block] / ranges[block]).T, np.float64)
            hit_ranges = np.asarray(rays.ranges(lamp.tolist(), toward, self._reach))
            lit[block] = hit_ranges > ranges[block] * (1.0 - 1e-3) - _TOLERANCE
        return lit

    def veil(self, ranges: Floats, sideways: Floats, water: Water) -> Floats:
        """Return the veiling light (n x 3): the lamps' light that the water up to `ranges` (m) scatters back once.

        `sideways` (n) is the cosine of each ray's angle to the camera's y axis. A ray is lit where it is inside the
        beam of the lamp.
        """
        if water is not self._water:
            self._water, self._table = water, self._tabulate(water)
        # The table is over the logarithm of the range, because most light comes from nearby.
        near = 0.5 * self._offset
        span = np.log(max(self._reach / near, 2.0))
        x = np.log(np.clip(ranges, near, near * np.exp(span)) / np.float32(near)) * np.float32((_RANGES - 1) / span)
        y = (sideways + np.float32(1.0)) * np.float32(0.5 * (_ANGLES - 1))
        row, column = np.minimum(x.astype(np.int32), _RANGES - 2), np.minimum(y.astype(np.int32), _ANGLES - 2)
        a, b, first = x - row, y - column, row * _ANGLES + column
        veils = np.empty((3, len(ranges)), np.float32)
        for table, out in zip(self._table.reshape(3, -1), veils, strict=True):
            one = table.take(first) * (1 - b) + table.take(first + 1) * b
            other = table.take(first + _ANGLES) * (1 - b) + table.take(first + _ANGLES + 1) * b
            out[:] = one + (other - one) * a
        veil: Floats = veils.T
        return veil

    def _tabulate(self, water: Water) -> Floats:
        """Return the veiling light by colour, range and angle (3 x ranges x angles); see `veil`."""
        near = 0.5 * self._offset
        far = max(self._reach, 2.0 * near)
        path_lengths = near * (far / near) ** np.linspace(0.0, 1.0, _STEPS)[:, None]
        sideways = np.linspace(-1.0, 1.0, _ANGLES)[None, :]
        table = np.zeros((3, _RANGES, _ANGLES), np.float32)
        for offset in (-self._offset, self._offset):
            squares = path_lengths * path_lengths - 2.0 * path_lengths * offset * sideways + offset * offset
            distances = np.sqrt(np.maximum(squares, 1e-6))
            ahead = path_lengths * np.sqrt(1.0 - sideways * sideways)
            lit = np.abs(path_lengths * sideways - offset) <= ahead  # to 45 deg on each side
            for channel in range(3):
                attenuation, scattering = water.attenuation[channel], water.scattering[channel]
                sent = np.pi * 0.5 * self._brightness * np.exp(-attenuation * (distances + path_lengths)) / distances**2
                back = sent * scattering * _BACKWARD_SHARE * self._backscatter * lit
                steps = 0.5 * (back[1:] + back[:-1]) * np.diff(path_lengths, axis=0)
                total = np.vstack([np.zeros((1, _ANGLES)), np.cumsum(steps, axis=0)])
                rows = np.linspace(0.0, _STEPS - 1, _RANGES).round().astype(int)
                table[channel] += total[rows].astype(np.float32)
        return table

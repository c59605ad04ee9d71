"""Lamps beside a camera: what of their light falls on things, and what the water before the camera sends back."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Water
from sim.rays.scene import RayScene
from sim.sensors.imaging.scenery import LampLight, SurfaceHits

Floats = NDArray[np.float32]

# What of the scattered light goes straight back, 1/sr: of Petzold's particles 1.83 % goes backwards (Mobley 1994, Light
# and Water, table 3.10), nearly the same in all of those directions.
_BACKWARD_SHARE = 0.0183 / (2.0 * np.pi)
_HALF_BEAM = 1.0  # of a lamp's beam, the tangent: 45 degrees
_TOLERANCE = 0.02  # m before a thing's surface that count as it
_RANGES, _ANGLES, _STEPS = 96, 33, 400  # of the table of backscatter; steps of its integral
_BLOCK = 65_536


class Lamps:
    """Two lamps, `offset` m to port and starboard of a camera, that look as it does.

    What a white wall 1 m before both sends back is `brightness`, as a share of full daylight.
    """

    def __init__(self, offset: float, brightness: float, shadows: bool, backscatter: float, reach: float) -> None:
        self._offset, self._brightness = offset, brightness
        self._shadows, self._backscatter, self._reach = shadows, backscatter, reach
        self._water: Water | None = None
        self._table = np.zeros((3, _RANGES, _ANGLES), np.float32)

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
        """Return 1 where nothing stands between the lamp and what is seen, by a ray to each that faces it."""
        lit = np.ones(len(ranges), np.float32)
        chosen = np.flatnonzero(candidates & (ranges < self._reach))
        for first in range(0, len(chosen), _BLOCK):
            block = chosen[first : first + _BLOCK]
            toward = np.ascontiguousarray((paths[:, block] / ranges[block]).T, np.float64)
            hit_ranges = np.asarray(rays.ranges(lamp.tolist(), toward, self._reach))
            lit[block] = hit_ranges > ranges[block] * (1.0 - 1e-3) - _TOLERANCE
        return lit

    def veil(self, ranges: Floats, sideways: Floats, water: Water) -> Floats:
        """Return what the water as far as `ranges` (m) sends back of the lamps' light (n x 3), by single scattering.

        `sideways` is the cosine of each ray to the camera's y axis. A lamp lights a ray from where it comes into the
        lamp's beam.
        """
        if water is not self._water:
            self._water, self._table = water, self._tabulate(water)
        # Ranges go by their logarithm, as most of it comes from near.
        near = 0.5 * self._offset / _HALF_BEAM
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
        """Return the veil for each colour, range and angle; see `veil`."""
        near = 0.5 * self._offset / _HALF_BEAM
        far = max(self._reach, 2.0 * near)
        path_lengths = near * (far / near) ** np.linspace(0.0, 1.0, _STEPS)[:, None]
        sideways = np.linspace(-1.0, 1.0, _ANGLES)[None, :]
        table = np.zeros((3, _RANGES, _ANGLES), np.float32)
        for offset in (-self._offset, self._offset):
            squares = path_lengths * path_lengths - 2.0 * path_lengths * offset * sideways + offset * offset
            distances = np.sqrt(np.maximum(squares, 1e-6))
            ahead = path_lengths * np.sqrt(1.0 - sideways * sideways)
            lit = np.abs(path_lengths * sideways - offset) <= _HALF_BEAM * ahead
            for channel in range(3):
                attenuation, scattering = water.attenuation[channel], water.scattering[channel]
                sent = np.pi * 0.5 * self._brightness * np.exp(-attenuation * (distances + path_lengths)) / distances**2
                back = sent * scattering * _BACKWARD_SHARE * self._backscatter * lit
                steps = 0.5 * (back[1:] + back[:-1]) * np.diff(path_lengths, axis=0)
                total = np.vstack([np.zeros((1, _ANGLES)), np.cumsum(steps, axis=0)])
                rows = np.linspace(0.0, _STEPS - 1, _RANGES).round().astype(int)
                table[channel] += total[rows].astype(np.float32)
        return table

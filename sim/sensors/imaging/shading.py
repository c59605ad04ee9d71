"""Compute the light of all pixels in one pass in C (sim/native/_picture.c), if that is compiled.

The result equals that of Scenery.radiance and sim.environment.optics.underwater within one or two of 256 levels. These
are the specification, and are used without C. Lamps must be at the camera.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Water
from sim.environment.texture import NODE
from sim.rays.geometry import SEABED
from sim.sensors.imaging import scenery as appearance

Floats = NDArray[np.float32]

_STEPS = 1024  # of the table of exp over distance
_EMPTY = np.zeros(0, np.float32)


class Shading:
    """The shading of a `scenery` for pixels `pixel` rad wide, up to `reach` m.

    `compiled` is sim.native._picture. It supports everything except a `[bottom_map]`.
    """

    def __init__(self, compiled: Any, scenery: appearance.Scenery, pixel: float, reach: float) -> None:
        self._compiled = compiled
        self._scenery, self._pixel, self._reach = scenery, pixel, reach
        self._per_metre = _STEPS / reach
        self._distances = np.arange(_STEPS + 1) / self._per_metre
        self._water: Water | None = None
        self._transmission = np.zeros((_STEPS + 1, 6), np.float32)
        self._terrain = scenery.terrain
        self._depths = np.ascontiguousarray(self._terrain.depths, np.float32) if self._terrain else _EMPTY
        texture = scenery.texture
        self._texture = texture.tiles() if texture else _EMPTY
        self._relief = (
            (texture.height, NODE, appearance.MIN_FOOTPRINT, *texture.ripples) if texture else (0.0, *[1.0] * 6)
        )

    def cast(
        self,
        geometry: object,
        position: Any,
        rotation: Any,
        directions: NDArray[np.float64],
        lamps: float,
        water: Water,
    ) -> tuple[Floats, NDArray[np.float64], NDArray[np.int32]]:
        """Cast rays along `directions` (unit vectors, n x 3) and return the light of their hits.

        Return the radiance at the lens (n x 3), the ranges (m, inf without a hit) and the object numbers. `position` is
        NED in m, `rotation` (9 numbers) turns the sensor's axes to NED. `geometry` is the result of RayScene.compiled.
        """
        count = len(directions)
        radiance, ranges = np.empty((count, 3), np.float32), np.empty(count)
        objects = np.empty(count, np.int32)
        settings = self._settings(position, rotation, lamps, water)
        self._compiled.picture(geometry, settings, *self._arrays(), directions, radiance, ranges, objects)
        return radiance, ranges, objects

    def _arrays(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        return self._scenery.colours, appearance.grain_tile(), self._transmission, self._depths, self._texture

    def _settings(self, position: Any, rotation: Any, lamps: float, water: Water) -> tuple[float, ...]:
        if water is not self._water:
            self._water = water
            coefficients = np.array([*water.attenuation, *water.backscatter])
            self._transmission = np.exp(-coefficients * self._distances[:, None]).astype(np.float32)
        grid = self._terrain.grid if self._terrain else None
        ground = (grid.rows, grid.columns, grid.north_min, grid.east_min, self._terrain.scale) if grid else (0.0,) * 5  # type: ignore[union-attr]
        nodes, deviations = zip(*appearance.SCALES, strict=True)
        rock = np.subtract(appearance.ROCK, self._scenery.colours[SEABED]).tolist()
        return (
            *position, *rotation, self._reach, self._pixel, self._scenery.surface, lamps, *water.light, *water.veil,
            self._per_metre, *nodes, *deviations, *rock, *ground, *self._relief,
        )  # fmt: skip

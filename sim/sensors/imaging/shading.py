"""The light of all pixels in one pass in C (sim/native/_picture.c), where that is compiled.

What Scenery.radiance and sim.environment.optics.underwater make of a picture with lamps at the camera and without
caustics, to a level or two of 256. They are the specification, and serve where there is no C.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Water
from sim.environment.texture import NODE
from sim.rays.geometry import SEABED
from sim.sensors.imaging import scenery as looks

Floats = NDArray[np.float32]

_STEPS = 1024  # of the tables of exp
_EMPTY = np.zeros(0, np.float32)


class Shading:
    """The looks of a `scenery` for pixels `pixel` rad wide, as far as `reach` m.

    `compiled` is sim.native._picture. It has all looks but those of a map of the bottom.
    """

    def __init__(self, compiled: Any, scenery: looks.Scenery, pixel: float, reach: float) -> None:
        self._compiled = compiled
        self._scenery, self._pixel, self._reach = scenery, pixel, reach
        self._per_metre = _STEPS / reach
        self._distances = np.arange(_STEPS + 1) / self._per_metre
        self._water: Water | None = None
        self._fades = np.zeros((_STEPS + 1, 6), np.float32)
        self._terrain = scenery.terrain
        self._depths = np.ascontiguousarray(self._terrain.depths, np.float32) if self._terrain else _EMPTY
        texture = scenery.texture
        self._texture = texture.tiles() if texture else _EMPTY
        self._relief = (texture.height, NODE, looks.FINEST, *texture.ripples) if texture else (0.0, *[1.0] * 6)

    def cast(
        self, geometry: object, place: Any, rotation: Any, directions: NDArray[np.float64], lamps: float, water: Water
    ) -> tuple[Floats, NDArray[np.float64], NDArray[np.int32]]:
        """Return what pixels along `directions` (unit vectors, n x 3) see in one pass over them.

        The radiance (n x 3) at the lens, the range (m, inf for nothing) and the object. `geometry` is what
        RayScene.compiled returns.
        """
        count = len(directions)
        radiance, ranges = np.empty((count, 3), np.float32), np.empty(count)
        objects = np.empty(count, np.int32)
        settings = self._settings(place, rotation, lamps, water)
        self._compiled.picture(geometry, settings, *self._views(), directions, radiance, ranges, objects)
        return radiance, ranges, objects

    def shade(self, hits: Any, place: Any, rotation: Any, toward: Floats, lamps: float, water: Water) -> Floats:
        """Return the radiance (n x 3) at the lens of what is met along `toward` (unit vectors, n x 3)."""
        radiance = np.empty((len(toward), 3), np.float32)
        settings = self._settings(place, rotation, lamps, water)
        distances, normals = (np.ascontiguousarray(numbers, np.float32) for numbers in (hits.distances, hits.normals))
        objects = np.ascontiguousarray(hits.objects)
        self._compiled.shade(settings, *self._views(), distances, normals, objects, toward, radiance)
        return radiance

    def _views(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        return self._scenery.colours, looks.grain_tile(), self._fades, self._depths, self._texture

    def _settings(self, place: Any, rotation: Any, lamps: float, water: Water) -> tuple[float, ...]:
        if water is not self._water:
            self._water = water
            coefficients = np.array([*water.attenuation, *water.backscatter])
            self._fades = np.exp(-coefficients * self._distances[:, None]).astype(np.float32)
        grid = self._terrain.grid if self._terrain else None
        ground = (grid.rows, grid.columns, grid.north_min, grid.east_min, self._terrain.scale) if grid else (0.0,) * 5  # type: ignore[union-attr]
        nodes, deviations = zip(*looks.SCALES, strict=True)
        rock = np.subtract(looks.ROCK, self._scenery.colours[SEABED]).tolist()
        return (
            *place, *rotation, self._reach, self._pixel, self._scenery.surface, lamps, *water.light, *water.veil,
            self._per_metre, *nodes, *deviations, *rock, *ground, *self._relief,
        )  # fmt: skip

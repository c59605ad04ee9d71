"""The effects of lamps, particles, waves and motion on a camera's picture, by its keys: none by default."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Water
from sim.rays.scene import RayScene
from sim.sensors.imaging.camera.lamps import Lamps
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.motion import Motion, Shot
from sim.sensors.imaging.camera.particles import Caustics, Snow
from sim.sensors.imaging.scenery import Beam, Seen
from sim.sensors.mounting import Mounting

__all__ = ["Effects", "Shot"]

Floats = NDArray[np.float32]


class Effects:
    """The effects of a camera; `toward` are its pixels' unit vectors (n x 3), `seed` that of particles and waves."""

    def __init__(self, model: CameraModel, focal: float, toward: Floats, seed: int) -> None:
        m, size = model, (model.width, model.height)
        wet = not m.ground_truth
        self._sideways = toward[:, 1]
        self._lamps_at = m.lamps, m.lamp_offset
        self._has_backscatter = wet and m.backscatter > 0.0
        lit = m.lamps and m.lamp_offset
        self._lamps = Lamps(m.lamp_offset, m.lamps, m.lamp_shadows, m.backscatter, m.max_range) if lit else None
        self._snow = Snow(m.snow, size, focal, seed) if wet and m.snow else None
        self._caustics = Caustics(m.caustics, seed) if wet and m.caustics else None
        moves = wet and (m.exposure_time or m.readout_time)
        self._motion = Motion(size, focal, toward, m.exposure_time, m.readout_time) if moves else None

    @property
    def change_light(self) -> bool:
        """True if light is not that of the sky and of lamps at the camera."""
        return bool(self._lamps or self._caustics)

    def beams(self, rays: RayScene, place: Any, turned: Any, seen: Seen) -> list[Beam] | None:
        """Return the lamps' light on the surfaces that are seen; None if they are at the camera."""
        return self._lamps.beams(rays, place, turned[:, 1], seen) if self._lamps else None

    def dapple(self, seen: Seen, time_ns: int) -> Floats | None:
        """Return the factor of daylight by waves on the surfaces that are seen; None without waves."""
        return self._caustics.dapple(seen, time_ns) if self._caustics else None

    def water(self, radiance: Floats, ranges: Any, place: Any, turned: Any, water: Water) -> Floats:
        """Return a picture with what the lamps light up in the water before it, and with marine snow."""
        if self._lamps and self._has_backscatter:
            radiance += self._lamps.veil(np.asarray(ranges, np.float32), self._sideways, water)
        if self._snow:
            radiance = self._snow.fall(radiance, ranges, place, turned, water, self._lamps_at)
        return radiance

    def move(self, shot: Shot, mounting: Mounting, nu: Any) -> Shot:
        """Return the picture as it is recorded while the camera moves."""
        return self._motion.apply(shot, mounting, nu) if self._motion else shot

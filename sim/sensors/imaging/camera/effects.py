"""The effects of lamps, particles and motion on a camera's picture. All are off by default."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Water
from sim.rays.scene import RayScene
from sim.sensors.imaging.camera.lamps import Lamps
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.camera.motion import Motion, RawPicture
from sim.sensors.imaging.camera.particles import MarineSnow
from sim.sensors.imaging.scenery import LampLight, SurfaceHits
from sim.sensors.mounting import Mounting

Floats = NDArray[np.float32]


class Effects:
    """The effects that a camera's keys enable.

    `focal` is the focal length in pixels, `toward` are the pixels' unit vectors (n x 3) in the sensor's axes, `seed` is
    that of particles.
    """

    def __init__(self, model: CameraModel, focal: float, toward: Floats, seed: int) -> None:
        m, size = model, (model.width, model.height)
        has_effects = not m.ground_truth
        self._sideways = toward[:, 1]
        self._lamps_at = m.lamps, m.lamp_offset
        self._has_backscatter = has_effects and m.backscatter > 0.0
        has_lamps = m.lamps and m.lamp_offset
        self._lamps = Lamps(m.lamp_offset, m.lamps, m.lamp_shadows, m.backscatter, m.max_range) if has_lamps else None
        self._snow = MarineSnow(m.snow, size, focal, seed) if has_effects and m.snow else None
        moves = has_effects and (m.exposure_time or m.readout_time)
        self._motion = Motion(size, focal, toward, m.exposure_time, m.readout_time) if moves else None

    @property
    def changes_light(self) -> bool:
        """True if there are lamps beside the camera, which sim.sensors.imaging.shading does not support."""
        return self._lamps is not None

    def lamp_lights(self, rays: RayScene, position: Any, axes: Any, surfaces: SurfaceHits) -> list[LampLight] | None:
        """Return the light of each lamp on the visible surfaces; None if the lamps are at the camera.

        `position` is that of the camera (NED, m), `axes` (3 x 3) turns its axes to NED.
        """
        return self._lamps.lamp_lights(rays, position, axes[:, 1], surfaces) if self._lamps else None

    def add_water_effects(
        self, radiance: Floats, ranges: Any, position: Any, axes: Any, water: Water, lights: float = 1.0
    ) -> Floats:
        """Return the radiance (n x 3) with backscatter of the lamps' light by the water, and with marine snow.

        `lights` is the share of their full brightness that the lamps have.
        """
        if self._lamps and self._has_backscatter:
            radiance += np.float32(lights) * self._lamps.veil(np.asarray(ranges, np.float32), self._sideways, water)
        if self._snow:
            radiance = self._snow.add_particles(
                radiance, ranges, position, axes, water, (lights * self._lamps_at[0], self._lamps_at[1])
            )
        return radiance

    def apply_motion(self, picture: RawPicture, mounting: Mounting, nu: Any) -> RawPicture:
        """Return the picture with the effects of the camera's motion `nu` during its exposure and readout."""
        return self._motion.apply(picture, mounting, nu) if self._motion else picture

"""Density, speed of sound and pressure of the water over depth."""

from bisect import bisect_right
from typing import TYPE_CHECKING

from sim.environment.ocean import Profile
from sim.environment.seawater.pressure import GRAVITY_SLOPE
from sim.interpolation import PiecewiseLinear

if TYPE_CHECKING:
    from sim.environment.seawater.sound_rays import SoundRays

SOUND_SPEED = 1500.0  # m/s, if a profile does not give it


class WaterColumn:
    """Density, speed of sound and pressure over depth, from the rows of a profile, under `gravity` m/s².

    The buoyancy of a hull in it is computed by sim/environment/stratification.py.
    """

    def __init__(self, profile: Profile, gravity: float) -> None:
        depths, densities = list(profile.depth), list(profile.density)
        if depths[0] > 0.0:  # the first row is valid up to the surface
            depths.insert(0, 0.0)
            densities.insert(0, densities[0])
        self._density = PiecewiseLinear(depths, densities)
        self._sound = PiecewiseLinear(profile.depth, profile.sound_speed or (SOUND_SPEED,) * len(profile.depth))
        self._speeds = profile.depth, profile.sound_speed
        self._depths = depths
        self._gravity = gravity
        self._pressures = [0.0]
        for depth in depths[1:]:
            self._pressures.append(self.pressure(depth))

    def density(self, depth: float) -> float:
        """Return the density (kg/m³) at `depth` m."""
        return self._density(depth)[0]

    def sound_speed(self, depth: float) -> float:
        """Return the speed of sound (m/s) at `depth` m: 1500 without a profile."""
        return self._sound(depth)[0]

    def rays(self, bottom: float) -> "SoundRays | None":
        """Return the sound rays over a seabed at `bottom` m; None if the speed is constant and rays are straight."""
        depths, speeds = self._speeds
        if not speeds or min(speeds) == max(speeds):
            return None
        from sim.environment.seawater.sound_rays import SoundRays

        return SoundRays(depths, speeds, bottom)

    def pressure(self, depth: float) -> float:
        """Return the pressure (Pa) above air pressure at `depth` m: exactly the weight of the water above; 0 in air.

        Densities are those in place, with compression; gravity grows with depth.
        """
        if depth <= 0.0:
            return 0.0
        row = min(bisect_right(self._depths, depth), len(self._pressures)) - 1
        top = self._depths[row]
        # Simpson's rule is exact: density and gravity are linear between two rows.
        parts = [(1.0, top), (4.0, 0.5 * (top + depth)), (1.0, depth)]
        mean = sum([share * self.density(at) * (1.0 + GRAVITY_SLOPE * at) for share, at in parts]) / 6.0
        return self._pressures[row] + self._gravity * mean * (depth - top)

"""Loss of thrust near the surface, where a propeller draws air or leaves the water.

The remaining share of the thrust depends on the immersion h of the hub over the propeller's radius R (Minsaas,
Faltinsen & Persson 1983, On the importance of added resistance, propeller immersion and propeller ventilation for large
ships in a seaway, PRADS; quoted by Smogeli 2006, Control of marine propellers, NTNU):

    share = 1 - 0.675 (1 - 0.769 h / R)^1.258

It is 0 below h / R = -0.48 and 1 above h / R = 1.3. The formula is for a propeller under full load; here it is used for
any direction of the axis. Not modelled: that a lightly loaded propeller draws less air, that air stays for some time,
racing of an unloaded motor.
"""

from collections.abc import Sequence
from typing import Protocol

from sim.rotations import down_axis
from sim.vehicle.vehicle import Vehicle

_FULL_THRUST, _NO_THRUST = 1.3, -0.48  # h / R


def thrust_share(immersion: float) -> float:
    """Return the share of the thrust, from 0 to 1, that remains at an immersion of h / R."""
    if immersion >= _FULL_THRUST:
        return 1.0
    if immersion <= _NO_THRUST:  # a vehicle that diverges is so far up that the power overflows
        return 0.0
    lost: float = 0.675 * max(0.0, 1.0 - 0.769 * immersion) ** 1.258
    return max(0.0, 1.0 - lost)


class Surface(Protocol):
    """The water surface under waves, as `sim.environment.waves.WaveField` computes it."""

    @property
    def max_elevation(self) -> float:
        """A bound of the elevation in m."""

    def surface(self, time: float, north: float, east: float) -> float:
        """Return the elevation (m) at `time` s above a point (m, NED)."""


class Ventilation:
    """The loss of thrust of one vehicle near the surface, which `wave_field` moves; none below `reach` m of depth."""

    def __init__(self, vehicle: Vehicle, wave_field: Surface | None) -> None:
        self._hubs = [(*thruster.position, 0.5 * thruster.propeller_diameter) for thruster in vehicle.thrusters]
        self._wave_field = wave_field
        reaches = [(x * x + y * y + z * z) ** 0.5 + _FULL_THRUST * radius for x, y, z, radius in self._hubs]
        self.reach = max(reaches) + (wave_field.max_elevation if wave_field else 0.0)

    def shares(self, position: Sequence[float], quaternion: Sequence[float], time: float) -> list[float]:
        """Return the remaining share of each thruster's thrust, for a vehicle at `position` (m, NED) at `time` s."""
        north, east, depth = position
        if self._wave_field is not None:
            depth += self._wave_field.surface(time, north, east)
        a, b, c = down_axis(quaternion)
        return [thrust_share((depth + a * x + b * y + c * z) / radius) for x, y, z, radius in self._hubs]

    def numbers(self) -> list[float]:
        """Return the reach, then all numbers that `shares` uses except the waves, as one flat list, for the C twin."""
        return [self.reach, *(x for hub in self._hubs for x in hub)]

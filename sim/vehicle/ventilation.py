"""Loss of thrust near the surface, where a propeller draws air or leaves the water.

By the immersion h of the hub over the propeller's radius R (Minsaas, Faltinsen & Persson 1983, On the importance of
added resistance, propeller immersion and propeller ventilation for large ships in a seaway, PRADS; quoted by Smogeli
2006, Control of marine propellers, NTNU):

    share = 1 - 0.675 (1 - 0.769 h / R)^1.258 between h / R = -0.48, where nothing is left, and 1.3, where all is

It is that of a propeller under full load, whichever way its axis points. Not modelled: that a lightly loaded one draws
less air, that air stays for some time, the race of an unloaded motor.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sim.rotations import down_axis
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.environment.waves import WaveField

_ALL, _NONE = 1.3, -0.48  # h / R


def thrust_share(immersion: float) -> float:
    """Return the share of the thrust that is left at an immersion of h / R, from 0 to 1."""
    if immersion >= _ALL:
        return 1.0
    if immersion <= _NONE:
        return 0.0
    lost: float = 0.675 * max(0.0, 1.0 - 0.769 * immersion) ** 1.258
    return min(1.0, max(0.0, 1.0 - lost))


class Ventilation:
    """The loss of thrust of one vehicle at the surface, which `wave_field` moves; none from `reach` m down."""

    def __init__(self, vehicle: Vehicle, wave_field: "WaveField | None") -> None:
        self._hubs = [(*thruster.position, 0.5 * thruster.disc) for thruster in vehicle.thrusters]
        self._wave_field = wave_field
        highest = sum(abs(wave.amplitude) for wave in wave_field.components) if wave_field else 0.0
        reaches = [(x * x + y * y + z * z) ** 0.5 + _ALL * radius for x, y, z, radius in self._hubs]
        self.reach = highest + max(reaches)

    def shares(self, position: Sequence[float], quaternion: Sequence[float], time: float) -> list[float]:
        """Return the share of each thruster's thrust that is left, for a vehicle there (m, NED) at `time` s."""
        north, east, depth = position
        if self._wave_field is not None:
            depth += self._wave_field.surface(time, north, east)
        a, b, c = down_axis(quaternion)
        return [thrust_share((depth + a * x + b * y + c * z) / radius) for x, y, z, radius in self._hubs]

    def numbers(self) -> list[float]:
        """Return all that `shares` uses but the sea, and the reach first: what the C twin is made of."""
        return [self.reach, *(x for hub in self._hubs for x in hub)]

"""Wind, and its force on what a vehicle has above the water.

    [wind]                       # a section of a world file
    speed = "8 m/s"
    direction = "90 deg"         # to which it blows, as of waves
    gusts = 0.15

Force and moment are Blendermann's (1994, J. Wind Eng. Ind. Aerodyn. 51:339; Fossen 2021, section 10.1), for the wind
relative to the vehicle. Of its [windage] (sim/vehicle/hull_form.py) the part above the surface counts; without one, of
the box of its dimensions. Not modelled: gusts across the wind, shelter by waves and obstacles, the waves that wind
makes.
"""

from collections.abc import Sequence
from math import asin, cos, exp, log, pi, sin, sqrt
from random import Random
from typing import TYPE_CHECKING, Annotated, NamedTuple

from hil.common.schema import Range
from sim.environment.ocean import Angle
from sim.forces import TimedForce, Wrench
from sim.rotations import Rotation
from sim.vehicle.hull_form import Windage
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.environment.waves import WaveField

AIR_DENSITY = 1.225  # kg/m³, at 15 deg C and sea level
_REFERENCE_HEIGHT, _SHEAR = 10.0, 1.0 / 7.0  # of the power law of the mean wind over the sea
_LOWEST, _HIGHEST = 0.02, 5.0  # frequencies of gusts, times `gust_time`
_TURN = 0.18  # of the length: how far a wind from ahead or astern moves the point of attack


class Wind(NamedTuple):
    """A wind of mean `speed` at 10 m above the water, to `direction` (rad from north, clockwise).

    It decreases to the vehicle's height by the power 1/7. `gusts` is the standard deviation of its speed over the mean,
    `gust_time` (s) their integral time scale in von Karman's spectrum, made of `components` sines.
    """

    speed: Annotated[float, Range(0.0, 60.0, "m/s")]
    direction: Angle = 0.0
    gusts: Annotated[float, Range(0.0, 1.0)] = 0.0
    gust_time: Annotated[float, Range(0.1, 1000.0, "s")] = 10.0
    components: Annotated[int, Range(1, 200)] = 20


class WindForce(TimedForce):
    """The force of `wind` on `vehicle`; `seed` is the scenario's."""

    over_ground = True  # `wrench` gets the velocity over ground

    def __init__(self, vehicle: Vehicle, wind: Wind, wave_field: "WaveField | None", seed: int) -> None:
        length, width, height = vehicle.dimensions
        windage = vehicle.windage or Windage(width * height, length * height, vehicle.center_of_buoyancy, height)
        along, across = windage.frontal_area * windage.frontal_drag, windage.lateral_area * windage.lateral_drag
        self._frontal, self._lateral = 0.5 * AIR_DENSITY * along, 0.5 * AIR_DENSITY * across
        self._coupling = 2.0 * windage.coupling * (1.0 - along / across)
        self._center, self._height = windage.center, windage.height
        self._turn = _TURN * length
        self._north, self._east = cos(wind.direction), sin(wind.direction)
        self._speed = wind.speed * (0.5 * windage.height / _REFERENCE_HEIGHT) ** _SHEAR
        self._gusts = _gusts(wind, self._speed, Random(f"{seed}/wind"))
        self.wave_field = wave_field

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the force (N, N m, body axes about the origin) at `nu_r`, here over ground."""
        north, east, depth = position
        xx, xy, _, yx, yy, _, zx, zy, zz = rotation
        x, y, z = self._center
        if self.wave_field is not None:
            depth += self.wave_field.surface(self._time, north, east)
        share = 0.5 - (depth + zx * x + zy * y + zz * z) / self._height
        if not share > 0.0:
            return (0.0,) * 6
        share = min(1.0, share)
        speed = self._speed
        for amplitude, omega, phase in self._gusts:
            speed += amplitude * cos(omega * self._time + phase)
        u = speed * (xx * self._north + yx * self._east) - nu_r[0]
        v = speed * (xy * self._north + yy * self._east) - nu_r[1]
        size = sqrt(u * u + v * v)
        if size == 0.0:
            return (0.0,) * 6
        ahead, aside = u / size, v / size
        factor = share * size / (1.0 - self._coupling * (ahead * aside) * (ahead * aside))
        surge, sway = factor * self._frontal * u, factor * self._lateral * v
        x -= self._turn * asin(max(-1.0, min(1.0, ahead)))
        z -= 0.5 * (1.0 - share) * self._height
        return surge, sway, 0.0, -z * sway, z * surge, x * sway - y * surge

    def numbers(self) -> list[float]:
        """Return all numbers of `wrench` besides the waves, for the C twin. The gusts come last."""
        constants = (
            self._frontal, self._lateral, self._coupling, *self._center, self._height, self._turn, self._north,
            self._east, self._speed,
        )  # fmt: skip
        return [*constants, *(x for gust in self._gusts for x in gust)]


def _gusts(wind: Wind, speed: float, random: Random) -> list[tuple[float, float, float]]:
    """Return amplitude (m/s), angular frequency (rad/s) and phase (rad) of each sine; von Karman's spectrum.

    Frequencies are at random in cells of equal width on a logarithmic scale. The sum has the whole variance.
    """
    if not wind.gusts * speed > 0.0:
        return []
    cell = log(_HIGHEST / _LOWEST) / wind.components
    ratios = [_LOWEST * exp(cell * (i + random.random())) for i in range(wind.components)]
    powers = [ratio / (1.0 + 70.8 * ratio * ratio) ** (5.0 / 6.0) for ratio in ratios]
    scale = wind.gusts * speed * sqrt(2.0 / sum(powers))
    return [
        (scale * sqrt(power), 2.0 * pi * ratio / wind.gust_time, 2.0 * pi * random.random())
        for power, ratio in zip(powers, ratios, strict=True)
    ]

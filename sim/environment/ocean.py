"""Records of a world's `[ocean]` section: varying currents, density layers, waves.

    [ocean.layers]                    # a current that changes with depth
    depth = [0, 10, 30]
    north = [0.5, 0.2, 0.0]
    east = [0.0, 0.1, 0.0]

    [ocean.gauss_markov]              # a current that varies at random
    sd = [0.05, 0.05, 0.0]
    time = "5 min"

    [[ocean.tide]]                    # a tidal current, one table for each constituent
    constituent = "M2"
    amplitude = "0.6 m/s"
    heading = "75 deg"

    [ocean.series]                    # a current over time, such as a measured one
    time = [0, 600, 1200]
    north = [0.1, 0.3, 0.2]

    [ocean.profile]                   # properties of the water
    depth = [0, 20, 100]
    density = [1022.0, 1026.0, 1027.5]
    sound_speed = [1510.0, 1495.0, 1490.0]

    [ocean.waves]
    significant_height = "1 m"
    peak_period = "7 s"
    direction = "180 deg"

All currents are added to the world's steady `current`. This module, and those that use these records, are imported only
for a world that has an `[ocean]`.
"""

from math import pi
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range
from sim.interpolation import validate_columns

Speed = Annotated[float, Range(-10.0, 10.0, "m/s")]
Spread = Annotated[float, Range(0.0, 5.0, "m/s")]
Depth = Annotated[float, Range(0.0, 11_000.0, "m")]
Angle = Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]
Time = Annotated[float, Range(0.0, 1e9, "s")]
Density = Annotated[float, Range(900.0, 1200.0, "kg/m³")]
SoundSpeed = Annotated[float, Range(1300.0, 1800.0, "m/s")]

Constituent = Literal["M2", "S2", "N2", "K1", "O1"]
MAX_STEEPNESS = 1.0 / 7.0  # height over length: a steeper wave breaks (Michell 1893: 0.142)


class Layers(NamedTuple):
    """A current (m/s, NED) that changes with depth (m): linear between the rows, constant beyond them."""

    depth: tuple[Depth, ...]
    north: tuple[Speed, ...] = ()
    east: tuple[Speed, ...] = ()
    down: tuple[Speed, ...] = ()

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return validate_columns("depth", self.depth, north=self.north, east=self.east, down=self.down)


class Series(NamedTuple):
    """A current (m/s, NED) over time (s from the start of the run): linear between the rows, constant outside them."""

    time: tuple[Time, ...]
    north: tuple[Speed, ...] = ()
    east: tuple[Speed, ...] = ()
    down: tuple[Speed, ...] = ()

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return validate_columns("time", self.time, north=self.north, east=self.east, down=self.down)


class GaussMarkov(NamedTuple):
    """A random current about `mean` (m/s, NED) with standard deviation `sd` (m/s) and correlation time `time` (s)."""

    sd: tuple[Spread, Spread, Spread]
    time: Annotated[float, Range(1.0, 1e6, "s")]
    mean: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)


class Tide(NamedTuple):
    """One constituent of a tidal current: amplitude * cos(speed * t - phase) towards `heading`.

    `heading` (rad from north, clockwise) is the direction to which the flood flows; the ebb flows the opposite way.
    `phase` is the lag of the strongest flood behind the start of the run. Two tables of the same constituent whose
    headings and phases differ by a quarter turn make a tidal ellipse.
    """

    constituent: Constituent
    amplitude: Annotated[float, Range(0.0, 10.0, "m/s")]
    heading: Angle
    phase: Angle = 0.0


class Profile(NamedTuple):
    """Density (kg/m³) and speed of sound (m/s) by depth (m): linear between the rows, constant beyond them."""

    depth: tuple[Depth, ...] = ()
    density: tuple[Density, ...] = ()
    sound_speed: tuple[SoundSpeed, ...] = ()

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if not self.density:
            return "density: give one value for each depth"
        return validate_columns("depth", self.depth, density=self.density, sound_speed=self.sound_speed)


class Waves(NamedTuple):
    """An irregular sea: its spectrum, its direction, and the resolution of its computation.

    `significant_height` is four standard deviations of the surface, `peak_period` the period of the spectrum's peak,
    `gamma` the peak enhancement factor of JONSWAP (1: Pierson-Moskowitz). `direction` (rad from north, clockwise) is
    the direction to which the waves travel, `spread` the standard deviation of the headings of the wave components
    about it. The sea is the sum of `components` waves. The motion of the water is computed every `hold` s and
    extrapolated linearly in between.
    """

    significant_height: Annotated[float, Range(0.0, 20.0, "m")]
    peak_period: Annotated[float, Range(1.0, 30.0, "s")]
    spectrum: Literal["jonswap", "pierson_moskowitz"] = "jonswap"
    gamma: Annotated[float, Range(1.0, 10.0)] = 3.3
    direction: Angle = 0.0
    spread: Annotated[float, Range(0.0, 0.8, "rad")] = 0.0
    components: Annotated[int, Range(1, 500)] = 50
    hold: Annotated[float, Range(0.0, 0.1, "s")] = 0.025

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if self.spectrum != "jonswap" and self.gamma != Waves._field_defaults["gamma"]:
            return f"gamma is for jonswap, and the spectrum is {self.spectrum}"
        length = 9.80665 * self.peak_period**2 / (2.0 * pi)  # in deep water
        if self.significant_height > MAX_STEEPNESS * length:
            return (
                f"significant_height {self.significant_height:g} m is more than 1/7 of the waves' length of "
                f"{length:.3g} m: they would break; give a longer peak_period"
            )
        return None


class Ocean(NamedTuple):
    """Water whose properties vary with position and time."""

    layers: Layers | None = None
    gauss_markov: GaussMarkov | None = None
    tide: tuple[Tide, ...] = ()
    series: Series | None = None
    profile: Profile | None = None
    waves: Waves | None = None

    @property
    def moves(self) -> bool:
        """True if there is a varying current or waves."""
        return bool(self.layers or self.gauss_markov or self.tide or self.series or self.waves)

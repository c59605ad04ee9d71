"""The material of a seabed: the `[bottom]` of a world, for sonars and cameras.

[bottom]
kind = "sand"
ripple_height = 0.03           # m, from trough to crest
ripple_length = 0.4
ripple_heading = "30 deg"      # across the crests

A grid of depths contains no detail smaller than its cells. sim/environment/texture.py generates such detail from this
record: the same for sonars and cameras, in every run, and from every side.
"""

from math import pi
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range

Kind = Literal["mud", "sand", "gravel", "rock"]


class Properties(NamedTuple):
    """The numbers of one kind: height (m) and exponent of its relief, echo and patchiness (dB, re sand)."""

    height: float
    exponent: float
    echo: float
    patches: float


# Our choice, with the order and magnitude of APL-UW 1994 (High-Frequency Ocean Environmental Acoustic Models Handbook,
# TR 9407, table 2), whose exponent is 3.25 for sediments. Heights are those of wavelengths below `OUTER` m.
PROPERTIES: dict[Kind, Properties] = {
    "mud": Properties(0.004, 3.25, -6.0, 1.0),
    "sand": Properties(0.010, 3.25, 0.0, 1.5),
    "gravel": Properties(0.025, 3.0, 3.0, 2.0),
    "rock": Properties(0.10, 2.75, 5.0, 3.0),
}
OUTER = 2.0  # m


class Bottom(NamedTuple):
    """The keys of `[bottom]`: see the top of this module.

    `roughness` (m) is the standard deviation of the relief at wavelengths below 2 m; `patches` (dB) that of the echo
    strength over the seabed. Both are those of the kind if left out. Sand ripples have the height `ripple_height` (m;
    0: none) and the wavelength `ripple_length` (m) along `ripple_heading` (rad from north).
    """

    kind: Kind = "sand"
    roughness: Annotated[float, Range(0.0, 1.0, "m")] | None = None
    patches: Annotated[float, Range(0.0, 20.0, "dB")] | None = None
    ripple_height: Annotated[float, Range(0.0, 1.0, "m")] = 0.0
    ripple_length: Annotated[float, Range(0.05, 20.0, "m")] = 0.4
    ripple_heading: Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")] = 0.0
    seed: Annotated[int, Range(0, 2**31 - 1)] = 0

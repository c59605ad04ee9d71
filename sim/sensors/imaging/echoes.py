"""Echoes of a sonar's ping by range, from rays that each stand for a patch of surface.

A patch at distance r, met at an angle theta from its normal within a solid angle dO, has the area r² dO / cos theta and
scatters mu cos² theta of the intensity on it back, per m² and sr (Lambert's rule; for the seabed Mackenzie 1961, J.
Acoust. Soc. Am. 33(11):1498, found 10 lg mu = -27 dB). Spreading both ways is 1 / r⁴, absorption alpha dB/m both ways,
and the beam pattern b works on the way out and back (Urick 1983, Principles of Underwater Sound, chapters 2 and 8):

    echo / source = mu cos theta b² dO / r² 10^(-2 alpha r / 10)        both intensities at 1 m

Nearer and farther edges of the patch follow from the plane through it, and its echo is spread between them: over a
plane there is no gap between one ray and the next, however much the beam grazes it.
Second echoes are in sim/sensors/imaging/multipath.py, the seabed's texture in bottom_echo.py, split rays in
sim/rays/splitting.py. Echoes of the water are in reverberation.py. The glint of smooth objects
is in pinger.py. Not modelled: rays that bend, Doppler.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from sim.rays.splitting import Lattice

Floats = NDArray[np.floating[Any]]

MARGIN = 1.25  # rays go farther than the last bin, for the near edges of patches beyond it
STRETCH = 2.0  # an edge is at most so many times farther than the patch's middle
_THINNEST = 1e-3  # bins: no echo is shorter
_FIRST_LOBE = 13.26  # dB of sinc² below its middle
HALF_POWER = 0.4429464  # sinc² is a half there, in units of its first null


class Mirrors(NamedTuple):
    """The loss of a reflection at the surface and at the seabed, in dB."""

    surface: float
    bottom: float


class View(NamedTuple):
    """A sonar's place (NED, m) and attitude; its cells, the height of its beams (rad), how far it looks (m)."""

    place: Floats
    turn: Floats
    lattice: Lattice | None
    height: float
    reach: float


class Ground(NamedTuple):
    """The hits of an aperture of `shape` from `place`: points (n x 3, NED; nan for nothing) and cosines.

    The cosines are those of the angles of incidence.
    """

    place: Any
    points: Floats
    facing: Floats
    shape: tuple[int, ...]


class Aperture(NamedTuple):
    """Directions of a sonar: `beams` x `rays` unit vectors in its axes.

    `directions` are the middles of the patches, `edges` (one more a beam) what parts them, `weights` b² dO. With a
    `lattice` of the same cells and the `height` (rad at half power) of its beams rays are split where there are
    small things; `columns` is what the weights of each column have beside that height's.
    `sides` are the edges to the left and right of patches so wide that their range differs there. `receive` returns
    the receiver's b by unit vectors, of what is in the weights.
    """

    directions: Floats
    edges: Floats
    weights: Floats
    lattice: Lattice | None = None
    height: float = 0.0
    columns: Floats | None = None
    sides: tuple[Floats, ...] = ()
    receive: Callable[[Floats], Floats] | None = None


class Echoes(NamedTuple):
    """Echoes of a ping, one a ray: those of the aperture beam by beam, then those of split rays, then second ones.

    Range (m) of its patch's middle, nearest and farthest edge, echo / source, the number of its beam, and the object.
    `ground` is where the aperture's own rays have met things, for what has more of the seabed.
    """

    ranges: Floats
    near: Floats
    far: Floats
    energy: Floats
    beam: NDArray[np.int64]
    object: NDArray[np.int32]
    ground: Ground | None = None

    def moved(self, scale: Any, offset: float = 0.0) -> "Echoes":
        """Return the echoes at other ranges: `scale` times these, by ray if there are several, and `offset` m more."""
        ranges, near, far = (scale * x + offset for x in (self.ranges, self.near, self.far))
        return self._replace(ranges=ranges, near=near, far=far)


class Rays(NamedTuple):
    """Rays and what they have met: n directions, two or four edges each, weights, beams; and the hits."""

    directions: Floats
    edges: tuple[Floats, ...]
    weights: Floats
    beam: NDArray[np.int64]
    ranges: Floats
    points: Floats
    normals: Floats
    object: NDArray[np.int32]


class Bins:
    """`count` range bins from `first` m on, `step` m each, for echoes that absorption weakens by `absorption` dB/m.

    Between its edges an echo falls as that of a plane does which a beam grazes: with r⁵ (1 / r² for the spreading that
    is left, 1 / r for the cosine, 1 / r² for the height that a range bin has in angle), and by absorption.
    """

    def __init__(self, first: float, step: float, count: int, absorption: float) -> None:
        self.first, self.step, self.count = first, step, count
        self._below = int(first / step + 1e-6)  # bins of the table before the first
        self._origin = first - self._below * step
        middles = self._origin + step * (np.arange(self._below + round(MARGIN * STRETCH * count) + 1) + 0.5)
        self._law = np.maximum(middles / step, 1.0) ** -5 * 10.0 ** (-0.2 * absorption * middles)
        self._beyond = np.append(np.cumsum(self._law[::-1])[::-1], 0.0)  # summed from afar, where it is least

    def shares(self, echoes: Echoes, beams: int, of: NDArray[np.bool_] | None = None) -> Floats:
        """Return what of the echoes of each beam is in each bin: beams x bins; of a part of the echoes, if given.

        All at once by sums of sums: of how much begins and ends in each bin, in units of the law.
        """
        energy = echoes.energy
        here = np.flatnonzero(energy > 0.0 if of is None else of & (energy > 0.0))
        low = self._places(echoes.near[here])
        high = np.maximum(self._places(echoes.far[here]), low + _THINNEST)
        length = self._above(low) - self._above(high)
        density = energy[here] / np.where(length > 0.0, length, np.inf)
        width = self.count + 2
        rows = echoes.beam[here] * width
        index, change = [], []
        for place, slope in ((low, density), (high, -density)):
            place = np.clip(place - self._below, 0.0, self.count)
            whole = place.astype(np.int64)
            part = (place - whole) * slope
            index += [rows + whole, rows + whole + 1]
            change += [slope - part, part]
        slopes = np.bincount(np.concatenate(index), np.concatenate(change), beams * width)
        sums = np.cumsum(slopes.reshape(beams, width), axis=1)[:, : self.count]
        shares: Floats = np.maximum(sums, 0.0, out=sums.astype(float, copy=False))  # below 0 it is rounding
        shares *= self._law[self._below : self._below + self.count]
        return shares

    def _places(self, ranges: Floats) -> Floats:
        """Return ranges in bins of the table."""
        places: Floats = (ranges - self._origin) / self.step
        return np.clip(places, 0.0, len(self._law) - 1.0)

    def _above(self, places: Floats) -> Floats:
        """Return the law's integral from there on."""
        whole = places.astype(np.int64)
        integral: Floats = self._beyond[whole] - (places - whole) * self._law[np.minimum(whole, len(self._law) - 1)]
        return integral


def pattern(angles: Floats, width: float) -> Floats:
    """Return the one-way beam pattern b (of intensity) at `angles` rad off axis, a half at ± `width` / 2.

    That of a line of even strength, sinc² in the sine of the angle (Urick 1983, 3.3), up to the first null: 0 beyond.
    """
    x = np.sin(angles) * HALF_POWER / np.sin(0.5 * width)
    return np.where((np.abs(x) < 1.0) & (np.abs(angles) < 0.5 * np.pi), np.sinc(x) ** 2, 0.0)


def array_pattern(angles: Floats, width: float, side_lobes: float) -> Floats:
    """Return `pattern` with side lobes: those of sinc², raised or lowered so that the first is `side_lobes` dB down.

    A line of even strength has its first 13.26 dB down; shading lowers them, errors of its elements raise them.
    """
    x = np.sin(angles) * HALF_POWER / np.sin(0.5 * width)
    beyond = (np.abs(x) >= 1.0) & (np.abs(angles) < 0.5 * np.pi)
    return np.where(beyond, np.sinc(x) ** 2 * 10.0 ** (0.1 * (_FIRST_LOBE - side_lobes)), pattern(angles, width))


def main_lobe(width: float) -> float:
    """Return how far off the axis the first null of `pattern` is, in rad; a right angle if there is none."""
    sine = np.sin(0.5 * width) / HALF_POWER
    return float(np.arcsin(sine)) if sine < 1.0 else 0.5 * np.pi


def speckled(mean: Floats, looks: float, random: np.random.Generator) -> Floats:
    """Return intensities as a sonar measures them, from their means.

    Many scatterers in one cell add up to a complex Gaussian amplitude: its magnitude is Rayleigh distributed, its
    intensity exponentially (Goodman 1985, Statistical Optics, 2.9). The mean of `looks` such is gamma distributed; 0
    looks stand for no speckle.
    """
    if looks == 0.0:
        return mean
    if looks == 1.0:
        factors: Floats = random.standard_exponential(mean.shape, np.float32)
    else:
        factors = random.standard_gamma(looks, mean.shape, np.float32) / np.float32(looks)
    speckled: Floats = mean * factors
    return speckled


def bins_of(first: float, last: float, step: float) -> int:
    """Return how many whole bins there are. Raises ConfigError for more than a picture should have."""
    count = int((last - first) / step + 1e-6)
    if not 1 <= count <= 20_000:
        raise ConfigError(f"range_step: {count} bins between {first:g} and {last:g} m; 1 to 20000 are possible")
    return count

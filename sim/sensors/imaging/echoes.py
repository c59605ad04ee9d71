"""Echoes of a sonar's ping by range. Each ray represents a patch of a surface.

A ray of the solid angle dO that hits a surface at range r and at the angle of incidence theta covers a patch of the
area r² dO / cos theta. The patch scatters back mu cos² theta of the incident intensity per m² and sr (Lambert's rule;
for the seabed Mackenzie 1961, J. Acoust. Soc. Am. 33(11):1498, found 10 lg mu = -27 dB). Two-way spreading is 1 / r⁴,
absorption is alpha dB/m each way, and the beam pattern b applies to both ways (Urick 1983, Principles of Underwater
Sound, chapters 2 and 8):

    echo / source = mu cos theta b² dO / r² 10^(-2 alpha r / 10)        both intensities at 1 m

The ranges of the patch's near and far edges follow from the plane through the hit. The echo is spread between them, so
that neighbouring rays leave no gap on a plane, even at grazing incidence.

Other parts of the model: the seabed's texture in sim/sensors/imaging/bottom_echo.py, reverberation of the water in
reverberation.py, the glint of smooth objects in pinger.py, split rays in sim/rays/splitting.py. Not modelled:
refraction, Doppler shift, second echoes by reflection at the surface or the seabed.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from sim.rays.splitting import Lattice

Floats = NDArray[np.floating[Any]]

MARGIN = 1.25  # rays reach this far beyond the last bin, for patches whose near edge is within it
STRETCH = 2.0  # maximum range of a patch's far edge, relative to the range of its middle
_MIN_LENGTH = 1e-3  # bins: minimum length of an echo
_FIRST_LOBE = 13.26  # dB: level of the first side lobe of sinc² below the main lobe
HALF_POWER = 0.4429464  # sinc² is 1/2 here, in units of its first null


class Ground(NamedTuple):
    """Hits of the aperture's own rays, seen from `position` (NED, m): `points` (n x 3, NED, m; nan without a hit).

    `cos_incidence` are the cosines of the angles of incidence. `shape` is that of the aperture: beams x rays.
    """

    position: Any
    points: Floats
    cos_incidence: Floats
    shape: tuple[int, ...]


class Aperture(NamedTuple):
    """Rays of a sonar, in its axes.

    `directions` (beams x rays x 3): unit vectors to the middles of the patches. `edges` (beams x (rays + 1) x 3): unit
    vectors to the edges between them. `weights` (beams x rays): b² dO (sr). With a `lattice` of the same cells, rays
    are split at small objects; `height` (rad at half power) is then the height of the beams, and `column_weights` is
    the factor of each column in the weights besides the pattern over the height. `side_edges`: left and right edges of
    wide patches, whose range varies from side to side. `receiver_pattern` returns the receiver's part of b in the
    weights, for unit vectors (n x 3).
    """

    directions: Floats
    edges: Floats
    weights: Floats
    lattice: Lattice | None = None
    height: float = 0.0
    column_weights: Floats | None = None
    side_edges: tuple[Floats, ...] = ()
    receiver_pattern: Callable[[Floats], Floats] | None = None


class Echoes(NamedTuple):
    """Echoes of a ping, one for each ray (n): first the aperture's rays by beam, then split rays.

    `ranges`, `near` and `far` (m) are those of the patch's middle and of its nearest and farthest edge, `energy` is
    echo / source, `beam` the number of the beam, `object` that of the object (see sim.rays.scene). `ground` has the
    hits of the aperture's own rays, for the texture of the seabed.
    """

    ranges: Floats
    near: Floats
    far: Floats
    energy: Floats
    beam: NDArray[np.int64]
    object: NDArray[np.int32]
    ground: Ground | None = None

    def scale_ranges(self, scale: Any, offset: float = 0.0) -> "Echoes":
        """Return the echoes at `scale` (one number, or one for each ray) times their ranges plus `offset` m."""
        ranges, near, far = (scale * x + offset for x in (self.ranges, self.near, self.far))
        return self._replace(ranges=ranges, near=near, far=far)


class Rays(NamedTuple):
    """Rays (n), with two or four edges each, and their hits: ranges (m), points and normals (NED), objects."""

    directions: Floats
    edges: tuple[Floats, ...]
    weights: Floats
    beam: NDArray[np.int64]
    ranges: Floats
    points: Floats
    normals: Floats
    object: NDArray[np.int32]


class Bins:
    """Range bins: `count` of `step` m each, from `first` m on, with their `middles` (m); `absorption` in dB/m.

    Between its near and far edge an echo decreases as that of a plane at grazing incidence does: with r⁻⁵ (r⁻² for the
    remaining spreading, r⁻¹ for the cosine, r⁻² for the angular height of a range bin), and by absorption.
    """

    def __init__(self, first: float, step: float, count: int, absorption: float) -> None:
        self.first, self.step, self.count, self.absorption = first, step, count, absorption
        self.middles: Floats = first + (np.arange(count) + 0.5) * step
        self._skipped = int(first / step + 1e-6)  # number of bins of the table before the first one
        self._origin = first - self._skipped * step
        middles = self._origin + step * (np.arange(self._skipped + round(MARGIN * STRETCH * count) + 1) + 0.5)
        self._decay = np.maximum(middles / step, 1.0) ** -5 * 10.0 ** (-0.2 * absorption * middles)
        # Summed from the far end, where the terms are smallest.
        self._integral = np.append(np.cumsum(self._decay[::-1])[::-1], 0.0)

    def distribute(self, echoes: Echoes, beams: int, selected: NDArray[np.bool_] | None = None) -> Floats:
        """Return the energy by beam and bin (beams x bins); only that of the `selected` echoes if given (mask of n).

        Each echo is a step up at its near edge and a step down at its far edge, in units of the decay. The cumulative
        sum of all steps is the energy.
        """
        energy = echoes.energy
        used = np.flatnonzero(energy > 0.0 if selected is None else selected & (energy > 0.0))
        low = self._bin_positions(echoes.near[used])
        high = np.maximum(self._bin_positions(echoes.far[used]), low + _MIN_LENGTH)
        length = self._integral_from(low) - self._integral_from(high)
        density = energy[used] / np.where(length > 0.0, length, np.inf)
        width = self.count + 2
        rows = echoes.beam[used] * width
        index, change = [], []
        for position, slope in ((low, density), (high, -density)):
            position = np.clip(position - self._skipped, 0.0, self.count)
            number = position.astype(np.int64)
            remainder = (position - number) * slope
            index += [rows + number, rows + number + 1]
            change += [slope - remainder, remainder]
        # Without echoes bincount returns integers.
        slopes: Floats = np.bincount(np.concatenate(index), np.concatenate(change), beams * width).astype(
            float, copy=False
        )
        by_bin: Floats = np.cumsum(slopes.reshape(beams, width), axis=1)[:, : self.count]
        np.maximum(by_bin, 0.0, out=by_bin)  # negative values are rounding errors
        by_bin *= self._decay[self._skipped : self._skipped + self.count]
        return by_bin

    def _bin_positions(self, ranges: Floats) -> Floats:
        """Return ranges (m) in bins of the table, limited to it."""
        positions: Floats = (ranges - self._origin) / self.step
        return np.clip(positions, 0.0, len(self._decay) - 1.0)

    def _integral_from(self, positions: Floats) -> Floats:
        """Return the integral of the decay from `positions` (in bins of the table) to the table's end."""
        number = positions.astype(np.int64)
        integral: Floats = (
            self._integral[number] - (positions - number) * self._decay[np.minimum(number, len(self._decay) - 1)]
        )
        return integral


def beam_pattern(angles: Floats, width: float) -> Floats:
    """Return the one-way beam pattern b (intensity) at `angles` rad off axis; it is 1/2 at ± `width` / 2.

    It is that of a uniform line, sinc² in the sine of the angle (Urick 1983, 3.3), up to the first null; 0 beyond.
    """
    x = np.sin(angles) * HALF_POWER / np.sin(0.5 * width)
    return np.where((np.abs(x) < 1.0) & (np.abs(angles) < 0.5 * np.pi), np.sinc(x) ** 2, 0.0)


def array_pattern(angles: Floats, width: float, side_lobes: float) -> Floats:
    """Return the one-way beam pattern with side lobes, the first of them `side_lobes` dB below the main lobe.

    They are those of sinc², scaled. A uniform line has its first side lobe 13.26 dB down; shading lowers side lobes,
    errors of the elements raise them. Arguments are those of `beam_pattern`.
    """
    x = np.sin(angles) * HALF_POWER / np.sin(0.5 * width)
    beyond = (np.abs(x) >= 1.0) & (np.abs(angles) < 0.5 * np.pi)
    return np.where(beyond, np.sinc(x) ** 2 * 10.0 ** (0.1 * (_FIRST_LOBE - side_lobes)), beam_pattern(angles, width))


def first_null(width: float) -> float:
    """Return the angle of the first null of `beam_pattern` off the axis (rad); a right angle if there is none."""
    sine = np.sin(0.5 * width) / HALF_POWER
    return float(np.arcsin(sine)) if sine < 1.0 else 0.5 * np.pi


def add_speckle(mean: Floats, looks: float, random: np.random.Generator) -> Floats:
    """Return random intensities as a sonar measures them, from their means (any shape).

    The echoes of many scatterers in one cell add up to a complex Gaussian amplitude. Its magnitude is Rayleigh
    distributed, its intensity exponentially (Goodman 1985, Statistical Optics, 2.9). The mean of `looks` such
    intensities is gamma distributed; 0 looks: no speckle.
    """
    if looks == 0.0:
        return mean
    if looks == 1.0:
        factors: Floats = random.standard_exponential(mean.shape, np.float32)
    else:
        factors = random.standard_gamma(looks, mean.shape, np.float32) / np.float32(looks)
    intensities: Floats = mean * factors
    return intensities


def count_bins(first: float, last: float, step: float) -> int:
    """Return the number of whole bins of `step` between `first` and `last` (m). Raises ConfigError above 20 000."""
    count = int((last - first) / step + 1e-6)
    if not 1 <= count <= 20_000:
        raise ConfigError(f"range_step: {count} bins between {first:g} and {last:g} m; 1 to 20000 are possible")
    return count

"""Echoes of a sonar's ping by range, from rays that each stand for a patch of surface.

A patch at distance r, met at an angle theta from its normal within a solid angle dO, has the area r² dO / cos theta and
scatters mu cos² theta of the intensity on it back, per m² and sr (Lambert's rule; for the seabed Mackenzie 1961, J.
Acoust. Soc. Am. 33(11):1498, found 10 lg mu = -27 dB). Spreading both ways is 1 / r⁴, absorption alpha dB/m both ways,
and the beam pattern b works on the way out and back (Urick 1983, Principles of Underwater Sound, chapters 2 and 8):

    echo / source = mu cos theta b² dO / r² 10^(-2 alpha r / 10)        both intensities at 1 m

Nearer and farther edges of the patch follow from the plane through it, and its echo is spread between them: over a
plane there is no gap between one ray and the next, however much the beam grazes it.
Not modelled: rays that bend, second echoes, mirrors, the surface's echo, reverberation in the water, Doppler.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.common.errors import ConfigError
from sim.dynamics import State
from sim.rays.scene import RayScene
from sim.rays.solids import Solid, half_space
from sim.rotations import matrix
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion

Floats = NDArray[np.floating[Any]]

_MARGIN = 1.25  # rays go farther than the last bin, for the near edges of patches beyond it
_STRETCH = 2.0  # an edge is at most so many times farther than the patch's middle
_THINNEST = 1e-3  # bins: no echo is shorter
HALF_POWER = 0.4429464  # sinc² is a half there, in units of its first null


class Aperture(NamedTuple):
    """Directions of a sonar: `beams` x `rays` unit vectors in its axes.

    `directions` are the middles of the patches, `edges` (one more a beam) what parts them, `weights` b² dO.
    """

    directions: Floats
    edges: Floats
    weights: Floats


class Echoes(NamedTuple):
    """Echo of each ray: range (m) of its patch's middle, nearest and farthest edge, and echo / source."""

    ranges: Floats
    near: Floats
    far: Floats
    energy: Floats


class Pinger:
    """Sends pings through an aperture into the world of `scene`.

    `reach` m is the farthest range of interest, `absorption` dB/m, `seabed` and `objects` are 10 lg mu in dB.
    """

    def __init__(
        self, scene: Scene, mounting: Mounting, aperture: Aperture, reach: float,
        absorption: float, seabed: float, objects: float,
    ) -> None:  # fmt: skip
        self._scene, self._mounting, self._aperture = scene, mounting, aperture
        self._reach, self._absorption = _MARGIN * reach, absorption
        self._rays = RayScene(scene.world)
        surface = self._rays.add(half_space((0.0, 0.0, 1.0), 0.0))
        self._object_strength = 10.0 ** (objects / 10.0)
        self._strengths = np.full(surface + 2, self._object_strength)  # by object; NOTHING is the last one
        self._strengths[0] = 10.0 ** (seabed / 10.0)
        first = 1 + len(scene.world.upright())
        for number, mesh in enumerate(scene.world.mesh, first):
            self._strengths[number] *= 10.0 ** (mesh.keys.echo / 10.0)
        self._strengths[surface:] = 0.0
        self._flat = np.ascontiguousarray(aperture.directions.reshape(-1, 3), dtype=float)

    def add(self, solid: Solid, state: State) -> None:
        """Put a solid there that goes with a vehicle's `state`; it echoes as the objects do."""
        number = self._rays.add(solid, state)
        self._strengths = np.insert(self._strengths, number, self._object_strength)

    def ping(self, time_ns: int, state: State) -> Echoes | None:
        """Return what comes back to where the sonar is now; None out of the water."""
        place = self._mounting.place(state)
        if place[2] <= 0.0 or submersion(self._scene, time_ns, place) <= 0.0:
            return None
        rotation = matrix(self._mounting.attitude(state))
        hits = self._rays.hits(place, self._flat, self._reach, rotation)
        directions, edges, weights = self._aperture
        shape = weights.shape
        ranges = np.frombuffer(hits.distances).reshape(shape)
        strengths = self._strengths[np.frombuffer(hits.objects, np.int32)].reshape(shape)
        echoing = (strengths > 0.0) & (ranges > 0.0)
        ranges = np.where(echoing, ranges, 1.0)
        normals = np.frombuffer(hits.normals).reshape(-1, 3) @ np.array(rotation).reshape(3, 3)
        normals = np.where(echoing[..., None], normals.reshape(*shape, 3), -directions)
        facing = _facing(normals, directions)
        first, second = (ranges * _farther(facing, _facing(normals, e)) for e in (edges[:, :-1], edges[:, 1:]))
        energy = np.where(echoing, strengths * facing * weights / ranges**2, 0.0)
        energy *= 10.0 ** (-0.2 * self._absorption * ranges)
        near, far = np.minimum(first, second), np.maximum(first, second)
        return Echoes(np.where(echoing, ranges, np.inf), np.minimum(near, ranges), np.maximum(far, ranges), energy)


def _facing(normals: Floats, directions: Floats) -> Floats:
    cosines: Floats = -np.einsum("bri,bri->br", normals, directions)
    return cosines


def _farther(middle: Floats, edge: Floats) -> Floats:
    """Return how many times as far as its middle a plane's edge is, from the cosines of incidence of the two."""
    grazing = edge * _STRETCH <= middle
    times: Floats = np.where(grazing, _STRETCH, middle / np.where(grazing, 1.0, edge))
    return np.maximum(times, 1.0 / _STRETCH)


class Bins:
    """`count` range bins from `first` m on, `step` m each, for echoes that absorption weakens by `absorption` dB/m.

    Between its edges an echo falls as that of a plane does which a beam grazes: with r⁵ (1 / r² for the spreading that
    is left, 1 / r for the cosine, 1 / r² for the height that a range bin has in angle), and by absorption.
    """

    def __init__(self, first: float, step: float, count: int, absorption: float) -> None:
        self._step, self.count = step, count
        self._below = int(first / step + 1e-6)  # bins of the table before the first
        self._origin = first - self._below * step
        middles = self._origin + step * (np.arange(self._below + round(_MARGIN * _STRETCH * count) + 1) + 0.5)
        self._law = np.maximum(middles / step, 1.0) ** -5 * 10.0 ** (-0.2 * absorption * middles)
        self._beyond = np.append(np.cumsum(self._law[::-1])[::-1], 0.0)  # summed from afar, where it is least

    def shares(self, echoes: Echoes) -> Floats:
        """Return what of the echoes of each beam is in each bin: beams x bins.

        All at once by sums of sums: of how much begins and ends in each bin, in units of the law.
        """
        low = self._places(echoes.near)
        high = np.maximum(self._places(echoes.far), low + _THINNEST)
        length = self._above(low) - self._above(high)
        density = echoes.energy / np.where(length > 0.0, length, np.inf)
        beams, width = len(density), self.count + 2
        rows = (np.arange(beams) * width)[:, None]
        index, change = [], []
        for place, slope in ((low, density), (high, -density)):
            place = np.clip(place - self._below, 0.0, self.count)
            whole = place.astype(np.int64)
            part = (place - whole) * slope
            index += [(rows + whole).ravel(), (rows + whole + 1).ravel()]
            change += [(slope - part).ravel(), part.ravel()]
        slopes = np.bincount(np.concatenate(index), np.concatenate(change), beams * width)
        sums = np.cumsum(slopes.reshape(beams, width), axis=1)[:, : self.count]
        shares: Floats = sums * self._law[self._below : self._below + self.count]
        return np.maximum(shares, 0.0)  # below 0 it is rounding

    def _places(self, ranges: Floats) -> Floats:
        """Ranges in bins of the table."""
        places: Floats = (ranges - self._origin) / self._step
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


def main_lobe(width: float) -> float:
    """Return how far off the axis the first null of `pattern` is, in rad; a right angle if there is none."""
    sine = np.sin(0.5 * width) / HALF_POWER
    return float(np.arcsin(sine)) if sine < 1.0 else 0.5 * np.pi


def speckled(mean: Floats, looks: float, random: np.random.Generator) -> Floats:
    """Intensities as a sonar measures them, from their means.

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

"""Effects of the pulse of a sonar with one beam: echoes as long as the pulse, and speckle that pings have in common.

An echo lasts as long as the pulse, so that bins nearer than c tau / 2 are alike. Strips of the seabed beside each other
scatter independently; a beam weighs them with its two-way pattern, so that pings whose beams overlap are alike, too.
With x the sine of the angle between two pings over that of the pattern's first null, their amplitudes correlate by
6 (1 - sin a / a) / a², a = 2 pi x, as sinc² does with itself. Half an aperture away a
sonar sees other speckle.
"""

from math import ceil, pi, sin

import numpy as np

from sim.sensors.imaging.echoes import HALF_POWER, Floats, main_lobe

_PER_METRE = 8000.0  # us m/s: the maker's rule for the Ping360, in its ping-viewer (src/sensor/ping360.h)
_SAMPLES = 2.5  # a pulse is at least so long
_SHORTEST, _LONGEST = 5e-6, 500e-6  # s, of the Ping360's firmware
_MOST_PARTS = 32  # real and imaginary ones of 16 looks: more leave little speckle
# Of the first null, as sinc² to the fourth is limited in band: strips so wide, as far as the second null.
_STRIP, _REACH = 0.4, 2.0


def ping360_pulse(reach: float, step: float, speed: float) -> float:
    """Return the pulse (s) that a Ping360 sends for a reach and samples `step` m apart, at a speed of sound in m/s."""
    wanted = max(_PER_METRE * reach / speed * 1e-6, _SAMPLES * 2.0 * step / speed)
    return min(max(wanted, _SHORTEST), _LONGEST)


def aperture_length(width: float, wavelength: float) -> float:
    """Return the length (m) of a line whose beam is `width` rad wide at half power, one way."""
    return HALF_POWER * wavelength / sin(0.5 * width)


class PulseReceiver:
    """Receives `count` bins of a pulse `length` bins long (1 or more), one ping after the other.

    `width` rad is its beam's at half power, one way, and `aperture` m the length of its transducer. `looks` are those
    of `speckled`, up to 16.
    """

    def __init__(
        self, count: int, length: float, width: float, aperture: float, looks: float, random: np.random.Generator
    ) -> None:
        self._count, self._random = count, random
        energies = np.clip(length - np.arange(ceil(length - 1e-9)), 0.0, 1.0)
        self._energies, self._amplitudes = energies.astype(np.float32), np.sqrt(energies).astype(np.float32)
        self._parts = min(max(round(2.0 * looks), 1), _MOST_PARTS) if looks else 0
        self._null, self._still = main_lobe(width), 0.5 * aperture
        self._turn = ceil(2.0 * pi / (_STRIP * self._null))  # strips all around
        self._strips: dict[int, Floats] = {}
        self._place: Floats = np.zeros(3)

    def receive(self, mean: Floats, noise: float, ringing: Floats, angle: float, place: Floats) -> Floats:
        """Return the intensities of a ping from the `mean` ones of a pulse as short as a bin; all by bins, float32.

        `noise` is the mean of noise, `ringing` is added with its phase. `angle` (rad) is the head's, `place` (m) the
        sonar's, both in the world.
        """
        mean = mean.astype(np.float32)
        if not self._parts:
            means: Floats = np.convolve(mean, self._energies)[: self._count] + np.float32(noise) + ringing
            return means
        amplitude, total = np.sqrt(mean), np.zeros(self._count, np.float32)
        quiet = np.float32((noise / float(self._energies.sum())) ** 0.5)
        own: Floats | np.float32 = np.sqrt(ringing * np.float32(self._parts))
        noises = self._random.standard_normal((self._parts, self._count), np.float32)
        for grain, added in zip(self._grains(angle, place), noises, strict=True):
            received = np.convolve(amplitude * grain + quiet * added, self._amplitudes)[: self._count] + own
            total += received * received
            own = np.float32(0.0)
        intensities: Floats = total / np.float32(self._parts)
        return intensities

    def _grains(self, angle: float, place: Floats) -> Floats:
        """Return normal amplitudes of variance 1, parts x bins, alike for beams that overlap."""
        if float(((place - self._place) ** 2).sum()) > self._still**2:
            self._strips, self._place = {}, place
        width = 2.0 * pi / self._turn
        middle, reach = round(angle / width), ceil(_REACH * self._null / width)
        places = range(middle - reach, middle + reach + 1)
        weights = np.sinc((np.array(places) * width - angle) / self._null).astype(np.float32) ** 2
        known, self._strips = self._strips, {}
        for strip in places:
            found = known.get(strip % self._turn)
            new = self._random.standard_normal((self._parts, self._count), np.float32) if found is None else found
            self._strips[strip % self._turn] = new
        grains: Floats = np.tensordot(weights, np.stack([self._strips[strip % self._turn] for strip in places]), 1)
        grains /= np.float32(np.sqrt((weights * weights).sum()))
        return grains

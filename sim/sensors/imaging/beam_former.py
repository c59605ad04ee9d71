"""A forward sonar's beam former: the amplitudes of all directions, added with the gain that each beam has for them.

What one direction sends back is one amplitude in all beams that receive it. So an arc of side lobes flickers along the
range as the bright thing does that it belongs to, but not from beam to beam; and the speckle and noise of neighbouring
beams, which receive much the same, are alike.

A beam's gain in amplitude is that of a line of even strength, sinc (Urick 1983, 3.3), its side lobes raised or lowered
(see sim.sensors.imaging.echoes.array_pattern), and what errors of the array's elements add. Those are as wide as the
beam, but fall with no angle: with N elements whose phases and strengths are off by p rad and a, rms, they are on the
average (p² + a²) / N of the main lobe (Mailloux 2005, Phased Array Antenna Handbook, chapter 7). They are the array's
own, the same in each ping. Not modelled: that beams far off the middle of the fan are wider.
"""

from math import ceil

import numpy as np

from sim.sensors.imaging.echoes import Floats, array_pattern, main_lobe

_MOST_LOOKS = 4.0
_MARGIN = 2.0  # first nulls: so far beyond the fan there is noise


class BeamFormer:
    """`beams` of `width` rad at half power, `spacing` rad apart, that receive as many directions.

    `side_lobes` dB: how far the first of them is below the main lobe; 0 for none, nor errors. `floor` dB: the same for
    errors of the elements, on the average; 0 for none. `random` draws them.
    """

    def __init__(
        self, beams: int, spacing: float, width: float, side_lobes: float, floor: float, random: np.random.Generator
    ) -> None:
        self._margin = margin = min(ceil(_MARGIN * main_lobe(width) / spacing), beams)
        apart = np.arange(-(beams + margin), beams + margin + 1)
        gains = _gains(apart * spacing, width, side_lobes)
        if side_lobes and floor:
            gains += 10.0 ** (-0.05 * floor) * _errors(len(apart), main_lobe(width) / spacing, random)
        directions = np.arange(-margin, beams + margin)
        received = directions - np.arange(beams)[:, None] + beams + margin
        self._gains = gains.astype(np.float32)[received]
        # Noise comes from all around: so much a direction makes one of it a beam.
        self._noise = np.float32(1.0 / (self._gains**2).sum(axis=1).mean())
        inside = slice(margin, margin + beams)
        self.powers: Floats = self._gains[:, inside] ** 2  # beams x directions

    def receive(self, echoes: Floats) -> Floats:
        """Return the mean intensities of the beams, beams x bins, out of those of the directions, directions x bins."""
        received: Floats = self.powers @ echoes
        return received

    def receive_speckled(self, echoes: Floats, noise: float, looks: float, random: np.random.Generator) -> Floats:
        """Return intensities of one ping, beams x bins, out of the means of the directions, directions x bins.

        `noise` is what each beam has of it. Many scatterers in one direction and bin add up to a complex Gaussian
        amplitude (see sim.sensors.imaging.echoes.speckled). The result is the mean of a whole number of `looks`.
        """
        several = max(round(looks), 1)
        mean = np.full((self._gains.shape[1], echoes.shape[1]), noise * self._noise, np.float32)
        mean[self._margin : self._margin + len(echoes)] += echoes
        mean *= np.float32(-1.0 / several)
        intensities: Floats = np.zeros((len(self._gains), echoes.shape[1]), np.float32)
        received, magnitude, phase, part = np.empty_like(intensities), *(np.empty_like(mean) for _ in range(3))
        for _ in range(several):
            # Box and Muller's way to Gaussian parts: an exponential intensity and an even phase. Thrice as fast.
            random.random(out=magnitude, dtype=np.float32)
            np.subtract(np.float32(1.0), magnitude, out=magnitude)
            np.log(magnitude, out=magnitude)
            magnitude *= mean
            np.sqrt(magnitude, out=magnitude)
            random.random(out=phase, dtype=np.float32)
            phase *= np.float32(2.0 * np.pi)
            np.cos(phase, out=part)
            np.sin(phase, out=phase)
            for direction in (part, phase):
                direction *= magnitude
                np.matmul(self._gains, direction, out=received)
                received *= received
                intensities += received
        return intensities

    @staticmethod
    def is_coherent(looks: float) -> bool:
        """Return whether so many looks have speckle to speak of, which `receive_speckled` makes."""
        return 0.0 < looks <= _MOST_LOOKS


def _gains(angles: Floats, width: float, side_lobes: float) -> Floats:
    """Return the amplitude with which a beam receives at `angles` rad off its axis, without errors."""
    power = array_pattern(angles, width, side_lobes or np.inf)
    nulls = np.sin(angles) / np.sin(main_lobe(width))
    gains: Floats = np.sqrt(power) * np.where(np.sinc(nulls) < 0.0, -1.0, 1.0)
    return gains


def _errors(count: int, null: float, random: np.random.Generator) -> Floats:
    """Return what errors of elements add to gains: Gaussian, one on the average, as smooth as `null` steps allow."""
    places = np.arange(count) / null
    draws = np.arange(int(places[-1]) + 2)
    mixing = np.sinc(places[:, None] - draws)
    errors: Floats = (mixing / np.sqrt((mixing**2).sum(axis=1, keepdims=True))) @ random.standard_normal(len(draws))
    return errors

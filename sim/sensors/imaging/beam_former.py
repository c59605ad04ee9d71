"""The beam former of a forward sonar: each beam is the sum of all directions' amplitudes, weighted with its gains.

The echo from one direction has one complex amplitude, which all beams receive. So the side lobes of a bright object
have the same speckle in all beams: an arc that varies with range but not with bearing. The speckle and the noise of
neighbouring beams are correlated, because these beams receive nearly the same directions.

The gain of a beam (amplitude) is sinc, that of a uniform line array (Urick 1983, 3.3), with raised or lowered side
lobes (see sim.sensors.imaging.echoes.array_pattern). Errors of the array's elements add to it. They vary over angle as
fast as the beam is wide, and do not decrease with the angle. For N elements with rms errors p (phase, rad) and a
(relative amplitude), their mean power is (p² + a²) / N of the main lobe (Mailloux 2005, Phased Array Antenna Handbook,
chapter 7). They belong to the array and are the same in each ping. Not modelled: beams far off the middle of the fan
are wider.
"""

from math import ceil

import numpy as np

from sim.sensors.imaging.echoes import Floats, array_pattern, first_null

MAX_LOOKS = 4.0  # with more looks speckle is negligible
_MARGIN = 2.0  # in first nulls: noise is simulated this far beyond the fan


class BeamFormer:
    """Converts echoes by direction to echoes by beam, for as many directions as `beams`, `spacing` rad apart.

    A beam is `width` rad wide at half power. `side_lobes`: level of the first side lobe below the main lobe (dB); 0: no
    side lobes and no errors. `floor`: mean level of the errors of the elements below the main lobe (dB); 0: no errors.
    `random` draws the errors.
    """

    def __init__(
        self, beams: int, spacing: float, width: float, side_lobes: float, floor: float, random: np.random.Generator
    ) -> None:
        self._margin = margin = min(ceil(_MARGIN * first_null(width) / spacing), beams)
        offsets = np.arange(-(beams + margin), beams + margin + 1)
        gains = _gains(offsets * spacing, width, side_lobes)
        if side_lobes and floor:
            gains += 10.0 ** (-0.05 * floor) * _errors(len(offsets), first_null(width) / spacing, random)
        directions = np.arange(-margin, beams + margin)
        received = directions - np.arange(beams)[:, None] + beams + margin
        self._gains = gains.astype(np.float32)[received]
        # Noise comes from all directions: this much in each of them adds up to 1 in a beam.
        self._noise = np.float32(1.0 / (self._gains**2).sum(axis=1).mean())
        inside = slice(margin, margin + beams)
        self.powers: Floats = self._gains[:, inside] ** 2  # beams x directions

    def receive(self, echoes: Floats) -> Floats:
        """Return mean intensities by beam (beams x bins) from mean intensities by direction (directions x bins)."""
        received: Floats = self.powers @ echoes
        return received

    def receive_speckled(self, echoes: Floats, noise: float, looks: float, random: np.random.Generator) -> Floats:
        """Return the intensities of one ping (beams x bins, float32) with speckle and noise.

        `echoes` are mean intensities by direction (directions x bins), `noise` is the mean noise of a beam. The echoes
        of many scatterers in one direction and bin add up to a complex Gaussian amplitude (see
        sim.sensors.imaging.echoes.add_speckle). The result is the mean over `looks`, rounded to a whole number.
        """
        count = max(round(looks), 1)
        mean = np.full((self._gains.shape[1], echoes.shape[1]), noise * self._noise, np.float32)
        mean[self._margin : self._margin + len(echoes)] += echoes
        mean *= np.float32(-1.0 / count)
        intensities: Floats = np.zeros((len(self._gains), echoes.shape[1]), np.float32)
        received, magnitude, phase, real = np.empty_like(intensities), *(np.empty_like(mean) for _ in range(3))
        for _ in range(count):
            # Box-Muller transform: an exponential intensity and a uniform phase. It is three times as fast.
            random.random(out=magnitude, dtype=np.float32)
            np.subtract(np.float32(1.0), magnitude, out=magnitude)
            np.log(magnitude, out=magnitude)
            magnitude *= mean
            np.sqrt(magnitude, out=magnitude)
            random.random(out=phase, dtype=np.float32)
            phase *= np.float32(2.0 * np.pi)
            np.cos(phase, out=real)
            np.sin(phase, out=phase)
            for direction in (real, phase):
                direction *= magnitude
                np.matmul(self._gains, direction, out=received)
                received *= received
                intensities += received
        return intensities


def _gains(angles: Floats, width: float, side_lobes: float) -> Floats:
    """Return a beam's gain (amplitude) at `angles` rad off its axis, without errors of the elements."""
    power = array_pattern(angles, width, side_lobes or np.inf)
    nulls = np.sin(angles) / np.sin(first_null(width))
    gains: Floats = np.sqrt(power) * np.where(np.sinc(nulls) < 0.0, -1.0, 1.0)
    return gains


def _errors(count: int, null: float, random: np.random.Generator) -> Floats:
    """Return the errors of `count` gains: Gaussian with variance 1, band-limited to the first null of `null` steps."""
    positions = np.arange(count) / null
    draws = np.arange(int(positions[-1]) + 2)
    mixing = np.sinc(positions[:, None] - draws)
    errors: Floats = (mixing / np.sqrt((mixing**2).sum(axis=1, keepdims=True))) @ random.standard_normal(len(draws))
    return errors

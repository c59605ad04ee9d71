"""Effects of the pulse of a single-beam sonar: echoes as long as the pulse, and speckle that overlapping pings share.

An echo lasts as long as the pulse tau, so bins closer than c tau / 2 are correlated. The seabed is modelled as strips
of bearing that scatter independently. A beam weighs them with its two-way pattern, so pings whose beams overlap are
correlated, too. Let x be the sine of the angle between two pings, divided by that of the pattern's first null. The
correlation of their amplitudes is 6 (1 - sin a / a) / a², a = 2 pi x: the autocorrelation of sinc². When the sonar has
moved by more than half its aperture, its speckle is independent of that before.
"""

from math import ceil, pi, sin

import numpy as np

from sim.sensors.imaging.echoes import HALF_POWER, Floats, first_null

_PER_METRE = 8000.0  # us m/s: the maker's rule for the Ping360, in its ping-viewer (src/sensor/ping360.h)
_MIN_SAMPLES = 2.5  # minimum length of a pulse in samples
_MIN_PULSE, _MAX_PULSE = 5e-6, 500e-6  # s, of the Ping360's firmware
_MAX_PARTS = 32  # real and imaginary parts of 16 looks; with more looks little speckle is left
# In first nulls: width of a strip, and how far strips reach on each side of the beam (to the second null). Strips of
# this width sample the pattern sufficiently, because it is band-limited.
_STRIP, _REACH = 0.4, 2.0


def ping360_pulse(reach: float, step: float, speed: float) -> float:
    """Return the pulse length (s) of a Ping360 for a `reach` (m), a sample `step` (m) and a `speed` of sound (m/s)."""
    wanted = max(_PER_METRE * reach / speed * 1e-6, _MIN_SAMPLES * 2.0 * step / speed)
    return min(max(wanted, _MIN_PULSE), _MAX_PULSE)


def aperture_length(width: float, wavelength: float) -> float:
    """Return the length (m) of a line whose one-way beam is `width` rad wide at half power; `wavelength` in m."""
    return HALF_POWER * wavelength / sin(0.5 * width)


class PulseReceiver:
    """Computes the received intensities of successive pings, `count` bins each, of a pulse `length` bins long (>= 1).

    `width` is the one-way width of the beam (rad at half power), `aperture` the length of the transducer (m). `looks`
    are those of `add_speckle`, up to 16.
    """

    def __init__(
        self, count: int, length: float, width: float, aperture: float, looks: float, random: np.random.Generator
    ) -> None:
        self._count, self._random = count, random
        energies = np.clip(length - np.arange(ceil(length - 1e-9)), 0.0, 1.0)
        self._energies, self._amplitudes = energies.astype(np.float32), np.sqrt(energies).astype(np.float32)
        self._parts = min(max(round(2.0 * looks), 1), _MAX_PARTS) if looks else 0
        self._null_angle, self._max_offset = first_null(width), 0.5 * aperture
        self._strips_per_turn = ceil(2.0 * pi / (_STRIP * self._null_angle))  # over 360 deg
        self._strips: dict[int, Floats] = {}
        self._position: Floats = np.zeros(3)

    def receive(self, mean: Floats, noise: float, ringing: Floats, angle: float, position: Floats) -> Floats:
        """Return the intensities of a ping (bins, float32) from the `mean` intensities of a pulse as short as a bin.

        `noise` is the mean intensity of the noise; `ringing` (bins) is added coherently. `angle` is the bearing of the
        head (rad), `position` that of the sonar (NED, m).
        """
        mean = mean.astype(np.float32)
        if not self._parts:
            means: Floats = np.convolve(mean, self._energies)[: self._count] + np.float32(noise) + ringing
            return means
        amplitude, total = np.sqrt(mean), np.zeros(self._count, np.float32)
        noise_amplitude = np.float32((noise / float(self._energies.sum())) ** 0.5)
        ringing_amplitude: Floats | np.float32 = np.sqrt(ringing * np.float32(self._parts))
        noises = self._random.standard_normal((self._parts, self._count), np.float32)
        for speckle, part_noise in zip(self._draw_speckle(angle, position), noises, strict=True):
            received = (
                np.convolve(amplitude * speckle + noise_amplitude * part_noise, self._amplitudes)[: self._count]
                + ringing_amplitude
            )
            total += received * received
            ringing_amplitude = np.float32(0.0)  # it has one phase, so it is in the first part only
        intensities: Floats = total / np.float32(self._parts)
        return intensities

    def _draw_speckle(self, angle: float, position: Floats) -> Floats:
        """Return normal amplitudes of variance 1 (parts x bins), correlated between beams that overlap."""
        if float(((position - self._position) ** 2).sum()) > self._max_offset**2:
            self._strips, self._position = {}, position
        width = 2.0 * pi / self._strips_per_turn
        middle, reach = round(angle / width), ceil(_REACH * self._null_angle / width)
        numbers = range(middle - reach, middle + reach + 1)
        weights = np.sinc((np.array(numbers) * width - angle) / self._null_angle).astype(np.float32) ** 2
        previous, self._strips = self._strips, {}
        for strip in numbers:
            stored = previous.get(strip % self._strips_per_turn)
            drawn = self._random.standard_normal((self._parts, self._count), np.float32) if stored is None else stored
            self._strips[strip % self._strips_per_turn] = drawn
        speckle: Floats = np.tensordot(
            weights, np.stack([self._strips[strip % self._strips_per_turn] for strip in numbers]), 1
        )
        speckle /= np.float32(np.sqrt((weights * weights).sum()))
        return speckle

"""Propagation of sound in the sea: transmission loss, noise, and paths.

Levels are dB re 1 uPa (at 1 m for a source), spectral levels dB re 1 uPa²/Hz, frequencies Hz.
"""

from collections.abc import Iterator
from math import hypot, log10, sqrt
from typing import NamedTuple

_REFERENCE = 1.0  # m: the distance of a source level; there is no loss below it


def thorp_absorption(frequency: float) -> float:
    """Return dB/m at a frequency (Hz): Thorp's formula (J. Acoust. Soc. Am. 42, 1967), as in Brekhovskikh & Lysanov.

    The constants were read in ns-3 (uan-prop-model-thorp.cc), which uses them from 400 Hz on. The formula is for sea
    water of about 4 °C up to some 50 kHz (commonly given; not read in a source); it is used above that, too.
    """
    f2 = (frequency / 1000.0) ** 2
    return (0.11 * f2 / (1.0 + f2) + 44.0 * f2 / (4100.0 + f2) + 2.75e-4 * f2 + 0.003) / 1000.0


def transmission_loss(distance: float, frequency: float, spreading: float) -> float:
    """Return the loss (dB) over a distance (m): absorption and spreading (2 spherical, 1 cylindrical)."""
    path_length = max(distance, _REFERENCE)
    return 10.0 * spreading * log10(path_length) + thorp_absorption(frequency) * (path_length - _REFERENCE)


def ambient_noise(frequency: float, wind: float, shipping: float) -> float:
    """Return the noise spectral level of the sea at a frequency (Hz), `wind` (m/s) and `shipping` (0 none to 1 much).

    The sum of turbulence, ships, waves and thermal noise after Wenz (J. Acoust. Soc. Am. 34, 1962), in the formulas of
    Coates (1990), as in Stojanovic (WUWNet 2006); the constants were read in ns-3 (uan-noise-model-default.cc).
    """
    f = frequency / 1000.0
    levels = (
        17.0 - 30.0 * log10(f),
        40.0 + 20.0 * (shipping - 0.5) + 26.0 * log10(f) - 60.0 * log10(f + 0.03),
        50.0 + 7.5 * sqrt(wind) + 20.0 * log10(f) - 40.0 * log10(f + 0.4),
        -15.0 + 20.0 * log10(f),
    )
    return 10.0 * log10(sum(power(part) for part in levels))


def power(level: float) -> float:
    """Return a level in dB as a ratio of powers."""
    return float(10.0 ** (level / 10.0))


class Path(NamedTuple):
    """One path of sound: its length (m), and its numbers of reflections at the surface and the bottom."""

    length: float
    surface: int
    bottom: int


def paths(level_distance: float, source_depth: float, receiver_depth: float, depth: float, bounces: int) -> list[Path]:
    """Return the direct path and those with up to `bounces` reflections, the shortest first.

    The water is `depth` m deep, with a level bottom. Image sources are used (Jensen et al., Computational Ocean
    Acoustics, 2.4.4): the source is mirrored at surface and bottom alternately.
    """
    arrivals = [
        Path(hypot(level_distance, image - receiver_depth), surface, bottom)
        for image, surface, bottom in _images(source_depth, depth, bounces)
        if surface + bottom <= bounces
    ]
    return sorted(arrivals)


def _images(source: float, depth: float, bounces: int) -> Iterator[tuple[float, int, int]]:
    """Yield the depths of the image sources, and their numbers of reflections at surface and bottom."""
    for bounce in range(bounces + 1):
        around = 2.0 * bounce * depth
        yield source + around, bounce, bounce  # leaves upwards, comes from below; no bounce at all for turn 0
        yield -source - around, bounce + 1, bounce
        if bounce:
            yield source - around, bounce, bounce
            yield around - source, bounce - 1, bounce

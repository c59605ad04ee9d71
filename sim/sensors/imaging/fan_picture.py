"""A sonar's picture as the fan that it is, ahead upwards and port on the left: what displays of sonars show."""

from functools import lru_cache
from math import sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.sensors.imaging.samples import SonarImageSample

SIZE = 360  # pixels of the radius
_DEPTH = 4.0  # decades of intensity that are shown of true ones


def strengths(sample: SonarImageSample) -> NDArray[Any]:
    """Return the echoes, bins x beams, from 0 to 1; true intensities on a scale of their own, 40 dB deep."""
    if sample.encoding == "uint8":
        return np.frombuffer(sample.intensities, np.uint8).reshape(sample.bins, -1) / 255.0
    echoes = np.frombuffer(sample.intensities, np.float32).reshape(sample.bins, -1)
    most = float(echoes.max(initial=0.0)) or 1.0
    scaled: NDArray[Any] = np.clip(1.0 + np.log10(np.maximum(echoes / most, 10.0**-_DEPTH)) / _DEPTH, 0.0, 1.0)
    return scaled


def fan_grey(sample: SonarImageSample, size: int = SIZE) -> NDArray[np.uint8]:
    """Return the fan, height x width, from 0 to 255; 0 beyond its edges too."""
    echoes = strengths(sample)
    places, inside = fan_places(sample.beams, sample.bins, sample.first_range, sample.range_step, size)
    grey = (255.0 * echoes).astype(np.uint8).ravel()
    picture: NDArray[np.uint8] = np.where(inside, grey.take(places), 0).astype(np.uint8)
    return picture


@lru_cache(maxsize=8)
def fan_places(
    beams: tuple[float, ...], bins: int, first_range: float, range_step: float, size: int
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return for each pixel its place in the flattened echoes (bins x beams), and whether it is within the fan."""
    angles_of = np.array(beams)
    half = max(abs(beams[0]), abs(beams[-1]), 0.1)
    reach = first_range + bins * range_step
    wide = max(2, round(size * sin(min(half, 1.57)) * 2.0))
    y, x = np.mgrid[0:size, 0:wide]
    ahead, right = (size - 1 - y) * reach / size, (x - 0.5 * wide) * reach / size
    ranges, angles = np.hypot(ahead, right), np.arctan2(right, ahead)
    rows = ((ranges - first_range) / range_step).astype(int)
    inside = (ranges >= first_range) & (rows < bins) & (angles >= beams[0]) & (angles <= beams[-1])
    middles = 0.5 * (angles_of[1:] + angles_of[:-1])
    columns = np.searchsorted(middles, angles)
    places = np.clip(rows, 0, bins - 1) * len(beams) + columns
    return places.astype(np.int32), inside

"""Draw a sonar's picture as a fan, as displays of sonars do: ahead is up, port is on the left."""

from functools import lru_cache
from math import sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.sensors.imaging.samples import SonarImageSample

SIZE = 360  # pixels of the radius
_DECADES = 4.0  # of true intensities that are shown, from white down to black


def scale_echoes(sample: SonarImageSample) -> NDArray[Any]:
    """Return the echoes (bins x beams) as 0 to 1; true intensities on a scale of 40 dB below the maximum."""
    if sample.encoding == "uint8":
        return np.frombuffer(sample.intensities, np.uint8).reshape(sample.bins, len(sample.beams)) / 255.0
    echoes = np.frombuffer(sample.intensities, np.float32).reshape(sample.bins, len(sample.beams))
    maximum = float(echoes.max(initial=0.0)) or 1.0
    scaled: NDArray[Any] = np.clip(1.0 + np.log10(np.maximum(echoes / maximum, 10.0**-_DECADES)) / _DECADES, 0.0, 1.0)
    return scaled


def render_fan(sample: SonarImageSample, size: int = SIZE) -> NDArray[np.uint8]:
    """Return the fan as grey levels (height x width), `size` pixels high; 0 outside the fan."""
    echoes = scale_echoes(sample)
    cells, inside = map_fan_pixels(sample.beams, sample.bins, sample.first_range, sample.range_step, size)
    grey = (255.0 * echoes).astype(np.uint8).ravel()
    picture: NDArray[np.uint8] = np.where(inside, grey.take(cells), 0).astype(np.uint8)
    return picture


@lru_cache(maxsize=8)
def map_fan_pixels(
    beams: tuple[float, ...], bins: int, first_range: float, range_step: float, size: int
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return each pixel's index in the flattened echoes (bins x beams), and whether it is inside the fan."""
    angles_of = np.array(beams)
    half = max(abs(beams[0]), abs(beams[-1]), 0.1)
    reach = first_range + bins * range_step
    width = max(2, round(size * sin(min(half, 1.57)) * 2.0))
    y, x = np.mgrid[0:size, 0:width]
    ahead, right = (size - 1 - y) * reach / size, (x - 0.5 * width) * reach / size
    ranges, angles = np.hypot(ahead, right), np.arctan2(right, ahead)
    rows = ((ranges - first_range) / range_step).astype(int)
    inside = (ranges >= first_range) & (rows < bins) & (angles >= beams[0]) & (angles <= beams[-1])
    middles = 0.5 * (angles_of[1:] + angles_of[:-1])
    columns = np.searchsorted(middles, angles)
    cells = np.clip(rows, 0, bins - 1) * len(beams) + columns
    return cells.astype(np.int32), inside

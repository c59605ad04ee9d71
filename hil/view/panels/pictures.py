"""Pictures of cameras and sonars as arrays (height x width x 3, 8 bits), for the panels and the scene."""

from io import BytesIO
from math import sin
from typing import Any

import numpy as np

from sim.rotations import matrix
from sim.sensors.imaging.samples import SideScanSample, SonarImageSample
from sim.sensors.mounting import Mounting

FAN_SIZE = 360  # pixels of the radius
WATERFALL = 240  # pings of a side scan that are shown
MOST_ECHOES = 4000  # points of a fan in the scene
BACKGROUND = np.array([12, 18, 28], np.uint8)


def camera_picture(picture: Any) -> Any:
    """Return an Image or CompressedImage as RGB; None for what is no picture."""
    from PIL import Image, UnidentifiedImageError

    try:
        if picture.encoding == "rgb8":
            return np.frombuffer(picture.data, np.uint8).reshape(picture.height, picture.width, 3)
        return np.asarray(Image.open(BytesIO(picture.data)).convert("RGB"))
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError):
        return None


def strengths(sample: SonarImageSample) -> Any:
    """Return the echoes, bins x beams, from 0 to 1; true intensities on a scale of their own, 40 dB deep."""
    if sample.encoding == "uint8":
        return np.frombuffer(sample.intensities, np.uint8).reshape(sample.bins, -1) / 255.0
    echoes = np.frombuffer(sample.intensities, np.float32).reshape(sample.bins, -1)
    most = float(echoes.max(initial=0.0)) or 1.0
    return np.clip(1.0 + np.log10(np.maximum(echoes / most, 1e-4)) / 4.0, 0.0, 1.0)


def fan_picture(sample: SonarImageSample) -> Any:
    """Return a forward-looking sonar's picture as the fan it is, ahead upwards, port on the left."""
    echoes = strengths(sample)
    beams = np.array(sample.beams)
    half = max(abs(float(beams[0])), abs(float(beams[-1])), 0.1)
    reach = sample.first_range + sample.bins * sample.range_step
    wide = max(2, round(FAN_SIZE * sin(min(half, 1.57)) * 2.0))
    y, x = np.mgrid[0:FAN_SIZE, 0:wide]
    ahead, right = (FAN_SIZE - 1 - y) * reach / FAN_SIZE, (x - 0.5 * wide) * reach / FAN_SIZE
    ranges, angles = np.hypot(ahead, right), np.arctan2(right, ahead)
    bins = ((ranges - sample.first_range) / sample.range_step).astype(int)
    columns = np.clip(np.searchsorted(beams, angles), 0, len(beams) - 1)
    inside = (bins >= 0) & (bins < sample.bins) & (angles >= beams[0]) & (angles <= beams[-1])
    picture = np.full((FAN_SIZE, wide, 3), BACKGROUND)
    picture[inside] = _copper(echoes[np.clip(bins, 0, sample.bins - 1), columns])[inside]
    return picture


def fan_points(sample: SonarImageSample, altitude: float, mounting: Mounting = Mounting()) -> tuple[Any, Any]:
    """Return places (FRD of the vehicle, m) on a level bed `altitude` m below, and the strength of the echo from each.

    A picture does not tell how far up or down an echo came from. Those from nearer than the bed are put into the
    plane of the sonar's fan.
    """
    echoes = strengths(sample)
    step = max(1, round((echoes.size / MOST_ECHOES) ** 0.5))
    echoes = echoes[::step, ::step]
    ranges = (sample.first_range + (np.arange(sample.bins) + 0.5) * sample.range_step)[::step, None]
    beams = np.array(sample.beams)[None, ::step]
    turn = np.array(matrix(mounting.quaternion)).reshape(3, 3)
    along = np.stack([np.cos(beams), np.sin(beams), np.zeros_like(beams)], axis=2) @ turn.T
    level = along * (1.0, 1.0, 0.0)
    level /= np.maximum(np.linalg.norm(level, axis=2, keepdims=True), 1e-9)
    below = max(altitude - mounting.position[2], 0.0)
    reach = np.sqrt(np.maximum(ranges**2 - below**2, 0.0))[..., None]
    on_bed = level * reach + (0.0, 0.0, below)
    places = np.where(ranges[..., None] > below, on_bed, along * ranges[..., None]) + mounting.position
    strong = echoes > 0.08
    return places[strong], echoes[strong]


class Waterfall:
    """The pings of a side-scan sonar, the newest on top, port on the left."""

    def __init__(self) -> None:
        self._rows: list[Any] = []
        self._time_ns = 0

    def add(self, sample: SideScanSample) -> bool:
        """Add a ping; False for one that is there already."""
        if sample.time_ns == self._time_ns:
            return False
        self._time_ns = sample.time_ns
        kind = np.uint8 if sample.encoding == "uint8" else np.float32
        row = np.concatenate([np.frombuffer(sample.port, kind)[::-1], np.frombuffer(sample.starboard, kind)])
        if self._rows and len(row) != len(self._rows[0]):
            self._rows = []
        self._rows = [row.astype(float), *self._rows[: WATERFALL - 1]]
        return True

    def picture(self) -> Any:
        """Return what there is as a picture of always the same height."""
        rows = np.array(self._rows)
        rows = rows / (float(np.quantile(rows, 0.99)) or 1.0)
        picture = np.full((WATERFALL, rows.shape[1], 3), BACKGROUND)
        picture[: len(rows)] = _copper(np.clip(rows, 0.0, 1.0))
        return picture


def _copper(values: Any) -> Any:
    """Return the colours of sonar displays: from black by copper to white."""
    red, green, blue = np.clip(values * 1.6, 0, 1), np.clip(values * 1.05, 0, 1), np.clip(values * 1.3 - 0.35, 0, 1)
    return (np.stack([red, green, blue], axis=-1) * 255.0).astype(np.uint8)

"""Pictures of cameras and sonars as arrays (height x width x 3, 8 bits), for the panels and the scene."""

from collections.abc import Sequence
from io import BytesIO
from math import hypot
from typing import Any

import numpy as np

from sim.rotations import matrix
from sim.sensors.imaging.fan_picture import SIZE, map_fan_pixels, scale_echoes
from sim.sensors.imaging.samples import SideScanSample, SonarImageSample
from sim.sensors.mounting import Mounting

FAN_SIZE = SIZE
WATERFALL = 240  # shown pings of a side scan
_MIN_ROWS, _MAX_ROWS = 0.05, 40.0  # per ping; fewer: the vehicle stands still; more: pings were lost
MAX_ECHOES = 4000  # points of a sonar fan in the scene
BACKGROUND = np.array([12, 18, 28], np.uint8)


def camera_picture(picture: Any) -> Any:
    """Return an Image or CompressedImage as RGB; None if it cannot be decoded."""
    from PIL import Image, UnidentifiedImageError

    try:
        if picture.encoding == "rgb8":
            return np.frombuffer(picture.data, np.uint8).reshape(picture.height, picture.width, 3)
        return np.asarray(Image.open(BytesIO(picture.data)).convert("RGB"))
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError):
        return None


def fan_picture(sample: SonarImageSample) -> Any:
    """Return a forward-looking sonar's picture as a fan, with ahead at the top and port on the left."""
    places, inside = map_fan_pixels(sample.beams, sample.bins, sample.first_range, sample.range_step, FAN_SIZE)
    picture = np.full((*inside.shape, 3), BACKGROUND)
    picture[inside] = _copper(scale_echoes(sample).ravel().take(places[inside]))
    return picture


def fan_points(sample: SonarImageSample, altitude: float, mounting: Mounting = Mounting()) -> tuple[Any, Any]:
    """Return the points of the echoes (n x 3, FRD of the vehicle, m), and their strengths (n).

    A sonar picture has no vertical angle, so echoes are placed on a level seabed `altitude` m below the vehicle. Those
    with a range shorter than to the seabed are placed in the plane of the sonar's fan.
    """
    echoes = scale_echoes(sample)
    step = max(1, round((echoes.size / MAX_ECHOES) ** 0.5))
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
    """The pings of a side-scan sonar, the newest at the top, port on the left.

    A row covers the same length of the track as a column covers of the range, so that objects keep their shape. Rows
    between pings are interpolated. Each ping comes with the vehicle's position; without it a ping is one row.
    """

    def __init__(self) -> None:
        self._pings: list[Any] = []
        self._spacings: list[float] = []  # rows from the previous ping
        self._time_ns = 0
        self._position: Sequence[float] | None = None

    def add(self, sample: SideScanSample, position: Sequence[float] | None = None) -> bool:
        """Add a ping, sent at a `position` (NED, m). Return False if it was added already."""
        if sample.time_ns == self._time_ns:
            return False
        self._time_ns = sample.time_ns
        kind = np.uint8 if sample.encoding == "uint8" else np.float32
        row = np.concatenate([np.frombuffer(sample.port, kind)[::-1], np.frombuffer(sample.starboard, kind)])
        if self._pings and len(row) != len(self._pings[0]):
            self._pings, self._spacings = [], []
        rows, before, self._position = 1.0, self._position, position
        if before and position:
            distance = hypot(position[0] - before[0], position[1] - before[1])
            rows = min(max(distance / (sample.range_step or 1.0), _MIN_ROWS), _MAX_ROWS)
        self._pings = [row.astype(float), *self._pings[: WATERFALL - 1]]
        self._spacings = [rows, *self._spacings[: WATERFALL - 1]]
        return True

    def picture(self) -> Any:
        """Return the pings as a picture (WATERFALL x width x 3); rows without pings have the background colour."""
        pings = np.array(self._pings)
        at = np.append(0.0, np.cumsum(self._spacings[:-1]))
        count = min(WATERFALL, int(at[-1] + 1e-6) + 1)
        place = np.interp(np.arange(count), at, np.arange(len(at)))
        low = np.minimum(place.astype(int), max(len(at) - 2, 0))
        share = (place - low)[:, None]
        rows = pings[low] * (1.0 - share) + pings[np.minimum(low + 1, len(at) - 1)] * share
        rows = rows / (float(np.quantile(rows, 0.99)) or 1.0)
        picture = np.full((WATERFALL, rows.shape[1], 3), BACKGROUND)
        picture[:count] = _copper(np.clip(rows, 0.0, 1.0))
        return picture


def _copper(values: Any) -> Any:
    """Return the colours of `values` (0 to 1) on sonar displays: from black over copper to white."""
    red, green, blue = np.clip(values * 1.6, 0, 1), np.clip(values * 1.05, 0, 1), np.clip(values * 1.3 - 0.35, 0, 1)
    return (np.stack([red, green, blue], axis=-1) * 255.0).astype(np.uint8)

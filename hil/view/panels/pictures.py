"""Pictures of cameras and sonars for the page: photographs as JPEG, sonars as grey levels that the page colours."""

from collections.abc import Sequence
from io import BytesIO
from math import hypot
from typing import Any

import numpy as np

from hil.view.feed import Encoded
from sim.sensors.imaging.fan_picture import scale_echoes
from sim.sensors.imaging.samples import SideScanSample, SonarImageSample

WATERFALL = 240  # shown pings of a side scan
_MIN_ROWS, _MAX_ROWS = 0.05, 40.0  # per ping; fewer: the vehicle stands still; more: pings were lost
QUALITY = 85  # of JPEG


def camera_picture(picture: Any) -> Encoded | None:
    """Return an Image or CompressedImage as the browser shows it; None if it cannot be decoded."""
    from PIL import Image, UnidentifiedImageError

    try:
        if picture.encoding != "rgb8":
            with Image.open(BytesIO(picture.data)) as opened:  # reads the head only
                width, height = opened.size
                kind = str(opened.get_format_mimetype())
            return Encoded({"kind": "camera", "type": kind, "width": width, "height": height}, bytes(picture.data))
        pixels = np.frombuffer(picture.data, np.uint8).reshape(picture.height, picture.width, 3)
        return Encoded({"kind": "camera", "width": picture.width, "height": picture.height}, _jpeg(pixels))
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError):
        return None


def sonar_picture(sample: SonarImageSample) -> Encoded:
    """Return the echoes of a forward-looking sonar: a row for each range, a column for each beam."""
    header = {
        "kind": "sonar", "beams": list(sample.beams), "first": sample.first_range, "step": sample.range_step,
        "bins": sample.bins,
    }  # fmt: skip
    return Encoded(header, _jpeg((255.0 * scale_echoes(sample)).astype(np.uint8)))


def side_scan_picture(waterfall: "Waterfall", sample: SideScanSample) -> Encoded:
    """Return the waterfall of a side-scan sonar, the newest ping at the top."""
    return Encoded({"kind": "side_scan", "step": sample.range_step, "bins": sample.bins}, _jpeg(waterfall.picture()))


def _jpeg(pixels: Any) -> bytes:
    from PIL import Image

    stream = BytesIO()
    Image.fromarray(pixels).save(stream, "jpeg", quality=QUALITY)
    return stream.getvalue()


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
        """Return the pings as grey levels (WATERFALL x width); rows without pings are 0."""
        pings = np.array(self._pings)
        at = np.append(0.0, np.cumsum(self._spacings[:-1]))
        count = min(WATERFALL, int(at[-1] + 1e-6) + 1)
        rows = np.stack([np.interp(np.arange(count), at, column) for column in pings.T], axis=1)
        rows = rows / (float(np.quantile(rows, 0.99)) or 1.0)
        picture = np.zeros((WATERFALL, rows.shape[1]), np.uint8)
        picture[:count] = 255.0 * np.clip(rows, 0.0, 1.0)
        return picture

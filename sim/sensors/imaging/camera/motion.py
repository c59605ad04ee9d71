"""Effects of motion on a camera's picture: motion blur during the exposure, and the skew of a rolling shutter.

Both shift the pixels of one picture along the optical flow, which follows from the camera's motion and the range of
each pixel. Not modelled: surfaces that an edge uncovers meanwhile, motion of objects.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.rotations import rotate_inverse
from sim.sensors.mounting import Mounting

Floats = NDArray[np.float32]

_MAX_TAPS = 32  # number of positions on the path of a pixel that are averaged for blur
_MIN_FLOW = 0.25  # pixels: smaller shifts change no pixel, and are not computed


class RawPicture(NamedTuple):
    """A picture before the image sensor: radiance (n x 3), range (n, m) and object number (n) of each pixel."""

    radiance: Floats
    ranges: Any
    objects: NDArray[np.int32]


class Motion:
    """Motion during the exposure and readout (times in s) of a picture.

    `size` is its width and height and `focal` the focal length, in pixels. `toward` are the unit vectors of its pixels
    (n x 3) in the sensor's axes.
    """

    def __init__(
        self, size: tuple[int, int], focal: float, toward: Floats, exposure_time: float, readout_time: float
    ) -> None:
        self._width, self._height = size
        self._focal, self._exposure, self._readout = focal, exposure_time, readout_time
        ahead = np.maximum(toward[:, 0], 1e-3)
        self._ahead, self._x, self._y = ahead, toward[:, 1] / ahead, toward[:, 2] / ahead
        rows, columns = np.divmod(np.arange(len(toward)), self._width)
        self._rows, self._columns = rows.astype(np.float32), columns.astype(np.float32)
        self._row_times = ((rows + 0.5) / self._height - 0.5).astype(np.float32) * np.float32(readout_time)

    def flow(self, mounting: Mounting, nu: Any, ranges: Any) -> tuple[Floats, Floats]:
        """Return the optical flow of each pixel to the right and down (pixels/s).

        `nu` is the velocity of the vehicle (m/s and rad/s, body axes), `ranges` (n) in m. It is the time derivative of
        the pinhole projection (Longuet-Higgins & Prazdny 1980).
        """
        orientation = mounting.quaternion
        va, vr, vd = rotate_inverse(orientation, mounting.velocity(nu))
        wa, wr, wd = rotate_inverse(orientation, nu[3:6])
        nearness = (1.0 / np.maximum(np.asarray(ranges) * self._ahead, 0.05)).astype(np.float32)
        x, y = self._x, self._y
        forward = -va * nearness - (wr * y - wd * x)
        right = -vr * nearness - (wd - wa * y) - x * forward
        down = -vd * nearness - (wa * x - wr) - y * forward
        return (self._focal * right).astype(np.float32), (self._focal * down).astype(np.float32)

    def apply(self, picture: RawPicture, mounting: Mounting, nu: Any) -> RawPicture:
        """Return the picture with the skew of the rolling shutter and with motion blur."""
        right, down = self.flow(mounting, nu, picture.ranges)
        max_flow = float(np.hypot(right, down).max(initial=0.0))
        if self._readout and max_flow * self._readout > _MIN_FLOW:
            # A late row shows what is at an earlier point of the flow in the picture of the middle time.
            pixels = self._pixels_at(right * -self._row_times, down * -self._row_times)
            picture = RawPicture(picture.radiance[pixels], np.asarray(picture.ranges)[pixels], picture.objects[pixels])
            right, down = right[pixels], down[pixels]
        if self._exposure and max_flow * self._exposure > _MIN_FLOW:
            taps = min(max(2, int(max_flow * self._exposure) + 1), _MAX_TAPS)
            total = np.zeros_like(picture.radiance)
            for instant in (np.arange(taps) + 0.5) / taps - 0.5:
                share = np.float32(instant * self._exposure)
                total += picture.radiance[self._pixels_at(right * share, down * share)]
            picture = picture._replace(radiance=total / np.float32(taps))
        return picture

    def _pixels_at(self, right: Floats, down: Floats) -> NDArray[np.int64]:
        """Return the index of the pixel at this offset from each pixel, limited to the picture."""
        rows = np.clip(np.rint(self._rows + down), 0, self._height - 1).astype(np.int64)
        columns = np.clip(np.rint(self._columns + right), 0, self._width - 1).astype(np.int64)
        pixels: NDArray[np.int64] = rows * self._width + columns
        return pixels

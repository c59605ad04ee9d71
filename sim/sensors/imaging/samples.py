"""Samples of imaging sensors. Conventions are those of sim.sensors.samples.

Pictures are bytes, row by row. Numbers of more than one byte have the byte order of this machine (little-endian on all
supported machines), so that numpy.frombuffer reads them.
"""

from typing import Literal, NamedTuple

from hil.common.errors import MissingExtraError
from sim.sensors.extra_samples import LaserSample

# Coefficients k1, k2, p1, p2, k3 of a lens: ROS's "plumb_bob".
Distortion = tuple[float, float, float, float, float]
# Of echoes: uint8 is what a device outputs (grey, 0 to 255), float32 the true intensities.
Encoding = Literal["uint8", "float32"]


class Intrinsics(NamedTuple):
    """Pinhole camera model: focal lengths and principal point in pixels; the middle of the first pixel is (0, 0)."""

    fx: float
    fy: float
    cx: float
    cy: float


class CameraSample(NamedTuple):
    """A picture of `width` x `height` pixels, row by row from the upper left.

    The optical axis is the sensor's x axis; its y axis is to the right, its z axis down. `rgb`: three bytes for each
    pixel. `depth`: a 32-bit float for each pixel, m along the optical axis, inf where nothing is in range; None if the
    camera has no depth. `labels`: a 32-bit integer for each pixel, the object number of sim.rays.scene.RayScene; None
    without ground truth. `rgb`, `depth` and `labels` include the lens's `distortion`. `points`: three 32-bit floats for
    each pixel, its position in the sensor's axes (m; nan without depth), corrected for the lens; None if not requested.
    """

    time_ns: int
    width: int
    height: int
    rgb: bytes
    depth: bytes | None
    labels: bytes | None
    intrinsics: Intrinsics
    distortion: Distortion
    points: bytes | None = None


class SonarImageSample(NamedTuple):
    """Picture of a forward-looking or scanning sonar: one row for each range bin, the nearest first.

    A row has one number for each beam, from port to starboard. `beams` are their angles (rad) about the sensor's z axis
    from x (ahead) towards y (starboard), ascending. Bin i begins at `first_range` + i `range_step` (m), computed with
    the device's `sound_speed` (m/s). `frequency` is in Hz; `beam_width` and `beam_height` (rad) are those of one beam
    at half power.
    """

    time_ns: int
    beams: tuple[float, ...]
    bins: int
    first_range: float
    range_step: float
    frequency: float
    sound_speed: float
    beam_width: float
    beam_height: float
    encoding: Encoding
    intensities: bytes


class EchoSample(NamedTuple):
    """One ping of a scanning sonar: the distance of its first echo, and all echoes as a picture of one beam."""

    time_ns: int
    scan: LaserSample
    echoes: SonarImageSample


class SideScanSample(NamedTuple):
    """One ping of a side-scan sonar: `bins` numbers for each side by slant range, the nearest first.

    Bin i begins at i `range_step` (m). `altitude` is the range of the first echo of the bottom (m), inf without one.
    `frequency` is in Hz; `beam_width` (rad) is along the track, `beam_height` (rad) across it.
    """

    time_ns: int
    bins: int
    range_step: float
    frequency: float
    sound_speed: float
    beam_width: float
    beam_height: float
    altitude: float
    encoding: Encoding
    port: bytes
    starboard: bytes


def require_numpy(sensor: str) -> None:
    """Check that numpy, which a `sensor` needs for its pictures, is installed. Raises MissingExtraError."""
    from importlib.util import find_spec

    if find_spec("numpy") is None:
        raise MissingExtraError(f"sensors: {sensor} needs numpy: pip install 'uuv-hil[imaging]'")

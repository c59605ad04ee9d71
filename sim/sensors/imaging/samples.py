"""Samples of imaging sensors. Conventions are those of sim.sensors.samples.

Pictures are bytes, row after row; a number of more than one byte is as this machine has it (little-endian on all that
this runs on), so that numpy.frombuffer takes it as it is.
"""

from typing import Literal, NamedTuple

from hil.common.errors import MissingExtraError
from sim.sensors.extra_samples import LaserSample

# Of a lens, k1, k2, p1, p2, k3: ROS's "plumb_bob".
Distortion = tuple[float, float, float, float, float]
# Echoes: what a device sends (grey, 0 to 255), or the true echo intensities.
Encoding = Literal["uint8", "float32"]


class Intrinsics(NamedTuple):
    """A pinhole: focal lengths and principal point in pixels; the middle of the first pixel is (0, 0)."""

    fx: float
    fy: float
    cx: float
    cy: float


class CameraSample(NamedTuple):
    """A picture of `width` x `height` pixels, from the upper left; u grows to the right, v downwards.

    The optical axis is the sensor's x, to the right is its y, down its z. `rgb`: three bytes a pixel. `depth`: a 32-bit
    float a pixel, m along the optical axis, inf where there is nothing within reach; None if the camera gives none.
    `labels`: a 32-bit integer a pixel, which object of sim.rays.scene.RayScene it is; only of the ground truth. The
    lens distorts the picture by `distortion`, depth and labels with it. `points`: three 32-bit floats a pixel, where in
    the sensor's axes that depth is (m; nan where there is none), the lens accounted for; None if not asked for.
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
    """A forward-looking sonar's picture: a row a range bin, the nearest first; a number a beam, from port on.

    `beams` are the angles (rad) about the sensor's z axis from x (ahead) towards y (starboard), growing. Bin i reaches
    from `first_range` + i `range_step` m on, as far as the device thinks with its `sound_speed` (m/s). `frequency` Hz;
    `beam_width` and `beam_height` rad are those of one beam at half power.
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
    """One ping of a scanning sonar: the distance of its first echo, and its echoes by range, a picture of one beam."""

    time_ns: int
    scan: LaserSample
    echoes: SonarImageSample


class SideScanSample(NamedTuple):
    """One ping of a side-scan sonar: `bins` numbers a side by slant range, the nearest first.

    Bin i reaches from i `range_step` m on. `altitude` is the range of the first bottom return (m), as the device tracks
    it: inf if there is none. `frequency` Hz; `beam_width` rad is along the track, `beam_height` across it.
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


def need_numpy(sensor: str) -> None:
    """Check that numpy, which a `sensor` needs for its pictures, is installed. Raises MissingExtraError."""
    from importlib.util import find_spec

    if find_spec("numpy") is None:
        raise MissingExtraError(f"sensors: {sensor} needs numpy: pip install 'uuv-hil[imaging]'")

"""The model of a camera: its keys in the scenario."""

from math import pi
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range

WaterType = Literal["clear", "I", "IA", "IB", "II", "III", "1C", "3C", "7C", "9C"]

_DEGREE = pi / 180.0
_MAX_POINTS = 4_000_000  # that one message can carry
_Coefficient = Annotated[float, Range(-10.0, 10.0)]


class CameraModel(NamedTuple):
    """Rate in Hz (0: none), size of the picture in pixels, horizontal field of view (rad), water, noise and effects.

    Lens: pixels are square; the optical axis is in the middle of the picture. `distortion` is k1, k2, p1, p2, k3 of
    ROS's "plumb_bob". `vignetting` is the share of the natural decrease of light, cos⁴ of the angle to the axis.

    Water: `water` is a Jerlov type (see sim.environment.optics.jerlov), or "clear" for none.

    Depth: `depth` enables a depth image up to `max_range` m. `depth_noise` is its standard deviation at 1 m (m), which
    grows with the square of the range, as for a stereo camera. `points` adds the same data as a point cloud.

    With `tilts` the camera turns with the tilt of the vehicle's `[accessories]`, whose lights dim its lamps.

    Light: `lamps` is the radiance of a white wall 1 m ahead in the light of the lamps, relative to full daylight.
    `exposure` is the factor from such radiances to the sensor's range; 0: automatic, so that the bright parts of each
    picture are nearly white. `full_well` is the number of electrons that a pixel can hold, `read_noise` the standard
    deviation of the electrons that reading adds.

    With `ground_truth` there is no water, noise or vignetting, and the sample has labels.

    The effects below are off by default, and not part of the ground truth. The lamps are at the camera, or there are
    two of them, `lamp_offset` m to each side of it. Only in the latter case `lamp_shadows` are visible, at the cost of
    one more cast of rays for each lamp, and there is `backscatter` of the lamps' light by the water, as a factor on
    that of Petzold's particles. `snow` is the number of particles of marine snow per m³, which are fixed in the water.
    `exposure_time` (s) causes motion blur. `readout_time` (s) is that of a rolling shutter from the first row to the
    last. The time of the sample is the middle of both. Motion effects shift the pixels of one picture to first order.

    All numbers are our choice, near those of small industrial cameras.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 5.0
    width: Annotated[int, Range(1, 4096)] = 320
    height: Annotated[int, Range(1, 4096)] = 240
    field_of_view: Annotated[float, Range(0.01, 0.95 * pi, "rad")] = 80.0 * _DEGREE
    distortion: tuple[_Coefficient, _Coefficient, _Coefficient, _Coefficient, _Coefficient] = (0.0,) * 5
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 30.0
    depth: bool = True
    depth_noise: Annotated[float, Range(0.0, 1.0, "m")] = 0.002
    points: bool = False
    water: WaterType = "II"
    lamps: Annotated[float, Range(0.0, 1000.0)] = 0.0
    lamp_offset: Annotated[float, Range(0.0, 10.0, "m")] = 0.0
    lamp_shadows: bool = False
    backscatter: Annotated[float, Range(0.0, 100.0)] = 0.0
    snow: Annotated[float, Range(0.0, 5000.0, "1/m³")] = 0.0
    exposure_time: Annotated[float, Range(0.0, 1.0, "s")] = 0.0
    readout_time: Annotated[float, Range(0.0, 1.0, "s")] = 0.0
    exposure: Annotated[float, Range(0.0, 1e6)] = 0.0
    full_well: Annotated[float, Range(10.0, 1e7)] = 10_000.0
    read_noise: Annotated[float, Range(0.0, 1e4)] = 8.0
    vignetting: Annotated[float, Range(0.0, 1.0)] = 0.5
    tilts: bool = True
    ground_truth: bool = False

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if self.points and not self.depth:
            return "points = true needs depth = true"
        if self.points and self.width * self.height > _MAX_POINTS:
            return f"points: {self.width} x {self.height} are more than {_MAX_POINTS}; take a smaller picture"
        for key in ("lamp_shadows", "backscatter"):
            if getattr(self, key) and not (self.lamps and self.lamp_offset):
                return f"{key} needs lamps and a lamp_offset above 0: lamps at the lens itself show none"
        return None

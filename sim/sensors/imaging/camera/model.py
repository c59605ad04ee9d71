"""The keys of a camera."""

from math import pi
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range

WaterType = Literal["clear", "I", "IA", "IB", "II", "III", "1C", "3C", "7C", "9C"]

_DEGREE = pi / 180.0
_MAX_POINTS = 4_000_000  # what fits a message
_Coefficient = Annotated[float, Range(-10.0, 10.0)]


class CameraModel(NamedTuple):
    """Rate in Hz (0: none), the picture's size in pixels, its width in angle (rad), the water, and what disturbs.

    Pixels are square; the optical axis goes through the middle. `distortion` is k1, k2, p1, p2, k3 of ROS's
    "plumb_bob". `water` is a Jerlov type (see sim.environment.optics.jerlov), or "clear" for none. `depth` asks for
    a depth image as far as `max_range` m, with `depth_noise` m standard deviation at 1 m, growing with the square
    of the range as that of a stereo camera, and `points` for the same as a cloud of points. `lamps` is what a white
    wall 1 m ahead sends back of their light, 1 being what it sends back in full daylight. `exposure` is the factor
    from such radiances to the sensor's range, 0: found for each picture so that its bright parts are near white.
    `full_well` is how many electrons a pixel holds and `read_noise` how many reading adds (standard deviation);
    `vignetting` is the share of the fall of light by the fourth power of the cosine off the axis that the lens has.
    With `ground_truth` there is no water, noise, or vignetting, and labels are given. `renderer` "rays" casts a ray
    a pixel; "opengl" (extra `opengl`) rasterises what they would meet, to 1 part in 10 000 but for a few pixels at
    outlines. By Mesa's software it is no faster than rays; `python tools/costs/ray_cost.py --pictures` measures it.

    The rest is off by default, the same with both renderers, and absent from the ground truth. The lamps are at the
    camera, or two of them `lamp_offset` m to either side of it. Only then can `lamp_shadows` be seen, for a cast of
    rays more a lamp, and `backscatter` can be computed: what the water between sends back of their light, `backscatter`
    times that of Petzold's particles. `snow` is the number of particles of marine snow in a m³, which stay where
    they are in the water. `caustics` is the contrast that waves give to daylight on the seabed, 1 at its best depth
    of about a metre under a sun overhead. `exposure_time` s is the time over which motion blurs, `readout_time` s
    that of a rolling shutter from the first row to the last; the sample's time is the middle of both. They move the
    pixels of one picture by their first derivative.

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
    caustics: Annotated[float, Range(0.0, 1.0)] = 0.0
    exposure_time: Annotated[float, Range(0.0, 1.0, "s")] = 0.0
    readout_time: Annotated[float, Range(0.0, 1.0, "s")] = 0.0
    exposure: Annotated[float, Range(0.0, 1e6)] = 0.0
    full_well: Annotated[float, Range(10.0, 1e7)] = 10_000.0
    read_noise: Annotated[float, Range(0.0, 1e4)] = 8.0
    vignetting: Annotated[float, Range(0.0, 1.0)] = 0.5
    ground_truth: bool = False
    renderer: Literal["rays", "opengl"] = "rays"

    def validate(self) -> str | None:
        """Return what is wrong between the keys, or None: too many points, or lamps that are not there."""
        if self.points and not self.depth:
            return "points = true needs depth = true"
        if self.points and self.width * self.height > _MAX_POINTS:
            return f"points: {self.width} x {self.height} are more than {_MAX_POINTS}; take a smaller picture"
        for key in ("lamp_shadows", "backscatter"):
            if getattr(self, key) and not (self.lamps and self.lamp_offset):
                return f"{key} needs lamps and a lamp_offset above 0: lamps at the lens itself show none"
        return None

"""A camera under water, with the depth of each pixel for those that have it (RGB-D)."""

from math import pi, tan
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from hil.schema import Range
from sim.dynamics import State
from sim.sensors.imaging_samples import CameraSample, Distortion, Intrinsics, need_numpy
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene

if TYPE_CHECKING:
    from sim.rays.solids import Solid

WaterType = Literal["clear", "I", "IA", "IB", "II", "III", "1C", "3C", "7C", "9C"]

_DEGREE = pi / 180.0
_MOST_POINTS = 4_000_000  # what fits a message
_Coefficient = Annotated[float, Range(-10.0, 10.0)]


class CameraModel(NamedTuple):
    """Rate in Hz (0: none), the picture's size in pixels, its width in angle (rad), the water, and what disturbs.

    Pixels are square; the optical axis goes through the middle. `distortion` is k1, k2, p1, p2, k3 of ROS's
    "plumb_bob". `water` is a Jerlov type (see sim.optics.jerlov), or "clear" for none. `depth` asks for a depth image
    as far as `max_range` m, with `depth_noise` m standard deviation at 1 m, growing with the square of the range as
    that of a stereo camera, and `points` for the same as a cloud of points. `lamps` is what a white wall 1 m ahead
    sends back of their light, 1 being what it sends back in full daylight. `exposure` is the factor from such radiances
    to the sensor's range, 0: found for each picture so that its bright parts are near white. `full_well` is how many
    electrons a pixel holds and `read_noise` how many reading adds (standard deviation); `vignetting` is the share of
    the fall of light by the fourth power of the cosine off the axis that the lens has. With `ground_truth` there is no
    water, noise, or vignetting, and labels are given. `renderer` "rays" casts a ray a pixel; "opengl" (extra `opengl`)
    rasterises what they would meet, to 1 part in 10 000 but for a few pixels at outlines, through a lens that does not
    distort. In software that pays while there are five pixels or more to each cell of the terrain within `max_range`
    ahead; `python tools/ray_cost.py --pictures` measures it.

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
    exposure: Annotated[float, Range(0.0, 1e6)] = 0.0
    full_well: Annotated[float, Range(10.0, 1e7)] = 10_000.0
    read_noise: Annotated[float, Range(0.0, 1e4)] = 8.0
    vignetting: Annotated[float, Range(0.0, 1.0)] = 0.5
    ground_truth: bool = False
    renderer: Literal["rays", "opengl"] = "rays"

    def problem(self) -> str | None:
        """Points of a camera that gives no depth, or more of them than travel at once; what OpenGL cannot draw."""
        if self.points and not self.depth:
            return "points = true needs depth = true"
        if self.points and self.width * self.height > _MOST_POINTS:
            return f"points: {self.width} x {self.height} are more than {_MOST_POINTS}; take a smaller picture"
        if self.renderer == "opengl" and any(self.distortion):
            return 'renderer = "opengl" draws no distortion; take renderer = "rays"'
        return None


class Camera:
    """Looks along the sensor's x axis; what is to its right is starboard of it, what is below lower in the picture.

    Rays give what each pixel sees in its middle, sim.sensors.scenery its colour, sim.optics what the water makes of
    that. Daylight fades with depth; the water's surface is flat. Not modelled: motion blur, a rolling shutter, focus,
    pixels that see an edge in parts, the backscatter of the lamps; depth is found wherever a ray ends, though a stereo
    camera would find none in fog.
    """

    Model = CameraModel
    topic = "camera"
    heavy = True

    def __init__(self, model: CameraModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        need_numpy(self.topic)
        from sim.sensors.camera_picture import Development, Eye

        self._model = model
        focal = 0.5 * model.width / tan(0.5 * model.field_of_view)
        self._intrinsics = Intrinsics(focal, focal, 0.5 * (model.width - 1), 0.5 * (model.height - 1))
        self._distortion: Distortion = model.distortion
        self._eye = Eye(model, self._intrinsics, mounting, scene)
        self._development = Development(model, self._eye.axial, seed, self.topic)

    def add(self, solid: "Solid", state: State) -> None:
        """Let it see a solid that goes with a vehicle's `state`, its own axes the body's."""
        self._eye.add(solid, state)

    def sample(self, time_ns: int, state: State) -> CameraSample:
        """The measurement of `state`."""
        m = self._model
        radiance, ranges, objects = self._eye.look(time_ns, state)
        rgb, depth = self._development.develop(radiance, ranges)
        return CameraSample(
            time_ns, m.width, m.height, rgb, depth if m.depth else None,
            objects.tobytes() if m.ground_truth else None, self._intrinsics, self._distortion,
            self._eye.points(depth) if m.points else None,
        )  # fmt: skip

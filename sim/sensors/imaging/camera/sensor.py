"""An underwater camera, also with the depth of each pixel (RGB-D)."""

from math import tan
from typing import TYPE_CHECKING

from sim.dynamics import State
from sim.sensors.error import sensor_random
from sim.sensors.imaging.camera.model import CameraModel
from sim.sensors.imaging.samples import CameraSample, Distortion, Intrinsics, require_numpy
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene

if TYPE_CHECKING:
    from sim.rays.solids import Solid


class Camera:
    """A camera along the sensor's x axis. Starboard is to the right of the picture, down is below.

    One ray through the middle of each pixel finds the visible surface. sim.sensors.imaging.scenery computes its colour,
    sim.environment.optics the effect of the water, sim.sensors.imaging.camera.effects that of lamps, particles and
    motion. Daylight decreases with depth. The water's surface is flat. Not modelled: focus, pixels at edges that
    see two objects. Depth is measured wherever a ray hits, also in turbid water, where a stereo camera measures none.
    """

    Model = CameraModel
    topic = "camera"
    offloaded = True

    def __init__(self, model: CameraModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        require_numpy(self.topic)
        from sim.sensors.imaging.camera.image_sensor import ImageSensor
        from sim.sensors.imaging.camera.picture import PictureRenderer

        self._model = model
        focal = 0.5 * model.width / tan(0.5 * model.field_of_view)
        self._intrinsics = Intrinsics(focal, focal, 0.5 * (model.width - 1), 0.5 * (model.height - 1))
        self._distortion: Distortion = model.distortion
        self._renderer = PictureRenderer(
            model, self._intrinsics, mounting, scene, sensor_random(seed, f"{self.topic}/water").getrandbits(63)
        )
        self._image_sensor = ImageSensor(model, self._renderer.axial, seed, self.topic)

    def add(self, solid: "Solid", state: State) -> None:
        """Add a solid that moves with a vehicle's `state`; its axes are the body's."""
        self._renderer.add(solid, state)

    def sample(self, time_ns: int, state: State) -> CameraSample:
        """Return the measurement of `state`."""
        m = self._model
        radiance, ranges, objects = self._renderer.render(time_ns, state)
        rgb, depth = self._image_sensor.develop(radiance, ranges)
        return CameraSample(
            time_ns, m.width, m.height, rgb, depth if m.depth else None,
            objects.tobytes() if m.ground_truth else None, self._intrinsics, self._distortion,
            self._renderer.points(depth) if m.points else None,
        )  # fmt: skip

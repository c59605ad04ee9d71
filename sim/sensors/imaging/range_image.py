"""A 3-D sonar: the distance and the strength of the strongest echo in each direction of a grid."""

from math import pi
from typing import Annotated, Any, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.environment.seawater.absorption import francois_garrison
from sim.rays.scene import RayScene
from sim.rotations import matrix
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.imaging.samples import require_numpy
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion

_DEGREE = pi / 180.0
_SPECKLE = 2.0  # dB, standard deviation of the strength of an echo


class RangeImageModel(NamedTuple):
    """Images per s, their pixels and field of view (rad), frequency, reach, and the error of distances.

    `strength` is that of the echo of a surface across the line of sight, before absorption; weaker echoes than `least`
    are lost. The defaults are those of a Water Linked Sonar 3D-15 (its documentation); strengths are our choice, near
    those of its published recording.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 5.0
    width: Annotated[int, Range(2, 4096)] = 256
    height: Annotated[int, Range(2, 4096)] = 64
    field_across: Annotated[float, Range(0.01, pi, "rad")] = 90.0 * _DEGREE
    field_down: Annotated[float, Range(0.01, pi, "rad")] = 40.0 * _DEGREE
    frequency: Annotated[float, Range(1e4, 5e6, "Hz")] = 1.2e6
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.0
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 15.0
    temperature: Annotated[float, Range(-2.0, 40.0, "°C")] = 10.0
    salinity: Annotated[float, Range(0.0, 45.0)] = 35.0
    strength: Annotated[float, Range(0.0, 1e6)] = 3000.0
    least: Annotated[float, Range(0.0, 1e6)] = 60.0
    error: ErrorModel = ErrorModel(noise=0.01)


class RangeImageSample(NamedTuple):
    """Distances (m, 0 without an echo) and strengths of echoes, numpy arrays `height` x `width`, lowest row first."""

    time_ns: int
    ranges: Any
    strengths: Any


class RangeImager:
    """A sonar along the sensor's x axis; columns go from port to starboard. One ray a pixel.

    The strength falls with the square of the cosine of incidence (Lambert) and by absorption. Not modelled: side lobes,
    several echoes in one direction.
    """

    Model = RangeImageModel
    topic = "range_image"

    def __init__(self, model: RangeImageModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        require_numpy(self.topic)
        import numpy as np

        self._model, self._mounting, self._scene = model, mounting, scene
        self._rays = RayScene(scene.world)
        across = np.linspace(-0.5, 0.5, model.width) * model.field_across
        up = (np.linspace(-0.5, 0.5, model.height) * model.field_down)[:, None]
        axes = np.broadcast_arrays(np.cos(up) * np.cos(across), np.cos(up) * np.sin(across), -np.sin(up))
        self._directions = np.stack(axes, axis=-1).ravel()
        self._absorption = francois_garrison(model.frequency, model.temperature, model.salinity)
        self._random = np.random.Generator(np.random.SFC64(sensor_random(seed, self.topic).getrandbits(64)))

    def sample(self, time_ns: int, state: State) -> RangeImageSample:
        """Return the measurement of `state`."""
        import numpy as np

        model = self._model
        position = self._mounting.world_position(state)
        shape = model.height, model.width
        if submersion(self._scene, time_ns, position) <= 0.0:
            return RangeImageSample(time_ns, np.zeros(shape), np.zeros(shape))
        rotation = matrix(self._mounting.attitude(state))
        hits = self._rays.hits(position, self._directions, model.max_range, rotation)
        ranges = np.asarray(hits.distances)
        normals, points = (np.asarray(vectors).reshape(len(ranges), 3) for vectors in (hits.normals, hits.points))
        cosines = np.abs(((np.array(position) - points) * normals).sum(axis=1)) / ranges
        speckle = self._random.standard_normal(len(ranges)) * _SPECKLE
        with np.errstate(invalid="ignore"):
            strengths = model.strength * cosines**2 * 10.0 ** (0.05 * (speckle - 2.0 * self._absorption * ranges))
            is_heard = (ranges >= model.min_range) & (ranges <= model.max_range) & (strengths >= model.least)
        measured = ranges + self._random.standard_normal(len(ranges)) * model.error.noise
        return RangeImageSample(
            time_ns, np.where(is_heard, measured, 0.0).reshape(shape), np.where(is_heard, strengths, 0.0).reshape(shape)
        )

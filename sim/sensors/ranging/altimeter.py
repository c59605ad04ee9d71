"""An altimeter: one narrow sonar beam to the seabed."""

from math import inf, sqrt
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.rotations import rotate
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.extra_samples import RangeSample
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.ground import Ground
from sim.sensors.samples import Scene
from sim.sensors.surface import submersion
from sim.twins import make_error_bank


class AltimeterModel(NamedTuple):
    """Rate in Hz (0: none), reach and error of the range.

    The defaults are those of a Blue Robotics Ping2 (user manual): 0.3 to 100 m. The noise is the 5 mm of
    uuv_simulator's sonar beams. The error of the scale is that of an error of 7 m/s in the speed of sound, our choice.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 10.0
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.3
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 100.0
    error: ErrorModel = ErrorModel(noise=0.005, scale=0.005)

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return "min_range is not below max_range" if self.min_range >= self.max_range else None


class Altimeter:
    """One beam along the sensor's z axis. It is straight down from a level vehicle, unless it is mounted otherwise.

    It hits the seabed and obstacles. Not modelled: the width of the beam (see sim.sensors.ranging.echosounder), a
    second echo, the weaker echo at a slant.
    """

    Model = AltimeterModel
    topic = "altimeter"

    def __init__(self, model: AltimeterModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._limits = model.min_range, model.max_range
        self._mounting = mounting
        self._scene = scene
        self._beam = rotate(mounting.quaternion, (0.0, 0.0, 1.0))  # along the body axes
        self._ground = Ground(scene.world, mounting, [self._beam], model.max_range)
        self._errors = make_error_bank([model.error], 1.0 / model.rate, sensor_random(seed, self.topic))

    def sample(self, time_ns: int, state: State) -> RangeSample:
        """Return the measurement of `state`."""
        distance = self._distance(time_ns, state)
        near, far = self._limits
        (measured,) = self._errors.measure([min(distance, far)])
        if distance > far:
            measured = inf
        elif distance < near:
            measured = -inf
        return RangeSample(time_ns, measured, self._limits)

    def _distance(self, time_ns: int, state: State) -> float:
        """Return the distance (m) along the beam; inf if there is nothing within reach."""
        position = self._mounting.world_position(state)
        if submersion(self._scene, time_ns, position) <= 0.0:
            return inf
        down = rotate(state.quaternion, self._beam)[2]
        distance = (self._scene.world.depth - position[2]) / down if down > 0.0 else inf
        across = min(distance, self._limits[1]) * sqrt(max(0.0, 1.0 - down * down))
        return distance if self._ground.is_flat(state, across) else self._ground.ranges(state)[0]

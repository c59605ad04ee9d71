"""A single-beam echosounder: distance to the nearest surface in a wide cone."""

from math import pi
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.extra_samples import RangeSample
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.beams import Beams, apply_limits, cone
from sim.sensors.samples import Scene
from sim.twins import make_error_bank

_DEGREE = pi / 180.0


class EchosounderModel(NamedTuple):
    """Rate in Hz (0: none), width of the beam (rad), the rings of rays that represent it, reach, error of the distance.

    With `ground_truth` the distance is the true one. The defaults are those of a Blue Robotics Ping2 (user manual): 25
    deg, 0.3 to 100 m. The noise is the 5 mm of uuv_simulator's sonar beams. The error of the scale is that of an error
    of 7 m/s in the speed of sound, our choice.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 10.0
    beam_width: Annotated[float, Range(0.0, pi, "rad")] = 25.0 * _DEGREE
    rings: Annotated[int, Range(0, 20)] = 2
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.3
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 100.0
    error: ErrorModel = ErrorModel(noise=0.005, scale=0.005)
    ground_truth: bool = False

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return "min_range is not below max_range" if self.min_range >= self.max_range else None


class Echosounder:
    """One beam about the sensor's z axis. It is straight down from a level vehicle, unless it is mounted otherwise.

    The distance is that of the first echo, the least along any of the rays. So over a slope it is shorter than along
    the beam's axis, as with a real one. Not modelled: the strength of an echo, side lobes, second echoes.
    """

    Model = EchosounderModel
    topic = "echosounder"

    def __init__(self, model: EchosounderModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._limits = model.min_range, model.max_range
        about_x = cone(model.beam_width, model.beam_width, model.rings)
        self._beams = Beams(scene, mounting, [(-z, y, x) for x, y, z in about_x], model.max_range)
        self._errors = None
        if not model.ground_truth:
            self._errors = make_error_bank([model.error], 1.0 / model.rate, sensor_random(seed, self.topic))

    def sample(self, time_ns: int, state: State) -> RangeSample:
        """Return the measurement of `state`."""
        true = [min(self._beams.ranges(time_ns, state))]
        measured = self._errors.measure([min(true[0], self._limits[1])]) if self._errors else true
        return RangeSample(time_ns, apply_limits(measured, true, self._limits)[0], self._limits)

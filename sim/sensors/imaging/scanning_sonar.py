"""A mechanically scanned sonar: one beam that a motor turns by a step after each ping."""

from math import pi
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.rotations import from_euler
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.extra_samples import LaserSample
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.beams import Beams, RangeErrors, cone, within
from sim.sensors.samples import Scene

Angle = Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]
_DEGREE = pi / 180.0


class ScanningSonarModel(NamedTuple):
    """Pings in Hz (0: none), the sector and the step (rad), the beam's width and height (rad), reach, error.

    `rings` of rays stand for the beam. With `ground_truth` the distances are the true ones. Blue Robotics Ping360 (data
    sheet): 2 x 25 deg, steps of 0.9 deg (1 grad), 0.75 to 50 m with 1200 samples a ping, 35 s a turn at full reach.
    Scale: a speed of sound that is 7 m/s off, our choice.
    """

    rate: Annotated[float, Range(0.0, 1000.0, "Hz")] = 11.0
    angle_min: Angle = -pi
    angle_max: Angle = pi
    step: Annotated[float, Range(1e-4, pi, "rad")] = 0.9 * _DEGREE
    beam_width: Annotated[float, Range(0.0, pi, "rad")] = 2.0 * _DEGREE
    beam_height: Annotated[float, Range(0.0, pi, "rad")] = 25.0 * _DEGREE
    rings: Annotated[int, Range(0, 20)] = 2
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.75
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 50.0
    error: ErrorModel = ErrorModel(scale=0.005, resolution=50.0 / 1200.0)
    ground_truth: bool = False

    def validate(self) -> str | None:
        """Return what is wrong between the keys, or None."""
        if self.min_range >= self.max_range:
            return "min_range is not below max_range"
        if not self.step <= self.angle_max - self.angle_min <= 2.0 * pi:
            return "angle_max must be above angle_min by a step or more, and by a turn at most"
        return None


class ScanningSonar:
    """A beam in the sensor's x-y plane, at an angle from x (ahead) towards y (starboard); one range a sample.

    Over a whole turn it goes round and round; over a sector there and back. Where the vehicle is in each ping is where
    it is then: a scan of a moving vehicle is skewed as a real one is. The distance is that of the first echo, the least
    along any of its rays. Not modelled: how strong an echo is (the image), side lobes, echoes of earlier pings.
    """

    Model = ScanningSonarModel
    topic = "scanning_sonar"

    def __init__(self, model: ScanningSonarModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._first, self._step = model.angle_min, model.step
        sector = model.angle_max - model.angle_min
        self._steps = int(sector / model.step + 1e-9)  # from one end to the other
        self._whole_turn = sector > 2.0 * pi - 1e-9
        self._ping = 0
        self._limits = model.min_range, model.max_range
        self._beams = Beams(scene, mounting, cone(model.beam_width, model.beam_height, model.rings), model.max_range)
        random = sensor_random(seed, self.topic)
        self._errors = None if model.ground_truth else RangeErrors(model.error, 1.0 / model.rate, random, self._limits)

    def sample(self, time_ns: int, state: State) -> LaserSample:
        """Return the measurement of `state`; the head turns on."""
        angle = self._first + self._place() * self._step
        self._ping += 1
        true = (min(self._beams.ranges(time_ns, state, from_euler(0.0, 0.0, angle))),)
        measured = self._errors.measure(true) if self._errors else within(true, true, self._limits)
        return LaserSample(time_ns, angle, self._step, measured, self._limits)

    def _place(self) -> int:
        """Return how many steps from the first angle the head stands."""
        if self._whole_turn:
            return self._ping % self._steps
        there = self._ping % (2 * self._steps)
        return min(there, 2 * self._steps - there)

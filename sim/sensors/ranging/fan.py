"""A fan of beams in one plane that all measure at the same instant: base class of laser and profiler."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import pi
from typing import Annotated, Any

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.sensors.error import sensor_random
from sim.sensors.extra_samples import LaserSample
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.beams import Beams, RangeErrors, apply_limits
from sim.sensors.samples import Scene

Angle = Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]
DEGREE = pi / 180.0


def validate_fan(near: float, far: float, first: float, last: float) -> str | None:
    """Return what is wrong with the limits (m) and the angles (rad) of a fan, or None."""
    if near >= far:
        return "min_range is not below max_range"
    return "angle_min is not below angle_max" if first >= last else None


class Fan(ABC):
    """A fan of beams at equal angular distances; the model has the first and the last angle."""

    Model: Any
    topic: str

    def __init__(self, model: Any, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._first, self._step = model.angle_min, (model.angle_max - model.angle_min) / (model.beams - 1)
        self._limits = model.min_range, model.max_range
        angles = [self._first + i * self._step for i in range(model.beams)]
        directions = [ray for angle in angles for ray in self.rays(model, angle)]
        self._beams = Beams(scene, mounting, directions, model.max_range)
        random = sensor_random(seed, self.topic)
        self._errors = None if model.ground_truth else RangeErrors(model.error, 1.0 / model.rate, random, self._limits)

    @staticmethod
    @abstractmethod
    def rays(model: Any, angle: float) -> Sequence[Vector3]:
        """Return the unit vectors (the sensor's axes) of the rays that represent the beam at an angle (rad)."""

    def sample(self, time_ns: int, state: State) -> LaserSample:
        """Return the measurement of `state`."""
        true, strengths = self.measure(time_ns, state)
        measured = self._errors.measure(true) if self._errors else apply_limits(true, true, self._limits)
        return LaserSample(time_ns, self._first, self._step, measured, self._limits, strengths)

    def measure(self, time_ns: int, state: State) -> tuple[Sequence[float], tuple[float, ...]]:
        """Return the true distance (m) along each beam and, if the device reports it, its echo strength (dB)."""
        return self._beams.ranges(time_ns, state), ()

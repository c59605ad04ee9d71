"""A scanning laser: distances in a level plane all around."""

from math import cos, sin
from typing import Annotated, NamedTuple

from hil.schema import Range
from sim.sensors.error import ErrorModel
from sim.sensors.fan import DEGREE, Angle, Fan, fan_problem
from sim.sensors.samples import Vector3


class LaserModel(NamedTuple):
    """Rate in Hz (0: none), the beams and the angles of the first and the last, reach, error of the distances.

    With `ground_truth` the distances are the true ones. All numbers are our choice: one beam a degree, all around, in
    clear water.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 10.0
    beams: Annotated[int, Range(2, 10_000)] = 360
    angle_min: Angle = -180.0 * DEGREE
    angle_max: Angle = 179.0 * DEGREE
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.1
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 30.0
    error: ErrorModel = ErrorModel(noise=0.01)
    ground_truth: bool = False

    def problem(self) -> str | None:
        """What is wrong between the keys, if anything."""
        return fan_problem(self.min_range, self.max_range, self.angle_min, self.angle_max)


class Laser(Fan):
    """Beams in the sensor's x-y plane, the angle from x (ahead) towards y (starboard).

    Not modelled: that the vehicle moves during a scan, how the water weakens and scatters light, what a surface
    reflects.
    """

    Model = LaserModel
    topic = "laser"

    @staticmethod
    def direction(angle: float) -> Vector3:
        """The unit vector (the sensor's axes) of the beam at an angle (rad)."""
        return cos(angle), sin(angle), 0.0

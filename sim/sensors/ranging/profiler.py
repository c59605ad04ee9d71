"""A profiling multibeam sonar: the shape of the seabed across the track in one ping."""

from math import cos, sin
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.sensors.error import ErrorModel
from sim.sensors.ranging.fan import DEGREE, Angle, Fan, validate_fan


class ProfilerModel(NamedTuple):
    """Rate in Hz (0: none), the beams and the angles of the first and the last, reach, error of the distances.

    With `ground_truth` the distances are the true ones. Reach: the longest of the Imagenex 837B's settings in LSTS's
    driver for it (DUNE); noise: uuv_simulator's 5 mm for sonar beams; scale: a speed of sound 7 m/s off; the others are
    our choice, of the size usual for such devices.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 5.0
    beams: Annotated[int, Range(2, 10_000)] = 120
    angle_min: Angle = -60.0 * DEGREE
    angle_max: Angle = 60.0 * DEGREE
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.5
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 100.0
    error: ErrorModel = ErrorModel(noise=0.005, scale=0.005)
    ground_truth: bool = False

    def validate(self) -> str | None:
        """Return what is wrong between the keys, or None."""
        return validate_fan(self.min_range, self.max_range, self.angle_min, self.angle_max)


class Profiler(Fan):
    """Beams in the sensor's y-z plane, the angle from z (down) towards y (starboard).

    Not modelled: the beams' width, the way of the sound while the vehicle moves on, rays that bend, false bottoms.
    """

    Model = ProfilerModel
    topic = "profiler"

    @staticmethod
    def direction(angle: float) -> Vector3:
        """Return the unit vector (the sensor's axes) of the beam at an angle (rad)."""
        return 0.0, sin(angle), cos(angle)

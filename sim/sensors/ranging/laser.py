"""A scanning laser: distances in a horizontal plane, by default over 360 deg."""

from collections.abc import Sequence
from math import cos, sin
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.sensors.error import ErrorModel
from sim.sensors.ranging.fan import DEGREE, Angle, Fan, validate_fan


class LaserModel(NamedTuple):
    """Rate in Hz (0: none), number of beams, angles of the first and the last (rad), reach (m), error of the distances.

    With `ground_truth` the distances are the true ones. All numbers are our choice: one beam per degree over 360 deg,
    in clear water.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 10.0
    beams: Annotated[int, Range(2, 10_000)] = 360
    angle_min: Angle = -180.0 * DEGREE
    angle_max: Angle = 179.0 * DEGREE
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.1
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 30.0
    error: ErrorModel = ErrorModel(noise=0.01)
    ground_truth: bool = False

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return validate_fan(self.min_range, self.max_range, self.angle_min, self.angle_max)


class Laser(Fan):
    """Beams in the sensor's x-y plane. Angles are from x (ahead) towards y (starboard).

    Not modelled: the motion of the vehicle during a scan, attenuation and scattering of light in the water, the
    reflectance of surfaces.
    """

    Model = LaserModel
    topic = "laser"

    @staticmethod
    def rays(model: LaserModel, angle: float) -> Sequence[Vector3]:
        """Return the unit vector of the beam at `angle` (rad), in the sensor's axes."""
        return [(cos(angle), sin(angle), 0.0)]

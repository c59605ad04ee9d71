"""A magnetometer in the earth's field."""

from math import cos, sin
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.environment.geomagnetism import field_of
from sim.environment.world import World
from sim.rotations import rotate_inverse
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.extra_samples import FieldSample
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene
from sim.twins import make_error_bank

Tesla = Annotated[float, Range(-1e-2, 1e-2, "T")]
Share = Annotated[float, Range(-10.0, 10.0)]
Matrix3 = tuple[Share, Share, Share, Share, Share, Share, Share, Share, Share]

UNDISTURBED = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


class MagnetometerModel(NamedTuple):
    """Rate in Hz (0: none), effect of the vehicle's iron on the field, and errors in T.

    The field at the sensor is `soft_iron` (3 x 3, row after row) times the earth's field plus `hard_iron` (T), both
    along the axes of the sensor. The errors are those of a Bosch BMX055 as in uuv_simulator (Manhães 2016): noise of 1
    µT along x and y and 1.4 µT along z, and 2 µT that remain after a calibration.
    """

    rate: Annotated[float, Range(0.0, 1000.0, "Hz")] = 50.0
    hard_iron: tuple[Tesla, Tesla, Tesla] = (0.0, 0.0, 0.0)
    soft_iron: Matrix3 = UNDISTURBED
    error_xy: ErrorModel = ErrorModel(turn_on=2e-6, noise=1e-6)
    error_z: ErrorModel = ErrorModel(turn_on=2e-6, noise=1.4e-6)


class Magnetometer:
    """One sensor. Not modelled: currents in the vehicle's wires, iron in the seabed and in obstacles."""

    Model = MagnetometerModel
    topic = "magnetometer"

    def __init__(self, model: MagnetometerModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._mounting = mounting
        self._earth = earth_field(scene.world)
        self._hard = model.hard_iron
        self._soft = [model.soft_iron[i : i + 3] for i in (0, 3, 6)]
        models = [model.error_xy, model.error_xy, model.error_z]
        self._errors = make_error_bank(models, 1.0 / model.rate, sensor_random(seed, self.topic))

    def sample(self, time_ns: int, state: State) -> FieldSample:
        """Return the measurement of `state`."""
        x, y, z = rotate_inverse(self._mounting.attitude(state), self._earth)
        measured = [a * x + b * y + c * z + own for (a, b, c), own in zip(self._soft, self._hard, strict=True)]
        a, b, c = self._errors.measure(measured)
        return FieldSample(time_ns, (a, b, c))


def earth_field(world: World) -> Vector3:
    """Return the magnetic field of `world`, NED in T. Raises MissingExtraError."""
    intensity, inclination, declination = field_of(world)
    level = intensity * cos(inclination)
    return level * cos(declination), level * sin(declination), intensity * sin(inclination)

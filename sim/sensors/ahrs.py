"""An attitude and heading reference system: fused gyros, accelerometers and magnetometer."""

from math import atan2, pi, remainder, sqrt
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Quaternion, Vector3, cross
from sim.dynamics import State
from sim.environment.geomagnetism import field_of
from sim.rotations import integrate, multiply, rotate, rotate_inverse
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.imu import specific_force
from sim.sensors.magnetometer import earth_field
from sim.sensors.mounting import Mounting
from sim.sensors.samples import ImuSample, Scene
from sim.twins import make_error_bank

Seconds = Annotated[float, Range(0.1, 1000.0, "s")]


class AhrsModel(NamedTuple):
    """Rate in Hz (0: none), time constants of the filter, and errors of its inputs.

    Moog Crossbow NAV440 (data sheet): roll and pitch within 0.4 deg, heading within 1 deg, gyros within 10 deg/h
    in a run, each rms; here the accelerometer's and the magnetometer's offsets are those that give these angles
    in the default world's field, where a tilt makes 2.2 times as much of heading, by the field's inclination.
    White noise: that of the defaults of the IMU and of the magnetometer. The memory `level_time` of roll and
    pitch and `heading_time` (s) is our choice.
    """

    rate: Annotated[float, Range(0.0, 1000.0, "Hz")] = 100.0
    level_time: Seconds = 10.0
    heading_time: Seconds = 10.0
    angular_velocity: ErrorModel = ErrorModel(bias=4.85e-5, bias_time=1000.0, noise_density=3.394e-4)
    acceleration: ErrorModel = ErrorModel(turn_on=0.0685, noise_density=0.004)
    magnetic_field: ErrorModel = ErrorModel(turn_on=1.6e-7, noise=1e-6)


class Ahrs:
    """An AHRS. All that it measures is along its own axes.

    A complementary filter on the rotations (Mahony, Hamel and Pflimlin 2008, IEEE Trans. Automatic Control
    53:1203): the gyros integrate the attitude, the accelerometer corrects roll and pitch towards the vertical, and the
    magnetometer corrects the heading towards north, with the time constants of the model. So accelerations of the
    vehicle cause errors of roll and pitch, and its iron causes errors of the heading, as in a real AHRS. It is aligned
    when the run starts, and corrects for the declination. The estimation of gyro biases is not modelled: the model's
    numbers are the remaining errors.
    """

    Model = AhrsModel
    topic = "ahrs"

    def __init__(self, model: AhrsModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._position = mounting.position
        self._mounting_rotation = mounting.quaternion
        self._gravity = scene.world.gravity
        self._earth = earth_field(scene.world)
        self._declination = field_of(scene.world)[2]
        self._period = 1.0 / model.rate
        self._level_share = min(1.0, self._period / model.level_time)
        self._heading_share = min(1.0, self._period / model.heading_time)
        models = [model.angular_velocity] * 3 + [model.acceleration] * 3 + [model.magnetic_field] * 3
        self._errors = make_error_bank(models, self._period, sensor_random(seed, self.topic))
        self._attitude: Quaternion | None = None
        self._rate: Vector3 = (0.0, 0.0, 0.0)

    def sample(self, time_ns: int, state: State) -> ImuSample:
        """Return the measurement of `state`."""
        attitude = multiply(state.quaternion, self._mounting_rotation)
        rate = rotate_inverse(self._mounting_rotation, state.nu[3:])
        force = rotate_inverse(self._mounting_rotation, specific_force(state, self._position, self._gravity))
        p, q, r, x, y, z, a, b, c = self._errors.measure((*rate, *force, *rotate_inverse(attitude, self._earth)))
        if self._attitude is not None:
            before_p, before_q, before_r = self._rate
            mean = (0.5 * (p + before_p), 0.5 * (q + before_q), 0.5 * (r + before_r))
            attitude = self._correct(integrate(self._attitude, mean, self._period), (x, y, z), (a, b, c))
        self._attitude, self._rate = attitude, (p, q, r)
        return ImuSample(time_ns, attitude, (p, q, r), (x, y, z))

    def _correct(self, attitude: Quaternion, force: Vector3, field: Vector3) -> Quaternion:
        """Return `attitude` corrected a little by the measured gravity and magnetic field."""
        down = rotate_inverse(attitude, (0.0, 0.0, 1.0))
        tilt = self._level_share / sqrt(sum([f * f for f in force]) or 1.0)
        north, east, _ = rotate(attitude, field)
        heading = self._heading_share * remainder(atan2(east, north) - self._declination, 2.0 * pi)
        tilt_vector = cross(down, force)  # the specific force points up
        correction = [tilt * component - heading * d for component, d in zip(tilt_vector, down, strict=True)]
        return integrate(attitude, correction, 1.0)

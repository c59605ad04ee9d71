"""An inertial measurement unit with an attitude filter."""

from collections.abc import Callable, Sequence
from operator import mul
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.rotations import down_axis, integrate, multiply, rotate_inverse
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.mounting import Mounting
from sim.sensors.samples import IMU, ImuSample, Scene
from sim.twins import make_error_bank, make_imu
from sim.vehicle.vehicle import Point


class ImuModel(NamedTuple):
    """Rate in Hz (0: none) and errors.

    `heading` has the errors of the attitude about the unit's z axis, if they differ from those about x and y.
    `g_sensitivity`: sd (rad/s for 1 m/s²) of each element of the matrix that converts the specific force to an error of
    the rates, drawn when the run starts.

    The errors of rates and accelerations are those of an ADIS16448 as in uuv_simulator (Manhães 2016). Its random walks
    are converted to the standard deviations that they settle at, random walk * sqrt(tau / 2). The error of the attitude
    is the 0.01 rad of uuv_simulator. By our choice it varies slowly, as the error of a filter does, with a little
    noise.
    """

    rate: Annotated[float, Range(0.0, 2000.0, "Hz")] = 100.0
    attitude: ErrorModel = ErrorModel(bias=0.01, bias_time=600.0, noise=0.001)
    angular_velocity: ErrorModel = ErrorModel(turn_on=0.0087, bias=8.67e-4, bias_time=1000.0, noise_density=3.394e-4)
    acceleration: ErrorModel = ErrorModel(turn_on=0.196, bias=0.0735, bias_time=300.0, noise_density=0.004)
    heading: ErrorModel | None = None
    g_sensitivity: Annotated[float, Range(0.0, 0.1)] = 0.0


class Imu:
    """An inertial measurement unit; it measures along its own axes."""

    Model = ImuModel
    topic = IMU

    def __init__(self, model: ImuModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._position = mounting.position
        self._mounting_rotation = mounting.quaternion if mounting.is_turned else None
        self._gravity = scene.world.gravity
        attitude = [model.attitude, model.attitude, model.heading or model.attitude]
        models = attitude + [model.angular_velocity] * 3 + [model.acceleration] * 3
        self._errors = make_error_bank(models, 1.0 / model.rate, sensor_random(seed, self.topic))
        self._of_force: list[list[float]] = []
        if model.g_sensitivity:
            gauss = sensor_random(seed, f"{self.topic}/g").gauss
            self._of_force = [[gauss(0.0, model.g_sensitivity) for _ in range(3)] for _ in range(3)]
        is_plain = not (self._mounting_rotation or model.g_sensitivity)
        native = make_imu(self._errors, ImuSample, self._position, self._gravity) if is_plain else None
        self._measure: Callable[[int, State], ImuSample] = native or self._measure_in_python

    def sample(self, time_ns: int, state: State) -> ImuSample:
        """Return the measurement of `state`; attitude errors are small turns about the unit's axes."""
        return self._measure(time_ns, state)

    def _measure_in_python(self, time_ns: int, state: State) -> ImuSample:
        attitude: Sequence[float] = state.quaternion
        rate: Sequence[float] = state.nu[3:]
        force: Sequence[float] = specific_force(state, self._position, self._gravity)
        if self._mounting_rotation:
            attitude = multiply(attitude, self._mounting_rotation)
            rate, force = rotate_inverse(self._mounting_rotation, rate), rotate_inverse(self._mounting_rotation, force)
        if self._of_force:
            rate = [x + sum(map(mul, row, force)) for x, row in zip(rate, self._of_force, strict=True)]
        a, b, c, p, q, r, x, y, z = self._errors.measure((0.0, 0.0, 0.0, *rate, *force))
        return ImuSample(time_ns, integrate(attitude, (a, b, c), 1.0), (p, q, r), (x, y, z))


def specific_force(state: State, position: Point, gravity: float) -> Vector3:
    """Return acceleration less gravity (m/s², body axes) at `position` m from the origin: what an accelerometer feels.

    The acceleration of a point of a turning body: v' + omega x v + omega' x r + omega x (omega x r).
    """
    u, v, w, p, q, r = state.nu
    du, dv, dw, dp, dq, dr = state.nu_dot
    if any(position):
        x, y, z = position
        # velocity of the point; below, omega x v of it includes the centripetal term
        u += q * z - r * y
        v += r * x - p * z
        w += p * y - q * x
        du = du + dq * z - dr * y
        dv = dv + dr * x - dp * z
        dw = dw + dp * y - dq * x
    down_x, down_y, down_z = down_axis(state.quaternion)
    return (
        du + q * w - r * v - gravity * down_x,
        dv + r * u - p * w - gravity * down_y,
        dw + p * v - q * u - gravity * down_z,
    )

"""Position, attitude and velocity at once: as a navigation system finds them, and as they are."""

from typing import Annotated, NamedTuple

from hil.schema import Range
from sim.dynamics import State
from sim.rotations import integrate
from sim.sensors.error import ErrorModel, errors, measure3, sensor_random
from sim.sensors.samples import ODOMETRY, OdometrySample, period_ns

Rate = Annotated[float, Range(0.0, 1000.0, "Hz")]


class OdometryModel(NamedTuple):
    """Rate in Hz (0: none) and errors of a navigation solution aided by DVL and acoustic positions.

    The sizes are our choice: position within 0.1 m over a minute, depth (by pressure) within 2 cm, attitude
    within half a degree, velocity within 1 cm/s. They stand for a whole navigation filter, which is not modelled.
    """

    rate: Rate = 20.0
    horizontal: ErrorModel = ErrorModel(bias=0.1, bias_time=60.0, noise=0.02)
    depth: ErrorModel = ErrorModel(bias=0.02, bias_time=60.0, noise=0.005)
    orientation: ErrorModel = ErrorModel(bias=0.008, bias_time=300.0, noise=0.001)
    velocity: ErrorModel = ErrorModel(noise=0.01)
    angular_velocity: ErrorModel = ErrorModel(noise=0.002)


class GroundTruthModel(NamedTuple):
    """Rate in Hz (0: none); no errors."""

    rate: Rate = 20.0


class Odometry:
    """One navigation solution."""

    def __init__(self, model: OdometryModel, seed: int) -> None:
        self.period_ns = period_ns(model.rate)
        random, period = sensor_random(seed, ODOMETRY), 1.0 / model.rate
        self._position = errors(model.horizontal, period, random, 2) + errors(model.depth, period, random, 1)
        self._orientation = errors(model.orientation, period, random)
        self._velocity = errors(model.velocity, period, random)
        self._angular_velocity = errors(model.angular_velocity, period, random)

    def sample(self, time_ns: int, state: State) -> OdometrySample:
        """The solution for `state`; attitude errors are small turns about the body axes."""
        return OdometrySample(
            time_ns,
            measure3(self._position, state.position),
            integrate(state.quaternion, measure3(self._orientation, (0.0, 0.0, 0.0)), 1.0),
            measure3(self._velocity, state.nu[:3]) + measure3(self._angular_velocity, state.nu[3:]),
        )


class GroundTruth:
    """The state itself."""

    def __init__(self, model: GroundTruthModel) -> None:
        self.period_ns = period_ns(model.rate)

    def sample(self, time_ns: int, state: State) -> OdometrySample:
        """The truth."""
        return ground_truth(time_ns, state)


def ground_truth(time_ns: int, state: State) -> OdometrySample:
    """`state` as a sample."""
    north, east, down = state.position
    w, x, y, z = state.quaternion
    u, v, heave, p, q, r = state.nu
    return OdometrySample(time_ns, (north, east, down), (w, x, y, z), (u, v, heave, p, q, r))

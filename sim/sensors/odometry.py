"""Position, attitude and velocity: the navigation system's estimate, and the ground truth."""

from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.rotations import integrate
from sim.sensors.error import ErrorModel, sensor_random
from sim.sensors.mounting import Mounting
from sim.sensors.samples import GROUND_TRUTH, ODOMETRY, OdometrySample, Scene
from sim.twins import make_error_bank

Rate = Annotated[float, Range(0.0, 1000.0, "Hz")]


class OdometryModel(NamedTuple):
    """Rate in Hz (0: none) and errors of a navigation solution aided by DVL and acoustic positions.

    The sizes are our choice: position within 0.1 m over a minute, depth (by pressure) within 2 cm, attitude
    within half a degree, velocity within 1 cm/s. They stand for a whole navigation filter, which is not modelled.
    """

    rate: Rate = 20.0
    horizontal: ErrorModel = ErrorModel(bias=0.1, bias_time=60.0, noise=0.02)
    depth: ErrorModel = ErrorModel(bias=0.02, bias_time=60.0, noise=0.005)
    attitude: ErrorModel = ErrorModel(bias=0.008, bias_time=300.0, noise=0.001)
    velocity: ErrorModel = ErrorModel(noise=0.01)
    angular_velocity: ErrorModel = ErrorModel(noise=0.002)


class GroundTruthModel(NamedTuple):
    """Rate in Hz (0: none); no errors."""

    rate: Rate = 20.0


class Odometry:
    """One navigation solution, always that of the body origin."""

    Model = OdometryModel
    topic = ODOMETRY

    def __init__(self, model: OdometryModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        pose = [model.horizontal] * 2 + [model.depth] + [model.attitude] * 3
        models = pose + [model.velocity] * 3 + [model.angular_velocity] * 3
        self._errors = make_error_bank(models, 1.0 / model.rate, sensor_random(seed, ODOMETRY))

    def sample(self, time_ns: int, state: State) -> OdometrySample:
        """Return the solution for `state`; attitude errors are small turns about the body axes."""
        measured = self._errors.measure((*state.position, 0.0, 0.0, 0.0, *state.nu))
        north, east, down, a, b, c, u, v, w, p, q, r = measured
        return OdometrySample(
            time_ns, (north, east, down), integrate(state.quaternion, (a, b, c), 1.0), (u, v, w, p, q, r)
        )


class GroundTruth:
    """The state itself."""

    Model = GroundTruthModel
    topic = GROUND_TRUTH

    def __init__(self, model: GroundTruthModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        pass

    def sample(self, time_ns: int, state: State) -> OdometrySample:
        """Return the truth."""
        return ground_truth(time_ns, state)


def ground_truth(time_ns: int, state: State) -> OdometrySample:
    """Return `state` as a sample."""
    north, east, down = state.position
    w, x, y, z = state.quaternion
    u, v, heave, p, q, r = state.nu
    return OdometrySample(time_ns, (north, east, down), (w, x, y, z), (u, v, heave, p, q, r))

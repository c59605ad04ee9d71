"""What the sensors send. Vectors in body axes are FRD, positions NED, quaternions (w, x, y, z) body to world."""

from typing import NamedTuple, Protocol

from sim.dynamics import State

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Nu = tuple[float, float, float, float, float, float]

IMU = "imu"
DVL = "dvl"
PRESSURE = "pressure"
ODOMETRY = "odom"
GROUND_TRUTH = "ground_truth"


class ImuSample(NamedTuple):
    """Attitude, turn rate (rad/s) and specific force (m/s²) in body axes: at rest and level (0, 0, -9.8)."""

    time_ns: int
    orientation: Quaternion
    angular_velocity: Vector3
    acceleration: Vector3


class DvlSample(NamedTuple):
    """Velocity over ground (m/s, body axes) and distance to the seabed (m); all nan where not `locked`."""

    time_ns: int
    velocity: Vector3
    altitude: float
    locked: bool


class PressureSample(NamedTuple):
    """Absolute pressure."""

    time_ns: int
    pascal: float


class OdometrySample(NamedTuple):
    """Position (m), attitude and velocities u v w (m/s) p q r (rad/s): a navigation solution, or the truth."""

    time_ns: int
    position: Vector3
    orientation: Quaternion
    nu: Nu


Sample = ImuSample | DvlSample | PressureSample | OdometrySample


class Sensor(Protocol):
    """What the simulation asks of a sensor; `period_ns` is the time between samples."""

    period_ns: int

    def sample(self, time_ns: int, state: State) -> Sample:
        """The measurement of `state` at `time_ns`. To be called once a period: errors move on with it."""


def period_ns(rate: float) -> int:
    """The period of `rate` Hz in nanoseconds."""
    return round(1e9 / rate)

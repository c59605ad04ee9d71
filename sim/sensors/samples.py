"""The interface of a sensor, and the samples of the common ones; sim.sensors.extra_samples has the others.

Vectors are along the sensor's axes, which are the vehicle's (FRD) unless its mounting has an `orientation`. Positions
are NED in m, quaternions (w, x, y, z) are from the sensor's axes to the world's.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from hil.common.vectors import Quaternion, Vector3
from sim.dynamics import State

if TYPE_CHECKING:
    from sim.environment.waves import WaveField
    from sim.environment.world import World
    from sim.sensors.mounting import Mounting
    from sim.vehicle.accessories import Accessories
    from sim.vehicle.battery import BatteryState
    from sim.vehicle.vehicle import Vehicle

Nu = tuple[float, float, float, float, float, float]
# A symmetric 3 x 3 matrix, row after row.
Covariance = tuple[float, float, float, float, float, float, float, float, float]

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
    """Velocity over ground (m/s, body axes) and distance to the seabed (m); all nan where not `locked`.

    `covariance` ((m/s)²) is of the velocity, empty if not known, `altitude_variance` (m²) 0.
    """

    time_ns: int
    velocity: Vector3
    altitude: float
    locked: bool
    covariance: Covariance | tuple[()] = ()
    altitude_variance: float = 0.0


class PressureSample(NamedTuple):
    """Absolute pressure (Pa)."""

    time_ns: int
    pascal: float


class OdometrySample(NamedTuple):
    """Position (m), attitude and velocities u v w (m/s) p q r (rad/s): a navigation solution, or the truth."""

    time_ns: int
    position: Vector3
    orientation: Quaternion
    nu: Nu


class Sample(Protocol):
    """Sample of any sensor: a record."""

    @property
    def time_ns(self) -> int:
        """Time (ns) of the measurement, in simulation time."""


class Scene(Protocol):
    """The surroundings that sensors measure. sim.simulation.Simulation implements it."""

    state: State
    vehicle: "Vehicle"
    world: "World"
    accessories: "Accessories | None"

    @property
    def wave_field(self) -> "WaveField | None":
        """The waves; None in a world without waves."""

    def flow_at(self, position: Sequence[float]) -> Sequence[float]:
        """Return the present velocity of the water at `position` (NED, m), NED in m/s."""

    @property
    def touching(self) -> bool:
        """True if the vehicle touched something in the last step."""

    @property
    def contacts(self) -> int:
        """Number of contacts so far."""

    @property
    def battery(self) -> "BatteryState | None":
        """The battery's state; None if there is none."""


class Sensor(Protocol):
    """Interface of a sensor to the simulation.

    `Model` is the record of its keys, one of them its `rate` in Hz; `topic` is the topic of its samples. A sensor
    whose samples arrive with varying delays has an attribute `delay_ns`, the delay of its last sample (ns), from the
    start.
    """

    Model: Any
    topic: str

    def __init__(self, model: Any, mounting: "Mounting", seed: int, scene: Scene) -> None: ...

    def sample(self, time_ns: int, state: State) -> Sample | None:
        """Return the measurement of `state` at `time_ns`; None if there is none.

        Must be called once per period: each call advances the errors by one period.
        """


def period_ns(rate: float) -> int:
    """Return the period of `rate` Hz in nanoseconds."""
    return round(1e9 / rate)

"""The newest samples of a vehicle's sensors, as autopilots want them: along the body axes, in their units."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from hil.common.errors import ConfigError
from hil.common.vectors import Vector3
from hil.scenario.config import Scenario
from sim.environment.world import World, water_pressure
from sim.rotations import rotate
from sim.sensors.geodesy import TangentPlane
from sim.sensors.magnetometer import earth_field
from sim.sensors.mounting import Mounting
from sim.sensors.pressure import STANDARD_ATMOSPHERE
from sim.sensors.samples import OdometrySample

AT_REST: Vector3 = (0.0, 0.0, -9.80665)
HOME = (50.0, 8.0)  # degrees; of a world without an origin
LEAST_IMU_HZ = 50.0
TURNED = ("imu", "magnetometer", "dvl")  # sensors whose samples are along their own axes


class SensorInputs:
    """Last sample of each sensor. A sensor that is not fitted, or whose samples are lost, keeps its last value.

    `fresh` holds the topics that have had a sample since the caller cleared it. Positions are NED in m. Raises
    ConfigError for a vehicle without an IMU, or one that is too slow for any estimator.
    """

    def __init__(self, scenario: Scenario, world: World) -> None:
        fitted = scenario.sensors
        if "imu" not in fitted or fitted["imu"].model.rate < LEAST_IMU_HZ:
            raise ConfigError(
                f"{scenario.path}: sensors: imu: an autopilot needs one of at least {LEAST_IMU_HZ:g} Hz; "
                'give [sensors.imu] rate = "400 Hz"'
            )
        self._antenna = fitted["gps"].mounting if "gps" in fitted else Mounting()
        self._turns = {name: _turn(fitted[name].mounting) for name in TURNED if name in fitted}
        self._weight = world.density * world.gravity
        self._water = water_pressure(world)
        self.fresh: set[str] = set()
        self.gyro: Vector3 = (0.0, 0.0, 0.0)
        self.acceleration: Vector3 = (0.0, 0.0, -world.gravity)
        start = scenario.start
        self.pascal = STANDARD_ATMOSPHERE + self._water(start.depth)
        self.magnetic_field: Vector3 | None = None  # T
        self.fix: Any = None  # the newest FixSample; None without a receiver
        self.range_m: float | None = None  # to the ground, inf if there is none within reach
        self.battery: Any = None  # the newest BatterySample
        self.odometry: Any = None  # the newest OdometrySample of the navigation
        self.dvl: Any = None  # the newest DvlSample; its velocity is along the body axes
        self.has: Mapping[str, bool] = {
            name: name in fitted for name in ("pressure", "magnetometer", "gps", "odometry")
        }
        self.plane = TangentPlane(*world.origin, world.origin_altitude) if world.origin else None
        # What a compass without errors feels, NED in T, where none is fitted.
        self.earth_field = None if "magnetometer" in fitted else earth_field(world)

    def update(self, topic: str, sample: Any) -> None:
        """Take one sample."""
        if topic == "imu":
            turn = self._turns["imu"]
            self.gyro = rotate(turn, sample.angular_velocity) if turn else sample.angular_velocity
            self.acceleration = rotate(turn, sample.acceleration) if turn else sample.acceleration
        elif topic == "pressure":
            self.pascal = sample.pascal
        elif topic == "magnetometer":
            turn = self._turns["magnetometer"]
            self.magnetic_field = rotate(turn, sample.field) if turn else sample.field
        elif topic == "gps":
            self.fix = sample
        elif topic == "altimeter":
            self.range_m = sample.distance if isfinite(sample.distance) else None
        elif topic == "battery":
            self.battery = sample
        elif topic == "odom":
            self.odometry = sample
        elif topic == "dvl":
            turn = self._turns["dvl"]
            self.dvl = sample._replace(velocity=rotate(turn, sample.velocity)) if turn else sample
        else:
            return
        self.fresh.add(topic)

    def antenna_velocity(self, truth: OdometrySample) -> Vector3:
        """Return the velocity (m/s, NED) of the GPS receiver's place, which is what a receiver measures."""
        return rotate(truth.orientation, self._antenna.velocity(truth.nu))

    @property
    def depth(self) -> float:
        """Return the depth (m) that the pressure stands for, in water of the same density all the way up."""
        return (self.pascal - STANDARD_ATMOSPHERE) / self._weight


def _turn(mounting: Mounting) -> Any:
    return mounting.quaternion if mounting.turned else None

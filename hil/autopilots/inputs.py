"""The newest samples of a vehicle's sensors for an autopilot, along the body axes."""

from collections.abc import Mapping
from math import isfinite, nan
from typing import Any, NamedTuple

from hil.common.clock import seconds_ns
from hil.common.errors import ConfigError
from hil.common.vectors import Vector3
from hil.scenario.config import Scenario
from sim.environment.seawater.pressure import ATMOSPHERE_PA, depth_of
from sim.environment.world import World, water_pressure
from sim.geodesy import TangentPlane
from sim.rotations import rotate
from sim.sensors.magnetometer import earth_field
from sim.sensors.mounting import Mounting
from sim.sensors.samples import ODOMETRY, OdometrySample
from sim.sensors.variances import error_variances

AT_REST: Vector3 = (0.0, 0.0, -9.80665)
HOME = (50.0, 8.0)  # latitude and longitude, degrees, for a world without an origin
MIN_IMU_HZ = 50.0
MISSED, SILENT_S = 3, 0.5  # periods and seconds without a sample, after both of which a sensor has no value
ENDING = ("altimeter", "battery", "gps", "magnetometer", "pressure")  # sensors whose values end
IN_SENSOR_AXES = ("imu", "magnetometer", "dvl")  # sensors whose samples are along their own axes


class Fault(NamedTuple):
    """Parameters `names` of the sensor `topic`: their value while it works, and while it has no value."""

    topic: str
    sound: float
    failed: float
    names: tuple[str, ...]


# Faults of the sensors that ArduSub simulates itself, for which the JSON interface has no fields. Meanings: ArduPilot,
# libraries/SITL/SITL.cpp, SIM_GPS.cpp.
FAULTS = (
    Fault("pressure", 0.0, 1.0, ("SIM_BARO_DISABLE", "SIM_BAR2_DISABLE")),
    Fault("magnetometer", 0.0, 1.0, ("SIM_MAG1_FAIL", "SIM_MAG2_FAIL", "SIM_MAG3_FAIL")),
    Fault("gps", 1.0, 0.0, ("SIM_GPS1_ENABLE",)),
    Fault("gps", 0.0, 1.0, ("SIM_GPS_DISABLE",)),  # before ArduSub 4.6
)


class SensorInputs:
    """Newest sample of each sensor. Pressure and IMU have their last or initial value while they send nothing.

    Those in `missing` have no value: after MISSED periods without a sample, the autopilot must not take an old value
    for a measurement. `fresh`: topics with a new sample since the caller cleared the set. Positions are NED in m.
    Raises ConfigError for a vehicle without an IMU, or with one below MIN_IMU_HZ.
    """

    def __init__(self, scenario: Scenario, world: World) -> None:
        fitted = scenario.sensors
        if "imu" not in fitted or fitted["imu"].model.rate < MIN_IMU_HZ:
            raise ConfigError(
                f"{scenario.path}: sensors: imu: an autopilot needs an IMU of at least {MIN_IMU_HZ:g} Hz; "
                'set [sensors.imu] rate = "400 Hz"'
            )
        self._antenna = fitted["gps"].mounting if "gps" in fitted else Mounting()
        self._rotations = {name: _rotation(fitted[name].mounting) for name in IN_SENSOR_AXES if name in fitted}
        self._weight = world.density * world.gravity
        self._water = water_pressure(world)
        self.fresh: set[str] = set()
        self.gyro: Vector3 = (0.0, 0.0, 0.0)
        self.acceleration: Vector3 = (0.0, 0.0, -world.gravity)
        start = scenario.start
        self.pascal = ATMOSPHERE_PA + self._water(start.depth)
        self.magnetic_field: Vector3 | None = None  # T
        self.fix: Any = None  # the newest FixSample; None without a receiver
        self.range_m = nan if "altimeter" in fitted else None  # to the seabed; nan without an echo
        self.battery: Any = None  # the newest BatterySample
        # topic -> how long (ns) one sample counts, and time (ns) at which its value ends
        self._lifetimes = {
            name: seconds_ns(max(MISSED / fitted[name].model.rate, SILENT_S) + fitted[name].mounting.latency)
            for name in ENDING
            if name in fitted
        }
        self._ends = dict(self._lifetimes)
        self.missing: set[str] = set()
        self.leaks = False  # whether a leak detector is wet
        self.odometry: Any = None  # the newest OdometrySample of the navigation
        self.dvl: Any = None  # the newest DvlSample; its velocity is along the body axes
        self.has: Mapping[str, bool] = {
            name: name in fitted for name in ("pressure", "magnetometer", "gps", "odometry")
        }
        self.origin = (*world.origin, world.origin_altitude) if world.origin else None  # of NED; degrees, m
        self.plane = TangentPlane(*self.origin) if self.origin else None
        self.start = (start.north, start.east, 0.0)  # m, NED, at the surface
        self.odometry_variances = error_variances(fitted, world).get(ODOMETRY, (0.0,) * 5)
        mounts = [fitted[name].mounting.position[2] if name in fitted else 0.0 for name in ("dvl", "pressure")]
        self.dvl_below = mounts[0] - mounts[1]  # m, of the pressure sensor
        # NED in T, used as an ideal magnetometer if the vehicle has none
        self.earth_field = None if "magnetometer" in fitted else earth_field(world)

    def update(self, topic: str, sample: Any) -> None:
        """Store one sample."""
        if topic == "imu":
            rotation = self._rotations["imu"]
            self.gyro = rotate(rotation, sample.angular_velocity) if rotation else sample.angular_velocity
            self.acceleration = rotate(rotation, sample.acceleration) if rotation else sample.acceleration
        elif topic == "pressure":
            self.pascal = sample.pascal
        elif topic == "magnetometer":
            rotation = self._rotations["magnetometer"]
            self.magnetic_field = rotate(rotation, sample.field) if rotation else sample.field
        elif topic == "gps":
            self.fix = sample
        elif topic == "altimeter":
            self.range_m = sample.distance if isfinite(sample.distance) else nan
        elif topic == "battery":
            self.battery = sample
        elif topic == "leak":
            self.leaks = sample.on
        elif topic == "odom":
            self.odometry = sample
        elif topic == "dvl":
            rotation = self._rotations["dvl"]
            self.dvl = sample._replace(velocity=rotate(rotation, sample.velocity)) if rotation else sample
        else:
            return
        self.fresh.add(topic)
        if topic in self._ends:
            self._ends[topic] = sample.time_ns + self._lifetimes[topic]

    def expire(self, time_ns: int) -> None:
        """Update `missing`: sensors that have sent nothing for long at simulation time `time_ns`, a GPS without fix."""
        self.missing = {topic for topic, end_ns in self._ends.items() if end_ns <= time_ns}
        if self.fix and not self.fix.fix:
            self.missing.add("gps")
        if "altimeter" in self.missing:
            self.range_m = nan
        if "battery" in self.missing and self.battery:
            self.battery = self.battery._replace(voltage=0.0, current=0.0)  # as of a monitor without power

    def ardusub_faults(self, positions: str) -> dict[str, float]:
        """Return the parameters by which the sensors that ArduSub simulates fail and recover with the vehicle's own.

        `positions`: of [autopilot]; only a simulated position comes from a GPS of ArduSub's.
        """
        values = {
            name: fault.failed if fault.topic in self.missing else fault.sound
            for fault in FAULTS
            if self.has[fault.topic] and (fault.topic != "gps" or positions == "simulated")
            for name in fault.names
        }
        if self.battery:
            values["SIM_BATT_VOLTAGE"] = round(self.battery.voltage, 1)
        return values

    def antenna_velocity(self, truth: OdometrySample) -> Vector3:
        """Return the velocity (m/s, NED) of the GPS antenna, which is what a receiver measures."""
        return rotate(truth.orientation, self._antenna.velocity(truth.nu))

    @property
    def depth(self) -> float:
        """Return the depth (m) of the measured pressure in water without layers."""
        return depth_of(self.pascal - ATMOSPHERE_PA, self._weight)


def _rotation(mounting: Mounting) -> Any:
    """Return the quaternion from sensor to body axes, None if the axes are the same."""
    return mounting.quaternion if mounting.is_turned else None

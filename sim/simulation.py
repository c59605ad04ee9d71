"""One vehicle in one world: pulses in, sensor samples out, each call one step of simulated time."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from hil.errors import ConfigError
from sim.contact import Contact, starts_inside
from sim.dynamics import Integrator, State
from sim.native import make_dynamics
from sim.rotations import from_euler, rotate_inverse
from sim.sensors.dvl import Dvl, DvlModel
from sim.sensors.imu import Imu, ImuModel
from sim.sensors.odometry import GroundTruth, GroundTruthModel, Odometry, OdometryModel, ground_truth
from sim.sensors.pressure import Pressure, PressureModel
from sim.sensors.samples import DVL, GROUND_TRUTH, IMU, ODOMETRY, PRESSURE, OdometrySample, Sample, Sensor
from sim.thrusters import make_thrusters
from sim.vehicle import Vehicle
from sim.world import World

if TYPE_CHECKING:
    from sim.battery import BatteryState
    from sim.failures import Failure
    from sim.water import MovingWater

DT_NS = 2_500_000  # 400 Hz


class SensorSuite(NamedTuple):
    """The sensors of a vehicle; one whose rate is 0 is not there."""

    imu: ImuModel = ImuModel()
    dvl: DvlModel = DvlModel()
    pressure: PressureModel = PressureModel()
    odometry: OdometryModel = OdometryModel()
    ground_truth: GroundTruthModel = GroundTruthModel()


class Simulation:
    """A vehicle from rest at `position` (NED, m) with its bow at `heading` (rad from north, clockwise).

    The same arguments and the same pulses give the same numbers to the last bit. `dt_ns` is how much
    each step advances; a sensor cannot be faster. `contacts` counts the touches of seabed and obstacles,
    `touching` tells of the last step. `failures` are what befalls the thrusters, and when. Raises ConfigError
    if the vehicle would start inside something, or has not the thruster that fails.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        world: World,
        sensors: SensorSuite = SensorSuite(),
        seed: int = 0,
        dt_ns: int = DT_NS,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        heading: float = 0.0,
        integrator: Integrator = "semi_implicit_euler",
        failures: "Sequence[Failure]" = (),
    ) -> None:
        if starts_inside(vehicle, world, position):
            at = ", ".join(f"{x:g}" for x in position)
            raise ConfigError(
                f"{vehicle.name} cannot start at ({at}) m: an obstacle or the seabed of {world.name} is there"
            )
        self.vehicle = vehicle
        self.world = world
        self.time_ns = 0
        self.state = State(position, from_euler(0.0, 0.0, heading))
        self._dt_ns = dt_ns
        self._dt = dt_ns * 1e-9
        self._dynamics = make_dynamics(vehicle, world.density, world.gravity, integrator)
        self._thrusters = make_thrusters(vehicle, self._dt, failures, seed)
        self._flow: Sequence[float] = world.current
        self._contact = Contact(vehicle, world, self._dynamics.inverse_mass)
        self._water = _moving_water(vehicle, world, seed)
        self._schedule = [_Slot(topic, sensor, dt_ns) for topic, sensor in _sensors(sensors, world, seed)]
        self._next_due_ns = 0

    @property
    def contacts(self) -> int:
        """How often the vehicle has touched something."""
        return self._contact.count

    @property
    def touching(self) -> bool:
        """True if it touched something in the last step."""
        return self._contact.touching

    @property
    def thrusts(self) -> list[float]:
        """The present thrust of each thruster in N."""
        return self._thrusters.thrusts

    @property
    def battery(self) -> "BatteryState | None":
        """What a battery monitor would read now; None if the vehicle has none."""
        return self._thrusters.battery

    def fail(self, *failures: "Failure") -> None:
        """Let thrusters fail, each at its time; one whose time has passed fails with the next step.

        Raises ConfigError for an unknown thruster.
        """
        self._thrusters.fail(failures)

    def truth(self) -> OdometrySample:
        """Where the vehicle really is, now."""
        return ground_truth(self.time_ns, self.state)

    def step(self, pwm_us: Sequence[int]) -> list[tuple[str, Sample]]:
        """Advance by one step under these pulses (us, one a thruster); the samples that fell due, by topic."""
        state = self.state
        wrench: Sequence[float] = self._push(pwm_us)
        current = self.world.current
        if self._water is not None:
            current, wrench = self._water.act(self.time_ns, state, wrench)
            self._flow = current
        before = state.nu
        self._dynamics.step(state, wrench, current, self._dt)
        if self._contact.resolve(state):
            state.nu_dot = [(new - old) / self._dt for new, old in zip(state.nu, before, strict=True)]
        self.time_ns += self._dt_ns
        return self._samples() if self.time_ns >= self._next_due_ns else []

    def _push(self, pwm_us: Sequence[int]) -> Sequence[float]:
        """The wrench of the thrusters, which meet the water as it flowed a step ago."""
        thrusters, state = self._thrusters, self.state
        if not thrusters.feels_water:
            return thrusters.step(pwm_us)
        water = rotate_inverse(state.quaternion, self._flow)
        return thrusters.step(
            pwm_us, [speed - flow for speed, flow in zip(state.nu, (*water, 0.0, 0.0, 0.0), strict=True)]
        )

    def _samples(self) -> list[tuple[str, Sample]]:
        now, state = self.time_ns, self.state
        samples = [(slot.topic, slot.sensor.sample(now, state)) for slot in self._schedule if slot.take(now)]
        self._next_due_ns = min((slot.due_ns for slot in self._schedule), default=1 << 63)
        return samples


class _Slot:
    """When a sensor is due next: whole multiples of its period, so that nothing drifts."""

    def __init__(self, topic: str, sensor: Sensor, dt_ns: int) -> None:
        if sensor.period_ns < dt_ns:
            raise ConfigError(f"sensor {topic!r}: its rate is above {1e9 / dt_ns:g} Hz, the rate of the simulation")
        self.topic = topic
        self.sensor = sensor
        self.due_ns = sensor.period_ns

    def take(self, now_ns: int) -> bool:
        """True once when it is due."""
        if now_ns < self.due_ns:
            return False
        self.due_ns += self.sensor.period_ns
        return True


def _sensors(suite: SensorSuite, world: World, seed: int) -> Iterator[tuple[str, Sensor]]:
    if suite.imu.rate:
        yield IMU, Imu(suite.imu, seed, world.gravity)
    if suite.dvl.rate:
        yield DVL, Dvl(suite.dvl, seed, world.depth)
    if suite.pressure.rate:
        yield PRESSURE, Pressure(suite.pressure, seed, world.density, world.gravity, _column(world))
    if suite.odometry.rate:
        yield ODOMETRY, Odometry(suite.odometry, seed)
    if suite.ground_truth.rate:
        yield GROUND_TRUTH, GroundTruth(suite.ground_truth)


def _moving_water(vehicle: Vehicle, world: World, seed: int) -> "MovingWater | None":
    """What moves the water besides the steady current; None if nothing does, and then nothing is loaded for it."""
    if not (world.ocean and world.ocean.moves):
        return None
    from sim.water import MovingWater

    return MovingWater(vehicle, world, seed)


def _column(world: World) -> Callable[[float], float] | None:
    """The pressure of water whose density changes with depth; None if it is the same everywhere."""
    if not (world.ocean and world.ocean.profile):
        return None
    from sim.water import WaterColumn

    return WaterColumn(world.ocean.profile, world.gravity).pressure

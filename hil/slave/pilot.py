"""The vehicle's own computer: commands and sensors in, thruster commands out."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hil.autonomy.control import NO_RESIDUAL, Gains, Navigation, VelocityCommand, Wrench
from hil.clock import seconds_ns
from hil.config import Scenario
from hil.errors import ConfigError
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand
from hil.schema import parse
from hil.slave.native import make_allocator, make_cascade, make_pulse_finder
from sim.rotations import multiply, rotate
from sim.sensors.mounting import Mounting
from sim.thrusters import wrench_matrix
from sim.vehicle import Vehicle, mass_matrix
from sim.world import World

if TYPE_CHECKING:
    from hil.autonomy.families import Controller
    from hil.autonomy.fin_control import FinAllocator
    from hil.slave.inbox import Command

# An isothermal column of water: pressure to depth with the vehicle's own constants, as a real pilot has.
ATMOSPHERE_PA = 101_325.0
# What stands in [control] besides the gains of the cascade: other families, each with a table of its name.
OTHERS = ("family", "fins", "options", "sliding_mode", "restoring_pd")


def build_pilot(scenario: Scenario, vehicle: Vehicle, control: dict[str, Any], world: World) -> "Pilot":
    """The pilot of a scenario; `control` is the vehicle file's [control] table. Raises ConfigError."""
    where = f"{scenario.vehicle}: control"
    gains = parse({key: value for key, value in control.items() if key not in OTHERS}, Gains, where)
    imu = scenario.sensors["imu"].mounting
    pilot = Pilot(vehicle, gains, world.density * world.gravity, seconds_ns(scenario.slave.deadman), imu)
    if vehicle.fins:
        pilot.steer_by_fins(gains, control.get("fins", {}), f"{where}.fins", world.density)
    if control.get("family", "cascade") != "cascade":
        pilot.controller = _other_family(vehicle, control, gains, world, where)
    return pilot


def _other_family(vehicle: Vehicle, control: dict[str, Any], gains: Gains, world: World, where: str) -> "Controller":
    from hil.autonomy.families import make_controller
    from hil.slave.plant import plant_of

    family = control["family"]
    if vehicle.fins:
        raise ConfigError(f"{where}: family: a vehicle with fins is steered by the cascade, not by {family!r}")
    return make_controller(family, control, gains, plant_of(vehicle, world.density, world.gravity), where)


class Pilot:
    """Controller, allocation and thruster curves of one vehicle, with the deadman in front.

    Feedback comes from the sensors only: attitude and rates from "imu", whose mounting it knows, position and velocity
    from "odom", depth from "pressure", each held until its next sample. A buoyancy engine is left neutral, weights
    aboard.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        gains: Gains,
        water_weight: float,
        deadman_ns: int,
        imu: Mounting = Mounting(),
    ) -> None:
        mass = mass_matrix(vehicle)
        x, y, z, k, m, n = (mass[axis][axis] for axis in range(6))
        self._inertia = x, y, z, k, m, n
        self.controller: Controller = make_cascade(gains, self._inertia)
        self._find = make_pulse_finder(vehicle.thrusters)
        self._allocator = make_allocator(
            wrench_matrix(vehicle, torque=False),  # which the roll loop meets, not a trade of thrust against roll
            [thruster.max_forward for thruster in vehicle.thrusters],
            [thruster.max_reverse for thruster in vehicle.thrusters],
        )
        self._fins = vehicle.fins
        self._fin_allocator: FinAllocator | None = None
        self._neutral = (PWM_NEUTRAL_US,) * len(vehicle.channels)
        self._water_weight = water_weight  # density times gravity, N/m3
        self._deadman_ns = deadman_ns
        self._imu_turn = imu.quaternion if imu.turned else None
        self._command: Command = VelocityCommand()
        self._commanded_ns = 0
        self._residual = NO_RESIDUAL
        self._attitude = (1.0, 0.0, 0.0, 0.0)
        self._rates = self._velocity = (0.0, 0.0, 0.0)
        self._depth = 0.0
        self.position: Sequence[float] = (0.0, 0.0, 0.0)
        self._sequence = 0
        self.active = False
        self.deadman_trips = 0

    def steer_by_fins(self, gains: Gains, table: dict[str, Any], where: str, density: float) -> None:
        """Move as a vehicle with fins has to, by `[control.fins]`, in water of `density` kg/m³. Raises ConfigError."""
        from hil.autonomy.fin_control import FinAllocator, FinController, FinGains
        from sim.surfaces import fin_matrix

        fins = parse(table, FinGains, where)
        self.controller = FinController(gains, fins, self._inertia)
        limits = [fin.max_deflection for fin in self._fins]
        self._fin_allocator = FinAllocator(fin_matrix(self._fins, density), limits, fins.least_speed)

    def sense(self, topic: str, sample: Any) -> None:
        """Take in one sensor sample (NED, FRD)."""
        if topic == "imu":
            self._attitude, self._rates = sample.orientation, sample.angular_velocity
            if self._imu_turn:
                w, x, y, z = self._imu_turn
                self._attitude = multiply(self._attitude, (w, -x, -y, -z))
                self._rates = rotate(self._imu_turn, self._rates)
        elif topic == "odom":
            self._velocity = sample.nu[:3]
            self.position = sample.position
        elif topic == "pressure":
            self._depth = (sample.pascal - ATMOSPHERE_PA) / self._water_weight

    @property
    def navigation(self) -> Navigation:
        """What the vehicle knows of itself now."""
        return Navigation(self._attitude, self._rates, self._velocity, self._depth)

    def command(self, command: "Command", now: int) -> None:
        """A new command came at `now` (monotonic ns)."""
        self._command = command
        self._commanded_ns = now
        if not self.active:
            self.reset()
            self.active = True

    def update(self, now: int, dt: float) -> tuple[ThrusterCommand, bool]:
        """The thruster command for the next `dt` seconds, and whether the deadman has just tripped."""
        tripped = self.active and now - self._commanded_ns > self._deadman_ns
        if tripped:
            self.active = False
            self.deadman_trips += 1
        sequence = self.next_sequence()
        if not self.active:
            return ThrusterCommand(sequence, False, self._neutral), tripped
        command = self._command
        pwm = self.push(self.steer(command, dt)) if isinstance(command, VelocityCommand) else command.drive(self, dt)
        return ThrusterCommand(sequence, True, pwm + self._neutral[len(pwm) :]), False

    def steer(self, command: VelocityCommand, dt: float) -> Wrench:
        """The wrench (N, N m, along FRD) that makes the vehicle move so, for the next `dt` seconds."""
        return self.controller.update(command, self.navigation, dt, self._residual)

    def push(self, wrench: Wrench) -> tuple[int, ...]:
        """The pulses (us) of thrusters and fins that push the vehicle so, or as nearly so as they can."""
        thrusts, self._residual = self._allocator.allocate(wrench)
        pwm = self.pulses(thrusts)
        if self._fin_allocator is not None:
            angles, self._residual = self._fin_allocator.allocate(self._residual, self._velocity[0])
            pwm += tuple([fin.pulse(angle) for fin, angle in zip(self._fins, angles, strict=True)])
        return pwm

    def pulses(self, thrusts: Sequence[float]) -> tuple[int, ...]:
        """The pulses (us) with which the thrusters give these thrusts (N), each within its limits."""
        return self._find(thrusts)

    def reset(self) -> None:
        """Let the controller begin anew."""
        self.controller.reset()
        self._residual = NO_RESIDUAL

    def next_sequence(self) -> int:
        """The number of the next command on the thruster link."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        return self._sequence

"""The vehicle's controller: commands and sensor samples in, thruster commands out."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from hil.autonomy.control.allocation import Allocator
from hil.autonomy.control.controller import (
    NO_RESIDUAL,
    CascadedController,
    Drag,
    Gains,
    Navigation,
    VelocityCommand,
    Wrench,
    gains_of,
    heading_of,
)
from hil.autonomy.control.gyro_bias import GyroBias
from hil.autonomy.control.thruster_monitor import ThrusterMonitor
from hil.common.clock import seconds_ns
from hil.common.errors import ConfigError
from hil.common.schema import parse
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand
from hil.scenario.config import Scenario
from hil.slave.setpoints import PoseSetpoint, Setpoint, WrenchSetpoint
from sim.environment.seawater.pressure import ATMOSPHERE_PA, depth_of
from sim.environment.world import World
from sim.matrices import square
from sim.rotations import multiply, rotate
from sim.sensors.mounting import Mounting
from sim.vehicle.thrusters.bank import SteadyThrusts, pulse_finder, wrench_matrix
from sim.vehicle.vehicle import Vehicle, mass_matrix

if TYPE_CHECKING:
    from hil.autonomy.control.azimuth import AzimuthAllocator
    from hil.autonomy.control.families import Controller
    from hil.autonomy.control.fin_control import FinAllocator


def build_pilot(scenario: Scenario, vehicle: Vehicle, control: dict[str, Any], world: World) -> "Pilot":
    """Return the pilot of a scenario; `control` is the vehicle file's [control] table. Raises ConfigError."""
    where = f"{scenario.vehicle}: control"
    gains = gains_of(control, where)
    imu = scenario.sensors["imu"].mounting
    pilot = Pilot(vehicle, gains, world.density * world.gravity, seconds_ns(scenario.slave.deadman), imu)
    if vehicle.fins:
        pilot.steer_by_fins(gains, control.get("fins", {}), f"{where}.fins", world.density)
    if vehicle.azimuths:
        pilot.steer_by_azimuths(vehicle)
    if control.get("family", "cascade") != "cascade":
        pilot.controller = _other_family(vehicle, control, gains, world, where)
    return pilot


def _other_family(vehicle: Vehicle, control: dict[str, Any], gains: Gains, world: World, where: str) -> "Controller":
    from hil.autonomy.control.families import make_controller
    from hil.slave.plant_model import plant_of

    family = control["family"]
    if vehicle.fins:
        raise ConfigError(f"{where}: family: a vehicle with fins is steered by the cascade, not by {family!r}")
    return make_controller(family, control, gains, plant_of(vehicle, world.density, world.gravity), where)


def _drags(vehicle: Vehicle) -> list[Drag]:
    """Return the drag along surge and sway; empty if effects other than linear and quadratic damping add to it."""
    if vehicle.fins or vehicle.lift or vehicle.cross_flow or vehicle.forward_speed_damping or vehicle.fading_damping:
        return []
    linear, quadratic = square(vehicle.linear_damping, 6), square(vehicle.quadratic_damping, 6)
    return [Drag(linear[axis][axis], quadratic[axis][axis]) for axis in (0, 1)]


class Pilot:
    """Controller, allocation and thruster curves of one vehicle, with a deadman timeout.

    Feedback comes from the sensors only: attitude and rates from "imu", corrected for its mounting and its gyros' bias;
    position and velocity from "odom"; depth from "pressure". Each value is used until the next sample. A buoyancy
    engine is left neutral and drop weights stay aboard. Thrusters that do not do what they are commanded are left out
    of the allocation (`watch_thrusters`), and their own thrust counts as a disturbance; `report` gets a line on each.
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
        self.controller: Controller = CascadedController(gains, self._inertia, _drags(vehicle))
        self._pulse_finders = [pulse_finder(thruster) for thruster in vehicle.thrusters]
        self._steady = [SteadyThrusts(thruster) for thruster in vehicle.thrusters]
        self._thrusters = vehicle.thrusters
        self._read_thrusts: Callable[[], Sequence[float]] | None = None
        self.report: Callable[[str], None] = lambda line: None
        self._monitor = ThrusterMonitor(
            [max(thruster.max_forward, thruster.max_reverse) for thruster in vehicle.thrusters],
            [thruster.time_constant for thruster in vehicle.thrusters],
        )
        self._commanded_n = self._monitor.reported  # thrusts of the last command, N
        self._allocator = self._whole = Allocator(
            # Roll torque of the propellers is left out: the roll loop compensates it, better than by less thrust.
            wrench_matrix(vehicle, torque=False),
            [thruster.max_forward for thruster in vehicle.thrusters],
            [thruster.max_reverse for thruster in vehicle.thrusters],
        )
        self._fins = vehicle.fins
        self._fin_allocator: FinAllocator | None = None
        self._azimuth_allocator: AzimuthAllocator | None = None
        self._neutral = (PWM_NEUTRAL_US,) * len(vehicle.channels)
        self._water_weight = water_weight  # density times gravity at the surface, N/m³
        self._deadman_ns = deadman_ns
        self._imu_turn = imu.quaternion if imu.is_turned else None
        self._command: Setpoint = VelocityCommand()
        self._commanded_ns = 0
        self._residual = NO_RESIDUAL
        self._attitude = (1.0, 0.0, 0.0, 0.0)
        self._rates = self._velocity = (0.0, 0.0, 0.0)
        self._gyro_bias = GyroBias()
        self._depth = 0.0
        self.position: Sequence[float] = (0.0, 0.0, 0.0)
        self._sequence = 0
        self.active = False
        self.deadman_trips = 0

    def steer_by_fins(self, gains: Gains, table: dict[str, Any], where: str, density: float) -> None:
        """Use the controller for fins, with table [control.fins], in water of `density` kg/m³. Raises ConfigError."""
        from hil.autonomy.control.fin_control import FinAllocator, FinController, FinGains
        from sim.vehicle.fins import fin_matrix
        from sim.vehicle.servos import pulse

        self._servo_pulse = pulse
        fins = parse(table, FinGains, where)
        self.controller = FinController(gains, fins, self._inertia)
        limits = [fin.max_deflection for fin in self._fins]
        self._fin_allocator = FinAllocator(fin_matrix(self._fins, density), limits, fins.least_speed)

    def steer_by_azimuths(self, vehicle: Vehicle) -> None:
        """Turn the azimuth thrusters of `vehicle`. Raises ConfigError."""
        from hil.autonomy.control.azimuth import AzimuthAllocator
        from sim.vehicle.servos import pulse
        from sim.vehicle.thrusters.azimuth import turned

        self._servo_pulse = pulse
        self._azimuths = [thruster.azimuth for thruster in vehicle.thrusters if thruster.azimuth]
        self._azimuth_allocator = AzimuthAllocator(
            wrench_matrix(vehicle, torque=False),
            wrench_matrix(vehicle._replace(thrusters=tuple(map(turned, vehicle.thrusters))), torque=False),
            [thruster.max_forward for thruster in vehicle.thrusters],
            [thruster.max_reverse for thruster in vehicle.thrusters],
            [thruster.azimuth.max_deflection if thruster.azimuth else 0.0 for thruster in vehicle.thrusters],
        )

    def update_sensor(self, topic: str, sample: Any) -> None:
        """Update the navigation with one sensor sample (NED, FRD)."""
        if topic == "imu":
            self._attitude, self._rates = sample.orientation, sample.angular_velocity
            if self._imu_turn:
                w, x, y, z = self._imu_turn
                self._attitude = multiply(self._attitude, (w, -x, -y, -z))
                self._rates = rotate(self._imu_turn, self._rates)
            self._rates = self._gyro_bias.correct(sample.time_ns, self._attitude, self._rates)
        elif topic == "odom":
            self._velocity = sample.nu[:3]
            self.position = sample.position
        elif topic == "pressure":
            self._depth = depth_of(sample.pascal - ATMOSPHERE_PA, self._water_weight)

    def watch_thrusters(self, read: Callable[[], Sequence[float]]) -> None:
        """Let `read` return the thrust (N) that each thruster reports; nan for one that reports nothing."""
        self._read_thrusts = read

    @property
    def failed_thrusters(self) -> list[str]:
        """Names of the thrusters that do not do what they are commanded."""
        return self._names(self._monitor.failed)

    @property
    def unwatched_thrusters(self) -> list[str]:
        """Names of the thrusters that report nothing, so that their failure is not noticed."""
        return self._names(self._monitor.unwatched)

    def _names(self, flags: Sequence[bool]) -> list[str]:
        return [thruster.name for thruster, flag in zip(self._thrusters, flags, strict=True) if flag]

    def _follow_thrusters(self, read: Callable[[], Sequence[float]], dt: float) -> None:
        """Compare what the thrusters report with the last command; change the allocation after a failure or repair."""
        before = self.failed_thrusters
        if not self._monitor.update(self._commanded_n, read(), dt):
            return
        self._allocator = self._whole.without(self._monitor.failed)
        if self._azimuth_allocator is not None:
            self._azimuth_allocator.leave_out(self._monitor.failed)
        failed = self.failed_thrusters
        for name in [name for name in failed if name not in before]:
            self.report(f"thruster {name} does not do what it is commanded: the others take over what they can")
        for name in [name for name in before if name not in failed]:
            self.report(f"thruster {name} follows its commands again")

    @property
    def navigation(self) -> Navigation:
        """The vehicle's present estimate of its own state."""
        return Navigation(self._attitude, self._rates, self._velocity, self._depth)

    @property
    def requested_depth(self) -> float | None:
        """The depth (m) that the present command requests; None without one."""
        return self._command.depth if self.active else None

    def set_command(self, command: Setpoint, now: int) -> None:
        """Apply a new command that arrived at `now` (monotonic ns)."""
        self._command = command
        self._commanded_ns = now
        if not self.active:
            self.reset()
            self.active = True

    def update(self, now: int, dt: float) -> tuple[ThrusterCommand, bool]:
        """Return the thruster command for the next `dt` seconds, and whether the deadman has just tripped."""
        tripped = self.active and now - self._commanded_ns > self._deadman_ns
        if tripped:
            self.active = False
            self.deadman_trips += 1
        sequence = self.next_sequence()
        if not self.active:
            return ThrusterCommand(sequence, False, self._neutral), tripped
        if self._read_thrusts:
            self._follow_thrusters(self._read_thrusts, dt)
        pwm = self._pulses_for(self._command, dt)
        return ThrusterCommand(sequence, True, pwm + self._neutral[len(pwm) :]), False

    def _pulses_for(self, command: Setpoint, dt: float) -> tuple[int, ...]:
        """Return the pulse widths (us) that carry out a setpoint for the next `dt` seconds."""
        if isinstance(command, VelocityCommand):
            return self._allocate_wrench(self._steer(command, dt))
        if isinstance(command, PoseSetpoint):
            from hil.autonomy.control.position import approach

            own = heading_of(self._attitude)
            return self._allocate_wrench(self._steer(approach(*command.pose, self.position, own), dt))
        self.reset()  # open loop: nothing to integrate
        if isinstance(command, WrenchSetpoint):
            return self._allocate_wrench(command.wrench)
        return self._thrust_to_pwm(command.thrusts)

    def _steer(self, command: VelocityCommand, dt: float) -> Wrench:
        """Return the wrench (N, N m, along FRD) that follows a velocity command for the next `dt` seconds."""
        return self.controller.update(command, self.navigation, dt, self._residual)

    def _allocate_wrench(self, wrench: Wrench) -> tuple[int, ...]:
        """Return the pulse widths (us) of thrusters, fins and azimuths for this wrench, or the nearest possible one."""
        turns: list[float] = []
        if self._azimuth_allocator is None:
            thrusts = self._allocate_thrusts(wrench)
        else:  # where one pushes that has failed and turned is not known
            thrusts, turns, self._residual = self._azimuth_allocator.allocate(wrench)
        if any(self._monitor.failed):
            thrusts = self._monitor.with_tests(thrusts)
        pwm = self._thrust_to_pwm(thrusts)
        if self._fin_allocator is not None:
            angles, self._residual = self._fin_allocator.allocate(self._residual, self._velocity[0])
            pwm += tuple([self._servo_pulse(fin, angle) for fin, angle in zip(self._fins, angles, strict=True)])
        if turns:
            pwm += tuple([self._servo_pulse(one, angle) for one, angle in zip(self._azimuths, turns, strict=True)])
        return pwm

    def _allocate_thrusts(self, wrench: Wrench) -> list[float]:
        """Return the thrusts (N) for this wrench, without the thrusters that have failed; set the residual."""
        if any(self._monitor.failed):
            wrench = self._whole.missing(wrench, self._monitor.own_thrusts())
        thrusts, self._residual = self._allocator.allocate(wrench)
        return thrusts

    def _thrust_to_pwm(self, thrusts: Sequence[float]) -> tuple[int, ...]:
        """Return the pulse widths (us) for these thrusts (N), each limited to what its thruster can give."""
        pwm = tuple([find(thrust) for find, thrust in zip(self._pulse_finders, thrusts, strict=True)])
        self._commanded_n = [steady[pulse] for steady, pulse in zip(self._steady, pwm, strict=True)]
        return pwm

    def reset(self) -> None:
        """Reset the controller's integrators and states."""
        self.controller.reset()
        self._residual = NO_RESIDUAL

    def next_sequence(self) -> int:
        """Return the sequence number of the next command on the thruster link."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        return self._sequence

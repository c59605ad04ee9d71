"""Simulate one vehicle in one world: each step takes thruster pulses and returns the sensor samples that are due."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING

from hil.common.errors import ConfigError, DivergenceError, StartPositionError
from sim.arguments import require_events, require_numbers, require_parts, require_wrenches
from sim.assembly import assemble, make_hull_dynamics
from sim.dynamics import Forces, State
from sim.environment.world import World
from sim.matrices import Matrix
from sim.native import NativeDynamics
from sim.rotations import from_euler, rotate_inverse
from sim.run_events import EventLog
from sim.sensors.odometry import ground_truth
from sim.sensors.samples import OdometrySample, Sample
from sim.sensors.sensor_set import Schedule, SensorSet, select_sensors
from sim.vehicle.thrusters.model import check_pulses
from sim.vehicle.vehicle import Vehicle, without_weight

if TYPE_CHECKING:
    from sim.environment.waves import WaveField
    from sim.forces import Force
    from sim.tether import TetherKeys
    from sim.vehicle.ballast import DropWeight, Release
    from sim.vehicle.battery import BatteryState
    from sim.vehicle.equipment import Equipment
    from sim.vehicle.failures import Failure

DT_NS = 2_500_000  # 400 Hz


class Simulation:
    """The simulation of a vehicle that starts at rest at `position` (NED, m) and `heading` (rad from north, clockwise).

    The same arguments and the same pulses give the same numbers to the last bit. `dt_ns` is the duration of a step; no
    sensor can sample faster. `sensors` are the default ones if left out. `failures` are the failures of thrusters, each
    with its time; `forces` are forces besides hull and thrusters; `releases` are the times at which weights are
    dropped; `tether` is a tether that holds the vehicle (sim/tether.py).

    `contacts` counts contacts with seabed and obstacles, `touching` is whether there was one in the last step, and
    `events` lists them: with what, when (simulated time), where and for how long. `equipment` is that of
    sim/vehicle/equipment.py, None for a vehicle that has only hull and thrusters; `accessories` are those of
    sim/vehicle/accessories.py, None if it has none.

    Raises ConfigError for impossible numbers, for a start inside an obstacle or the seabed, and for a failure or a
    release that names an unknown thruster or weight.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        world: World,
        sensors: SensorSet | None = None,
        seed: int = 0,
        dt_ns: int = DT_NS,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        heading: float = 0.0,
        failures: "Sequence[Failure]" = (),
        forces: "Sequence[Force]" = (),
        releases: "Sequence[Release]" = (),
        tether: "TetherKeys | None" = None,
    ) -> None:
        require_parts(vehicle, world, sensors)
        require_numbers(vehicle, world, seed, dt_ns, position, heading)
        require_events(failures, forces, releases)
        self.vehicle = vehicle
        self.world = world
        self.time_ns = 0
        self.events = EventLog()
        self._dt_ns = dt_ns
        self._dt = dt_ns * 1e-9
        self._seed = seed
        pose = position, from_euler(0.0, 0.0, heading)
        events = failures, forces, releases, tether
        parts = assemble(vehicle, world, seed, dt_ns, pose, *events, self._command, self._read_body, self.flow_at)
        self.state = parts.state
        self.accessories, self.equipment, self.tether = parts.accessories, parts.equipment, parts.tether
        self._dynamics, self._forces = parts.dynamics, parts.forces
        self._thrusters, self._water, self._contact = parts.thrusters, parts.water, parts.contact
        self._flow: Sequence[float] = world.current
        self._wrench: Sequence[float] = (0.0,) * 6
        if self._contact.is_inside(self.state):
            at = ", ".join(f"{x:g}" for x in position)
            raise StartPositionError(
                f"{vehicle.name} cannot start at ({at}) m: an obstacle or the seabed of {world.name} is there; "
                "move the start"
            )
        self._schedule = Schedule(select_sensors() if sensors is None else sensors, self, seed, dt_ns)
        self._ventilation = parts.ventilation
        self._is_ventilated = False  # whether thrust was reduced at the surface in the last step
        self._update_ventilation(0)
        self._fused = parts.fused
        # Does one step of the motion. Returns the nu before the step if a contact is possible at its end, else None.
        self._advance: Callable[[Sequence[int]], Sequence[float] | None]
        self._advance = self._fused.step if self._fused else self._step_terms

    @property
    def contacts(self) -> int:
        """Number of contacts of the vehicle so far."""
        return self._contact.count

    @property
    def touching(self) -> bool:
        """True if the vehicle touched seabed or an obstacle in the last step."""
        return self._contact.touching

    @property
    def thrusts(self) -> list[float]:
        """The present thrust of each thruster in N."""
        return self._thrusters.thrusts

    def motors(self, pwm_us: Sequence[int]) -> list[tuple[float, float]]:
        """Return speed (rad/s) and current (A) of each thruster at these pulses (us, one a channel).

        See ThrusterSet.motors.
        """
        return self._thrusters.motors(pwm_us)

    def thruster_reports(self) -> list[float]:
        """Return the thrust (N) that each motor controller's telemetry stands for; nan without. See ThrusterSet."""
        return self._thrusters.reports

    @property
    def wave_field(self) -> "WaveField | None":
        """The waves; None if there are none."""
        return self._water.wave_field if self._water else None

    def flow_at(self, position: Sequence[float]) -> Sequence[float]:
        """Return the present velocity of the water (NED, m/s) at `position` (NED, m)."""
        return self._water.velocity(self.time_ns, position) if self._water else self.world.current

    def _read_body(self) -> tuple[State, Matrix]:
        """Return the state and the inverse mass matrix, for the tether."""
        return self.state, self._dynamics.inverse_mass

    @property
    def battery(self) -> "BatteryState | None":
        """Present reading of a battery monitor; None if the vehicle has none."""
        return self._thrusters.battery

    def place(self, position: Sequence[float], quaternion: Sequence[float], nu: Sequence[float]) -> None:
        """Move the vehicle: position (NED, m), quaternion (body to NED), nu (FRD); its tether begins at rest again."""
        state = self.state
        state.position, state.quaternion, state.nu = list(position), list(quaternion), list(nu)
        state.nu_dot = [0.0] * 6
        if self.tether:
            self.tether.restart()

    def move_accessories(self, shares: Mapping[str, float]) -> None:
        """Command accessories, each to its share; safe in another thread than the steps."""
        for name, share in shares.items():
            if self.accessories:
                self.accessories.command(name, share, self.time_ns)

    def fail(self, *failures: "Failure") -> None:
        """Let thrusters fail, each at its time. A failure whose time has passed begins with the next step.

        Raises ConfigError for an unknown thruster, or for an object that is no Failure.
        """
        require_events(failures)
        if self._fused:  # the fused step has no failures: from now on the terms are computed one by one
            self._wrench, self._flow = self._fused.wrench, self._fused.flow
            self._fused, self._advance, self._is_ventilated = None, self._step_terms, True
        self._thrusters.fail(failures)

    def failures(self, name: str) -> "tuple[Failure, ...]":
        """Return the present failures of the thruster `name`."""
        return self._thrusters.failures(name)

    def release(self, name: str) -> None:
        """Drop the weight `name`. Raises ConfigError if the vehicle has no such weight, or has dropped it already."""
        if self.equipment is None:
            raise ConfigError(f"release: {self.vehicle.name} has no drop weight {name!r}, nor any other")
        self._drop_weight(self.equipment.remove_weight(name))

    def forces(self) -> Forces:
        """Return the forces on the vehicle now, term by term, with the thrust, water and contact of the last step.

        The force of a contact is its impulse divided by the step.
        """
        forces = self._dynamics.forces(self.state, *self._last_inputs(max(0, self.time_ns - self._dt_ns)))
        if not self.touching:
            return forces
        contact = [x / self._dt for x in self._contact.impulse]
        total = [a + b for a, b in zip(forces.total, contact, strict=True)]
        return forces._replace(contact=contact, total=total)

    def truth(self) -> OdometrySample:
        """Return the present true position, attitude and velocity of the vehicle."""
        return ground_truth(self.time_ns, self.state)

    def step(self, pwm_us: Sequence[int]) -> list[tuple[str, Sample]]:
        """Advance by one step under these pulses (us, one a channel); return the samples that are due, with topics.

        Raises DivergenceError if the new state would not be finite; the state is then unchanged. Raises ConfigError
        for pulses that are no numbers, and for a user's force that returns no wrench.
        """
        try:
            before = self._advance(pwm_us)
        except FloatingPointError:
            raise self._divergence() from None
        except (TypeError, ValueError):
            if not hasattr(pwm_us, "__len__"):
                raise ConfigError(f"pwm_us = {pwm_us!s:.40}: give a list of pulses, one a channel") from None
            require_wrenches(self._forces, self.state)
            raise
        if before is not None:
            found = self.state.position, self.state.nu
            try:
                self._resolve_collision(before)
            except (FloatingPointError, ZeroDivisionError):  # at a velocity beyond all measure
                self.state.position, self.state.nu = found
                raise self._divergence() from None
        self.time_ns += self._dt_ns
        return self._schedule.pop_due(self.time_ns, self) if self.time_ns >= self._schedule.due_ns else []

    def _command(self, pwm_us: tuple[int, ...]) -> None:
        """Pass new pulses on: the first ones to the thrusters, the others to the equipment."""
        assert self.equipment is not None
        count = self._count_thrusters(pwm_us)
        for weight in self.equipment.command(pwm_us[count:]):
            self._drop_weight(weight)
        self._thrusters.command(pwm_us[:count])

    def _last_inputs(self, time_ns: int) -> tuple[Sequence[float], Sequence[float]]:
        """Return wrench and water velocity of the last step, which began at `time_ns`; set the forces to that time."""
        if self._fused is None:
            return self._wrench, self._flow
        for force in self._dynamics.others:
            force.begin(time_ns)
        return self._fused.wrench, self._fused.flow

    def _step_terms(self, pwm_us: Sequence[int]) -> Sequence[float]:
        """Do one step of the motion, term by term, for any vehicle in any water; return the nu before it."""
        state = self.state
        if self.equipment is not None:
            pwm_us = self._step_equipment(self.equipment, pwm_us)
        thrusters = self._thrusters
        step_thrusters = self._step_thrusters_in_flow if thrusters.needs_inflow else thrusters.step
        wrench: Sequence[float] = step_thrusters(pwm_us)
        current = self.world.current
        if self._water is not None:
            current, wrench = self._water.act(self.time_ns, state, wrench)
            self._flow = current
        for force in self._dynamics.others:
            force.begin(self.time_ns)
        self._wrench = wrench
        before = state.nu
        self._dynamics.step(state, wrench, current, self._dt)
        return before

    def _divergence(self) -> DivergenceError:
        from sim.divergence import find_cause  # needed only when a run fails

        cause = find_cause(self._dynamics, self.state, *self._last_inputs(self.time_ns), self._dt)
        at = self.time_ns * 1e-9
        return DivergenceError(f"{self.vehicle.name}: its state is not finite any more after {at:.4f} s: {cause}")

    def _resolve_collision(self, before: Sequence[float]) -> None:
        """Apply contact impulses and move the hull out of solid things; `before` is the nu before the last step."""
        state = self.state
        if self._contact.resolve(state):
            if not isfinite(sum(state.position) + sum(state.nu)):
                raise FloatingPointError("the state is not finite any more")
            state.nu_dot = [(new - old) / self._dt for new, old in zip(state.nu, before, strict=True)]
            now = self.time_ns
            self.events.record("collision", now, now + self._dt_ns, state.position, self._contact.what)
        if self._fused:
            self._fused.set_clearance(*self._contact.clearance())
        else:
            self._update_ventilation(self.time_ns + self._dt_ns)

    def _update_ventilation(self, time_ns: int) -> None:
        """Reduce the thrust of thrusters near the surface, for the step that begins at `time_ns`."""
        state = self.state
        is_ventilated = state.position[2] < self._ventilation.reach
        if is_ventilated:
            self._thrusters.scale_thrusts(self._ventilation.shares(state.position, state.quaternion, time_ns * 1e-9))
        elif self._is_ventilated:
            self._thrusters.scale_thrusts(None)
        self._is_ventilated = is_ventilated

    def _step_equipment(self, equipment: "Equipment", pwm_us: Sequence[int]) -> Sequence[int]:
        """Do one step of the equipment under its part of these pulses; return the thrusters' part."""
        count = self._count_thrusters(pwm_us)
        for weight in equipment.step(self.time_ns, pwm_us[count:]):
            self._drop_weight(weight)
        return pwm_us[:count]

    def _count_thrusters(self, pwm_us: Sequence[int]) -> int:
        """Return how many of these pulses, the first ones, are for thrusters. Raises ConfigError for a wrong count."""
        channels = len(self.vehicle.channels)
        if len(pwm_us) != channels:
            raise ConfigError(f"{len(pwm_us)} pulses for a vehicle of {channels} channels: give one a channel")
        check_pulses(pwm_us)
        return len(self.vehicle.thrusters)

    def _drop_weight(self, weight: "DropWeight") -> None:
        """Remove `weight`. Its momentum leaves with it, so the velocity of the vehicle does not change."""
        self.vehicle = without_weight(self.vehicle, weight, self.world.density)
        parts = self.vehicle, self.world, self._forces, self.wave_field, self._seed
        self._dynamics = make_hull_dynamics(*parts)
        self._contact.inverse_mass = self._dynamics.inverse_mass
        if self._water is not None:
            self._water.set_vehicle(self.vehicle, self.world.density)
        if self._fused:
            assert isinstance(self._dynamics, NativeDynamics)
            self._fused.rebuild(self._dynamics.kernel, self._water.wave_inertia if self._water else None)

    def _step_thrusters_in_flow(self, pwm_us: Sequence[int]) -> Sequence[float]:
        """Step the thrusters in the water velocity of the previous step; return their wrench (N, N m, body axes)."""
        state = self.state
        water = rotate_inverse(state.quaternion, self._flow)
        return self._thrusters.step(
            pwm_us, [speed - flow for speed, flow in zip(state.nu, (*water, 0.0, 0.0, 0.0), strict=True)]
        )

"""One vehicle in one world: pulses in, sensor samples out, each call one step of simulated time."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from hil.errors import ConfigError
from sim.contact import Contact, starts_inside
from sim.dynamics import Dynamics, Forces, Integrator
from sim.native import make_coast, make_dynamics, make_state
from sim.rotations import from_euler, rotate_inverse
from sim.sensors.odometry import ground_truth
from sim.sensors.samples import OdometrySample, Sample
from sim.sensors.suite import Schedule, Suite, fit
from sim.thrusters import make_thrusters
from sim.vehicle import Vehicle
from sim.world import World

if TYPE_CHECKING:
    from sim.ballast import DropWeight, Release
    from sim.battery import BatteryState
    from sim.equipment import Equipment
    from sim.failures import Failure
    from sim.forces import Force
    from sim.native._native import Coast
    from sim.water import MovingWater
    from sim.waves import Sea

DT_NS = 2_500_000  # 400 Hz


class Simulation:
    """A vehicle from rest at `position` (NED, m) with its bow at `heading` (rad from north, clockwise).

    The same arguments and the same pulses give the same numbers to the last bit. `dt_ns` is how much
    each step advances; a sensor cannot be faster. `sensors` are the usual ones if left out. `failures` are what
    befalls the thrusters, and when; `forces` what pushes the vehicle besides them; `releases` say when it drops its
    weights. `contacts` counts the touches of seabed and obstacles, `touching` tells of the last step; `equipment` is
    what sim/equipment.py says, None for a vehicle of hull and thrusters. Raises ConfigError if the vehicle would
    start inside something, or has not the thruster that fails or the weight that goes.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        world: World,
        sensors: Suite | None = None,
        seed: int = 0,
        dt_ns: int = DT_NS,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        heading: float = 0.0,
        integrator: Integrator = "semi_implicit_euler",
        failures: "Sequence[Failure]" = (),
        forces: "Sequence[Force]" = (),
        releases: "Sequence[Release]" = (),
    ) -> None:
        if starts_inside(vehicle, world, position):
            at = ", ".join(f"{x:g}" for x in position)
            raise ConfigError(
                f"{vehicle.name} cannot start at ({at}) m: an obstacle or the seabed of {world.name} is there"
            )
        self.vehicle = vehicle
        self.world = world
        self.time_ns = 0
        self.state = make_state(position, from_euler(0.0, 0.0, heading))
        self._dt_ns = dt_ns
        self._dt = dt_ns * 1e-9
        self._integrator: Integrator = integrator
        self._water = _moving_water(vehicle, world, seed)
        self.equipment = _equipment(vehicle, world, self._dt, releases)
        self._own_forces = forces
        self._dynamics = self._build()
        self._thrusters = make_thrusters(vehicle, self._dt, failures, seed)
        self._flow: Sequence[float] = world.current
        self._wrench: Sequence[float] = (0.0,) * 6
        self._contact = Contact(vehicle, world, self._dynamics.inverse_mass)
        self._schedule = Schedule(fit() if sensors is None else sensors, self, seed, dt_ns)
        self._coast = self._in_one()
        # One step of the motion; the nu before it if there may be a contact at its end.
        self._advance: Callable[[Sequence[int]], Sequence[float] | None]
        self._advance = self._coast.step if self._coast else self._term_by_term

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
    def sea(self) -> "Sea | None":
        """The waves; None if there are none."""
        return self._water.sea if self._water else None

    def flow_at(self, place: Sequence[float]) -> Sequence[float]:
        """The velocity of the water at a place (m, NED) now, NED in m/s."""
        return self._water.velocity(self.time_ns, place) if self._water else self.world.current

    @property
    def battery(self) -> "BatteryState | None":
        """What a battery monitor would read now; None if the vehicle has none."""
        return self._thrusters.battery

    def fail(self, *failures: "Failure") -> None:
        """Let thrusters fail, each at its time; one whose time has passed fails with the next step.

        Raises ConfigError for an unknown thruster.
        """
        if self._coast:  # thrusters that may fail are moved on apart from the rest, from now on
            self._wrench, self._coast, self._advance = self._coast.wrench, None, self._term_by_term
        self._thrusters.fail(failures)

    def failures(self, name: str) -> "tuple[Failure, ...]":
        """What is wrong with the thruster `name` now."""
        return self._thrusters.failures(name)

    def release(self, name: str) -> None:
        """Let the drop weight `name` go. Raises ConfigError if it is not there, or no more."""
        if self.equipment is None:
            raise ConfigError(f"release: {self.vehicle.name} has no drop weight {name!r}, nor any other")
        self._drop(self.equipment.take(name))

    def forces(self) -> Forces:
        """The forces on it now, term by term, under the thrust and in the water of the last step."""
        wrench = self._coast.wrench if self._coast else self._wrench
        return self._dynamics.forces(self.state, wrench, self._flow)

    def truth(self) -> OdometrySample:
        """Where the vehicle really is, now."""
        return ground_truth(self.time_ns, self.state)

    def step(self, pwm_us: Sequence[int]) -> list[tuple[str, Sample]]:
        """Advance by one step under these pulses (us, one a channel); the samples that fell due, by topic."""
        before = self._advance(pwm_us)
        if before is not None:
            self._keep_out(before)
        self.time_ns += self._dt_ns
        return self._schedule.take(self.time_ns, self) if self.time_ns >= self._schedule.due_ns else []

    def _in_one(self) -> "Coast | None":
        """All of a step in one call, where nothing acts but thrusters that work and water that is steady, and in C."""
        if self.equipment is not None or self._water is not None or self._forces:
            return None
        half_height = self._contact.half_height
        return make_coast(self.state, self._dynamics, self._thrusters, self.world.current, self._dt, half_height)

    def _term_by_term(self, pwm_us: Sequence[int]) -> Sequence[float]:
        """One step of the motion, of whatever vehicle in whatever water; the nu before it."""
        state = self.state
        if self.equipment is not None:
            pwm_us = self._equip(self.equipment, pwm_us)
        thrusters = self._thrusters
        wrench: Sequence[float] = self._push(pwm_us) if thrusters.feels_water else thrusters.step(pwm_us)
        current = self.world.current
        if self._water is not None:
            current, wrench = self._water.act(self.time_ns, state, wrench)
            self._flow = current
        for force in self._forces:
            force.begin(self.time_ns)
        self._wrench = wrench
        before = state.nu
        self._dynamics.step(state, wrench, current, self._dt)
        return before

    def _keep_out(self, before: Sequence[float]) -> None:
        """Undo what the last step did to solid things; `before` is the nu from before it."""
        state = self.state
        if self._contact.resolve(state):
            state.nu_dot = [(new - old) / self._dt for new, old in zip(state.nu, before, strict=True)]
        if self._coast:
            self._coast.watch(*self._contact.room())

    def _equip(self, equipment: "Equipment", pwm_us: Sequence[int]) -> Sequence[int]:
        """One step of the equipment under its part of these pulses; the thrusters' part."""
        count, channels = len(self.vehicle.thrusters), len(self.vehicle.channels)
        if len(pwm_us) != channels:
            raise ConfigError(f"{len(pwm_us)} pulses for a vehicle of {channels} channels: give one a channel")
        for weight in equipment.step(self.time_ns, pwm_us[count:]):
            self._drop(weight)
        return pwm_us[:count]

    def _drop(self, weight: "DropWeight") -> None:
        """Go on as fast as before without `weight`, which takes its own momentum along."""
        from sim.ballast import without

        self.vehicle = without(self.vehicle, weight, self.world.density)
        self._dynamics = self._build()
        self._contact.inverse_mass = self._dynamics.inverse_mass
        if self._water is not None:
            self._water.carry(self.vehicle, self.world.density)

    def _build(self) -> Dynamics:
        """The equations of the vehicle as it is now, with all that pushes it."""
        vehicle, world = self.vehicle, self.world
        forces = [*self.equipment.forces, *self._own_forces] if self.equipment else list(self._own_forces)
        if world.ocean and (world.ocean.profile or world.ocean.waves):
            from sim.stratification import surface_and_layers

            forces += surface_and_layers(vehicle, world, self.sea)
        self._forces = forces
        return make_dynamics(vehicle, world.density, world.gravity, self._integrator, forces)

    def _push(self, pwm_us: Sequence[int]) -> Sequence[float]:
        """The wrench of thrusters that meet the water as it flowed a step ago."""
        state = self.state
        water = rotate_inverse(state.quaternion, self._flow)
        return self._thrusters.step(
            pwm_us, [speed - flow for speed, flow in zip(state.nu, (*water, 0.0, 0.0, 0.0), strict=True)]
        )


def _moving_water(vehicle: Vehicle, world: World, seed: int) -> "MovingWater | None":
    """What moves the water besides the steady current; None if nothing does, and then nothing is loaded for it."""
    if not (world.ocean and world.ocean.moves):
        return None
    from sim.water import MovingWater

    return MovingWater(vehicle, world, seed)


def _equipment(vehicle: Vehicle, world: World, dt: float, releases: "Sequence[Release]") -> "Equipment | None":
    """The equipment of `vehicle`; None if it has none, and then nothing is loaded for it. Raises ConfigError."""
    if not (vehicle.equipped or releases):
        return None
    from sim.equipment import Equipment

    return Equipment(vehicle, world.density, world.gravity, dt, releases)

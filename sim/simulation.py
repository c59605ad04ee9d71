"""One vehicle in one world: pulses in, sensor samples out, each call one step of simulated time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hil.errors import ConfigError
from sim.contact import Contact, starts_inside
from sim.dynamics import Forces, Integrator, State
from sim.forces import Force
from sim.native import make_dynamics
from sim.rotations import from_euler, rotate_inverse
from sim.sensors.odometry import ground_truth
from sim.sensors.samples import OdometrySample, Sample
from sim.sensors.suite import Schedule, Suite, fit
from sim.thrusters import make_thrusters
from sim.vehicle import Vehicle
from sim.world import World

if TYPE_CHECKING:
    from sim.battery import BatteryState
    from sim.failures import Failure
    from sim.water import MovingWater
    from sim.waves import Sea

DT_NS = 2_500_000  # 400 Hz


class Simulation:
    """A vehicle from rest at `position` (NED, m) with its bow at `heading` (rad from north, clockwise).

    The same arguments and the same pulses give the same numbers to the last bit. `dt_ns` is how much
    each step advances; a sensor cannot be faster. `sensors` are the usual ones if left out. `failures` are what
    befalls the thrusters, and when; `forces` what pushes the vehicle besides them. `contacts` counts the
    touches of seabed and obstacles, `touching` tells of the last step. Raises ConfigError if the vehicle would
    start inside something, or has not the thruster that fails.
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
        forces: Sequence[Force] = (),
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
        self._dynamics = make_dynamics(vehicle, world.density, world.gravity, integrator, forces)
        self._forces = forces
        self._thrusters = make_thrusters(vehicle, self._dt, failures, seed)
        self._flow: Sequence[float] = world.current
        self._wrench: Sequence[float] = (0.0,) * 6
        self._contact = Contact(vehicle, world, self._dynamics.inverse_mass)
        self._water = _moving_water(vehicle, world, seed)
        self._schedule = Schedule(fit() if sensors is None else sensors, self, seed, dt_ns)

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
    def flow(self) -> Sequence[float]:
        """The velocity of the water where the vehicle is, NED in m/s, as of the last step."""
        return self._flow

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
        self._thrusters.fail(failures)

    def forces(self) -> Forces:
        """The forces on it now, term by term, under the thrust and in the water of the last step."""
        return self._dynamics.forces(self.state, self._wrench, self._flow)

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
        for force in self._forces:
            force.begin(self.time_ns)
        self._wrench = wrench
        before = state.nu
        self._dynamics.step(state, wrench, current, self._dt)
        if self._contact.resolve(state):
            state.nu_dot = [(new - old) / self._dt for new, old in zip(state.nu, before, strict=True)]
        self.time_ns += self._dt_ns
        return self._schedule.take(self.time_ns, self) if self.time_ns >= self._schedule.due_ns else []

    def _push(self, pwm_us: Sequence[int]) -> Sequence[float]:
        """The wrench of the thrusters, which meet the water as it flowed a step ago."""
        thrusters, state = self._thrusters, self.state
        if not thrusters.feels_water:
            return thrusters.step(pwm_us)
        water = rotate_inverse(state.quaternion, self._flow)
        return thrusters.step(
            pwm_us, [speed - flow for speed, flow in zip(state.nu, (*water, 0.0, 0.0, 0.0), strict=True)]
        )


def _moving_water(vehicle: Vehicle, world: World, seed: int) -> "MovingWater | None":
    """What moves the water besides the steady current; None if nothing does, and then nothing is loaded for it."""
    if not (world.ocean and world.ocean.moves):
        return None
    from sim.water import MovingWater

    return MovingWater(vehicle, world, seed)

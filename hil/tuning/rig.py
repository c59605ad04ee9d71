"""A test rig for tuning: one vehicle with its controller in deep open water, in simulated time."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from hil.autonomy.control.controller import NO_RESIDUAL, Navigation, VelocityCommand, Wrench
from hil.autonomy.control.families import Controller
from hil.common.clock import NS_PER_S
from hil.scenario.config import Scenario
from hil.scenario.records import Master
from hil.slave.pilot import build_pilot
from sim.environment.world import World
from sim.rotations import from_euler, to_euler
from sim.sensors.sensor_set import select_sensors
from sim.simulation import DT_NS, Simulation
from sim.vehicle.vehicle import Vehicle

DEEP = World(name="deep water", source="nothing in it", extent=(-1e4, 1e4, -1e4, 1e4), depth=1000.0)
START_DEPTH = 50.0
CONTROL_PERIOD_S = 0.02
_STEPS = round(CONTROL_PERIOD_S * NS_PER_S) // DT_NS

CommandFunction = Callable[[float], VelocityCommand]


class Moment(NamedTuple):
    """State at one time (s): velocity (FRD, m/s, rad/s), position (NED, m), attitude (rad), wrench (N, N m)."""

    time: float
    nu: tuple[float, ...]
    position: tuple[float, ...]
    attitude: tuple[float, float, float]
    wrench: Wrench


class Recorder:
    """Controller that passes on the wrench of another controller, stores it in `last`, and may replace one axis."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.last = NO_RESIDUAL
        self._axis, self._held = -1, 0.0

    def add_step(self, axis: int, size: float) -> None:
        """Hold `axis` (0 to 5) at its last output plus `size` (N or N m) from now on, without the controller."""
        self._axis, self._held = axis, self.last[axis] + size

    def reset(self) -> None:
        """Reset the controller."""
        self._controller.reset()

    def update(
        self, command: VelocityCommand, navigation: Navigation, dt: float, residual: Wrench = NO_RESIDUAL
    ) -> Wrench:
        """Return the wrench (N, N m) for the next `dt` s."""
        wrench = list(self._controller.update(command, navigation, dt, residual))
        if self._axis >= 0:
            wrench[self._axis] = self._held
        self.last = tuple(wrench)  # type: ignore[assignment]
        return self.last


class Rig:
    """Simulation of `vehicle` with its `control` table, at rest in `world` at `depth` (m), heading north.

    `name`: of the vehicle, for errors. `flown`: a different vehicle to simulate with the controller of `vehicle`.
    `current`: m/s, NED. `tilt`: initial roll and pitch, rad. Sensors are the default ones with their errors. Raises
    ConfigError.
    """

    def __init__(
        self,
        name: str,
        vehicle: Vehicle,
        control: dict[str, Any],
        flown: Vehicle | None = None,
        current: tuple[float, float, float] = (0.0, 0.0, 0.0),
        tilt: Sequence[float] = (0.0, 0.0),
        seed: int = 1,
        world: World = DEEP,
        depth: float = START_DEPTH,
    ) -> None:
        world = world._replace(current=current)
        sensors = select_sensors()
        scenario = Scenario(vehicle=name, world=world.name, master=Master(goal=(0.0, 0.0)), sensors=sensors)
        self.simulation = Simulation(flown or vehicle, world, sensors, seed, position=(0.0, 0.0, depth))
        self.simulation.state.quaternion = list(from_euler(tilt[0], tilt[1], 0.0))
        self._pilot = build_pilot(scenario, vehicle, control, world)
        self._pilot.watch_thrusters(self.simulation.thruster_reports)
        self.recorder = Recorder(self._pilot.controller)
        self._pilot.controller = self.recorder

    def fly(self, seconds: float, commands: CommandFunction | None) -> list[Moment]:
        """Continue for `seconds`; return the state at each control period.

        `commands` returns the command for the time (s) since this call. Without commands the vehicle is adrift.
        """
        simulation, pilot = self.simulation, self._pilot
        moments = []
        for number in range(round(seconds / CONTROL_PERIOD_S)):
            time = number * CONTROL_PERIOD_S
            if commands is not None:
                pilot.set_command(commands(time), simulation.time_ns)
            pulses, _ = pilot.update(simulation.time_ns, CONTROL_PERIOD_S)
            state = simulation.state
            attitude = to_euler(state.quaternion)
            moments.append(Moment(time, tuple(state.nu), tuple(state.position), attitude, self.recorder.last))
            for _ in range(_STEPS):
                for topic, sample in simulation.step(pulses.pwm_us):
                    pilot.update_sensor(topic, sample)
        return moments

"""Simulate vehicles with their controllers in one process and in simulated time, without network and link."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import NS_PER_S, seconds_ns
from hil.master.flight import Flight, Outcome, Plan
from hil.master.planner import Planner
from hil.scenario.config import Scenario, build_simulation
from hil.slave.pilot import build_pilot
from sim.environment.world import World, load_world
from sim.sensors.samples import GROUND_TRUTH, ODOMETRY
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

if TYPE_CHECKING:
    from hil.master.recorder import TrackWriter

PROGRESS_STEPS = 40  # between two reports of a flight's progress
# A function that is called with the vehicle after each step
Watch = Callable[["SimulatedVehicle"], None]


class SimulatedVehicle:
    """A simulated vehicle of a scenario with its controller, initially at time 0.

    `samples`: the newest sample of each topic other than the true state. `pwm_us`: pulse widths of the last step.
    Raises ConfigError.
    """

    def __init__(self, scenario: Scenario, world: World | None = None) -> None:
        vehicle, control = load_vehicle(scenario.vehicle)
        world = world or load_world(scenario.world)
        self.simulation = build_simulation(scenario, vehicle, world)
        self.samples: dict[str, Any] = {}
        self.pwm_us: tuple[int, ...] = ()
        self._pilot = build_pilot(scenario, vehicle, control, self.simulation.world)
        self._pilot.watch_thrusters(self.simulation.thruster_reports)
        self._period = scenario.slave.control_period
        self._period_ns = seconds_ns(self._period)
        self._due_ns = 0

    @property
    def time_ns(self) -> int:
        """Simulation time since the start."""
        return self.simulation.time_ns

    def command(self, command: VelocityCommand) -> None:
        """Set a new command."""
        self._pilot.set_command(command, self.time_ns)

    def step(self) -> None:
        """Make one step of the scenario: the controller if it is due, then thrusters, dynamics and sensors."""
        if self.time_ns >= self._due_ns:
            self._due_ns += self._period_ns
            pulses, _ = self._pilot.update(self.time_ns, self._period)
            self.pwm_us = pulses.pwm_us
        for topic, sample in self.simulation.step(self.pwm_us):
            self._pilot.update_sensor(topic, sample)
            if topic != GROUND_TRUTH:
                self.samples[topic] = sample


def fly(
    scenario: Scenario,
    plan: Plan,
    vehicle: SimulatedVehicle | None = None,
    watches: Sequence[Watch] = (),
    track: "TrackWriter | None" = None,
) -> tuple[Outcome, str]:
    """Fly the scenario's mission in simulated time; return its outcome, and the exact final state as text.

    `vehicle`: at time 0, by default built from the scenario. `watches` are called after each step. `track` gets a row
    per command. Raises ConfigError.
    """
    vehicle = vehicle or SimulatedVehicle(scenario, plan.world)
    flight = Flight(scenario, plan)
    period_ns = seconds_ns(scenario.master.command_period)
    due_ns = period_ns
    while not flight.reason:
        vehicle.step()
        if vehicle.time_ns >= due_ns and ODOMETRY in vehicle.samples:
            due_ns += period_ns
            elapsed, truth = vehicle.time_ns / NS_PER_S, vehicle.simulation.truth()
            command = flight.command(elapsed, vehicle.samples, truth)
            vehicle.command(command)
            if track:
                track.row(elapsed, truth, vehicle.samples[ODOMETRY], command)
        for watch in watches:
            watch(vehicle)
    events = vehicle.simulation.events.events()
    return flight.outcome(vehicle.time_ns / NS_PER_S, 0.0, events=events), digest(vehicle.simulation)


def progress_watch(planner: Planner, show: Callable[[str], None]) -> Watch:
    """Return a watch that calls `show` with the progress of the flight at intervals."""
    steps = 0

    def watch(vehicle: SimulatedVehicle) -> None:
        nonlocal steps
        steps += 1
        if steps % PROGRESS_STEPS == 0:
            show(f"{vehicle.time_ns / NS_PER_S:.1f} s, {planner.progress:.0%}")

    return watch


def digest(simulation: Simulation) -> str:
    """Return the exact true state of a simulation as text."""
    truth = simulation.truth()
    return " ".join(value.hex() for value in (*truth.position, *truth.orientation, *truth.nu))

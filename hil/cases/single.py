"""Run a case of one vehicle, in simulation or with a slave over the network."""

import os
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import hypot, nan
from random import Random
from typing import Any, NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.any_angle import plan_any_angle
from hil.autonomy.paths.astar import path_length
from hil.autonomy.paths.occupancy import Point
from hil.cases.case import Case
from hil.cases.energy import EnergyMeter
from hil.cases.process_group import ProcessGroup
from hil.cases.record import Mode, Result, Run, read_track
from hil.cases.simulated import SimulatedVehicle, fly, progress_watch
from hil.cases.viewer import Viewer
from hil.client.client import VehicleClient
from hil.client.delay import quantiles
from hil.common.errors import NetworkError
from hil.common.ports import free_ports
from hil.common.stop import StopSignals
from hil.master.flight import Flight, Outcome, Plan, prepare
from hil.master.mission import STOPPED, Mission
from hil.master.planner import Planner, topics_of
from hil.master.progress import Progress
from hil.master.recorder import TrackWriter
from hil.scenario.config import Scenario, load_scenario
from hil.scenario.variant import Table, write_variant
from hil.scenario.world_map import map_at
from sim.environment.world import World
from sim.sensors.samples import OdometrySample
from sim.vehicle.vehicle import Vehicle

START_SPREAD_M = 1.0
FINE_M = 0.1  # cells of the map for the shortest path
READY_S = 20.0  # until the slave has sent samples and diagnostics
WAIT_STEP_S = 0.02


def random_start(seed: str, heading: float, max_turn: float) -> dict[str, float]:
    """Return a start up to 1 m north and east of the origin, its heading (rad) within `max_turn` rad of `heading`."""
    random = Random(seed)
    return {
        "start.north": random.uniform(-START_SPREAD_M, START_SPREAD_M),
        "start.east": random.uniform(-START_SPREAD_M, START_SPREAD_M),
        "start.heading": heading + random.uniform(-max_turn, max_turn),
    }


class Measured(NamedTuple):
    """Measured values of a flight: outcome, energy (J), CPU (share of a core), delays (ms)."""

    outcome: Outcome
    energy: float
    master_cpu: float = nan
    delay_p50: float = nan
    delay_p99: float = nan


class SingleCase(Case):
    """Base of cases of one vehicle. Derived classes define what varies with the seed, and the shortest path."""

    @abstractmethod
    def vary(self, seed: int) -> tuple[Mapping[str, Any], Mapping[str, Sequence[Table]]]:
        """Return the changes of a seed: values by key of the scenario, and obstacles by kind to add to its world.

        Both are empty for seed 1.
        """

    @abstractmethod
    def optimum(self, scenario: Scenario, plan: Plan) -> float:
        """Return the length (m) of the shortest path that fulfils the case."""

    def extra(self, planner: Planner) -> Mapping[str, float]:
        """Return the results that only this case has."""
        return {}

    def fly(self, mode: Mode, seed: int, folder: str) -> Run:
        """Fly once, as `Case.fly` documents."""
        changes, world = self.vary(seed)
        listen = f"tcp/127.0.0.1:{free_ports(1)[0]}"
        file = write_variant(self.scenario, folder, {**changes, "seed": seed, "slave.listen": listen}, world)
        scenario = load_scenario(file)
        plan = prepare(scenario)
        path = plan.planner.track
        measured = (_simulate if mode == "sil" else _fly_slave)(scenario, plan, folder, self.show, self.viewer)
        track = read_track(folder, scenario.slave.node, path)
        return Run(self._result(mode, seed, scenario, plan, measured), (track,), file)

    def _result(self, mode: Mode, seed: int, scenario: Scenario, plan: Plan, measured: Measured) -> Result:
        outcome, vehicle = measured.outcome, plan.request.vehicle
        optimum = self.optimum(scenario, plan)
        touched = any(event.kind == "collision" for event in outcome.faults)
        collided = touched or outcome.least_clearance <= radius_of(vehicle)
        return Result(
            case=self.name,
            mode=mode,
            seed=seed,
            success=outcome.success and not collided,
            reason=outcome.verdict if touched or not collided else f"collision; {outcome.verdict}",
            duration=outcome.duration,
            path_length=outcome.travelled,
            optimum=optimum,
            ratio=outcome.travelled / optimum,
            least_clearance=outcome.least_clearance,
            collided=collided,
            energy=measured.energy,
            cross_track_rms=outcome.cross_track_rms,
            cross_track_max=outcome.cross_track_max,
            goal_error=outcome.goal_error,
            master_cpu=measured.master_cpu,
            planner_cpu=outcome.planner_cpu_s / outcome.duration,
            delay_p50=measured.delay_p50,
            delay_p99=measured.delay_p99,
            events=tuple([event.describe() for event in outcome.events]),
            extra=self.extra(plan.planner),
        )


def radius_of(vehicle: Vehicle) -> float:
    """Return the radius (m) of a vehicle's upright cylinder for collisions (sim/environment/collision.py)."""
    return hypot(*vehicle.dimensions[:2]) / 2


def shortest(world: World, vehicle: Vehicle, depth: float, waypoints: Sequence[Point]) -> float:
    """Return the length (m) of the shortest any-angle path through `waypoints` that the vehicle's size allows.

    It is computed on cells of 0.1 m, so it is too long by some parts in a thousand (hil/autonomy/paths/any_angle.py).
    """
    inflated = map_at(world, depth, 0.5 * vehicle.dimensions[2], FINE_M).inflate(radius_of(vehicle))
    return sum(path_length(plan_any_angle(inflated, a, b)) for a, b in pairwise(waypoints))


def _simulate(scenario: Scenario, plan: Plan, folder: str, show: Callable[[str], None], viewer: Viewer) -> Measured:
    """Fly in this process, in simulated time."""
    vehicle = SimulatedVehicle(scenario, plan.world)
    meter = EnergyMeter(plan.request.vehicle)
    with (
        viewer.show_simulated(scenario, {scenario.slave.node: vehicle}) as shown,
        _MeteredTrackWriter(folder, meter, lambda: (vehicle.pwm_us, vehicle.samples.get("battery"))) as track,
    ):
        outcome, _ = fly(scenario, plan, vehicle, [progress_watch(plan.planner, show), shown], track)
    return Measured(outcome, meter.joules)


def _fly_slave(scenario: Scenario, plan: Plan, folder: str, show: Callable[[str], None], viewer: Viewer) -> Measured:
    """Fly with a slave in another process; this process is its master."""
    meter = EnergyMeter(plan.request.vehicle)
    node, network = scenario.slave.node, scenario.network
    topics = *topics_of(plan.planner), "battery"
    progress = Progress(os.path.join(folder, "master.log"), show)
    with (
        viewer.show_slaves(scenario),
        StopSignals() as stop_fd,
        ProcessGroup({"slave1": ["slave", scenario.path]}, folder) as slaves,
        VehicleClient(scenario.slave.listen, node, network=network, topics=topics) as client,
        _MeteredTrackWriter(folder, meter, lambda: _telemetry(client)) as track,
    ):
        client.delays.store()
        _wait(slaves, client, folder)
        mission = Mission(Flight(scenario, plan), scenario.master.command_period, client, track, progress)
        outcome = mission.fly(stop_fd)
        delay = quantiles(client.delays.totals_ns())
    progress.close()
    if outcome.reason == STOPPED:
        raise KeyboardInterrupt
    return Measured(outcome, meter.joules, outcome.cpu_s / outcome.duration, delay.p50_ms, delay.p99_ms)


def _wait(slaves: ProcessGroup, client: VehicleClient, folder: str) -> None:
    """Wait until the vehicle has sent samples and diagnostics. Raises NetworkError if it does not."""
    deadline = time.monotonic() + READY_S
    while not (client.has_samples and client.diagnostics()):
        slaves.check()
        if time.monotonic() > deadline:
            raise NetworkError(f"a slave sent nothing for {READY_S:.0f} s; read its log in {folder}")
        time.sleep(WAIT_STEP_S)


def _telemetry(client: VehicleClient) -> tuple[Sequence[int], Any]:
    """Return the pulse widths that the slave last reported (once a second), and the newest battery sample."""
    battery = client.latest.get("battery")
    return client.diagnostics().pwm_us or (), battery and battery.value


class _MeteredTrackWriter(TrackWriter):
    """Writer of the track that also adds pulse widths and battery samples to the energy meter."""

    def __init__(self, folder: str, meter: EnergyMeter, telemetry: Callable[[], tuple[Sequence[int], Any]]) -> None:
        super().__init__(folder)
        self._meter = meter
        self._telemetry = telemetry

    def row(self, elapsed: float, truth: OdometrySample, odometry: OdometrySample, command: VelocityCommand) -> None:
        """Write one row, see `TrackWriter`, and add to the energy."""
        super().row(elapsed, truth, odometry, command)
        self._meter.add(elapsed, *self._telemetry())

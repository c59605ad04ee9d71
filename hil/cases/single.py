"""Run a case of one vehicle, in simulation or with a slave over the network."""

import os
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import hypot
from random import Random
from typing import Any

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.any_angle import plan_any_angle
from hil.autonomy.paths.astar import path_length
from hil.autonomy.paths.occupancy import Point
from hil.cases.case import Case
from hil.cases.energy import EnergyMeter
from hil.cases.process_group import ProcessGroup
from hil.cases.record import Mode, Result, Run, read_track
from hil.cases.simulated import SimulatedVehicle, fly, progress_watch
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


class SingleCase(Case):
    """Base of cases of one vehicle. Derived classes define what varies with the seed, and the places to visit."""

    headings = 0.0, 0.0

    def vary(self, seed: int) -> tuple[Mapping[str, Any], Mapping[str, Sequence[Table]]]:
        """Return the changes of a seed: values by key of the scenario, and obstacles by kind to add to its world.

        They are a start up to 1 m from the origin, with a heading (rad) about the first of `headings`, by up to the
        second; nothing for seed 1.
        """
        if seed == 1:
            return {}, {}
        random, (heading, max_turn) = Random(f"{self.scenario}/{seed}"), self.headings
        return {
            "start.north": random.uniform(-START_SPREAD_M, START_SPREAD_M),
            "start.east": random.uniform(-START_SPREAD_M, START_SPREAD_M),
            "start.heading": heading + random.uniform(-max_turn, max_turn),
        }, {}

    @abstractmethod
    def routes(self, scenario: Scenario, plan: Plan) -> list[list[Point]]:
        """Return the places behind the start that fulfil the case, in each permitted order."""

    def draw(self, runs: Sequence[Run], path: str) -> None:
        """Draw figures 8 and 10, the tracks on the map, and figure 9, speed over time."""
        from hil.cases.pictures import draw_field

        draw_field(self.about["title"], runs, path)

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
        outcome, figures = (self._simulate if mode == "sil" else self._fly_slave)(scenario, plan, folder)
        track = read_track(folder, scenario.slave.node, path)
        return Run(self._result(mode, seed, scenario, plan, outcome, figures), (track,), file)

    def _result(
        self, mode: Mode, seed: int, scenario: Scenario, plan: Plan, outcome: Outcome, figures: Mapping[str, float]
    ) -> Result:
        vehicle, start = plan.request.vehicle, (scenario.start.north, scenario.start.east)
        routes = [[start, *places] for places in self.routes(scenario, plan)]
        optimum = min(shortest(plan.world, vehicle, scenario.master.depth, route) for route in routes)
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
            cross_track_rms=outcome.cross_track_rms,
            cross_track_max=outcome.cross_track_max,
            goal_error=outcome.goal_error,
            planner_cpu=outcome.planner_cpu_s / outcome.duration,
            events=tuple([event.describe() for event in outcome.events]),
            extra=self.extra(plan.planner),
            **figures,
        )

    def _simulate(self, scenario: Scenario, plan: Plan, folder: str) -> tuple[Outcome, dict[str, float]]:
        """Fly in this process, in simulated time."""
        vehicle = SimulatedVehicle(scenario, plan.world)
        meter = EnergyMeter(plan.request.vehicle)
        with (
            self.viewer.show_simulated(scenario, {scenario.slave.node: vehicle}) as shown,
            _MeteredTrackWriter(folder, meter, lambda: (vehicle.pwm_us, vehicle.samples.get("battery"))) as track,
        ):
            outcome, _ = fly(scenario, plan, vehicle, [progress_watch(plan.planner, self.show), shown], track)
        return outcome, {"energy": meter.joules}

    def _fly_slave(self, scenario: Scenario, plan: Plan, folder: str) -> tuple[Outcome, dict[str, float]]:
        """Fly with a slave in another process; this process is its master."""
        meter = EnergyMeter(plan.request.vehicle)
        node, network = scenario.slave.node, scenario.network
        topics = *topics_of(plan.planner), "battery"
        progress = Progress(os.path.join(folder, "master.log"), self.show)
        with (
            self.viewer.show_slaves(scenario),
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
        return outcome, {
            "energy": meter.joules,
            "master_cpu": outcome.cpu_s / outcome.duration,
            "delay_p50": delay.p50_ms,
            "delay_p99": delay.p99_ms,
        }


def radius_of(vehicle: Vehicle) -> float:
    """Return the radius (m) of a vehicle's upright cylinder for collisions (sim/environment/collision.py)."""
    return hypot(*vehicle.dimensions[:2]) / 2


def shortest(world: World, vehicle: Vehicle, depth: float, waypoints: Sequence[Point]) -> float:
    """Return the length (m) of the shortest any-angle path through `waypoints` that the vehicle's size allows.

    It is computed on cells of 0.1 m, so it is too long by some parts in a thousand (hil/autonomy/paths/any_angle.py).
    """
    inflated = map_at(world, depth, 0.5 * vehicle.dimensions[2], FINE_M).inflate(radius_of(vehicle))
    return sum(path_length(plan_any_angle(inflated, a, b)) for a, b in pairwise(waypoints))


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

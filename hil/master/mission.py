"""The planner process: a map, a way through it, and the vehicle along that way."""

import select
import time
from typing import NamedTuple

from hil.autonomy.astar import path_length, plan, smooth
from hil.autonomy.control import HoldGains, Navigation, VelocityCommand, heading_of, heave_for_depth
from hil.autonomy.occupancy import Extent, OccupancyGrid
from hil.autonomy.pursuit import PurePursuit
from hil.clock import NS_PER_S, RateKeeper, now_ns, seconds_ns
from hil.config import Scenario
from hil.errors import MissionError, NetworkError
from hil.master.client import VehicleClient
from hil.master.progress import Progress
from hil.master.recorder import Recorder
from sim.vehicle import Vehicle, load_vehicle
from sim.world import World, load_world

DEPTH_HOLD = HoldGains(p=0.8, limit=0.4)
GONE_AFTER_S = 1.0
GIVE_UP_AFTER_S = 10.0

Point = tuple[float, float]


class Plan(NamedTuple):
    """The map the planner used, the way it found (north, east in m), and what finding it took (s)."""

    grid: OccupancyGrid
    path: list[Point]
    clearance: float
    duration: float


class Outcome(NamedTuple):
    """How a mission ended; times in s, lengths in m, `cpu_s` processor time of the master while flying."""

    reached: bool
    reason: str
    duration: float
    path_length: float
    travelled: float
    goal_error: float
    cross_track_max: float
    least_clearance: float
    cpu_s: float


def make_plan(scenario: Scenario, vehicle: Vehicle, world: World) -> Plan:
    """A* on the raster map of the world, obstacles inflated by the vehicle's size. Raises MissionError."""
    began = time.monotonic()
    master = scenario.master
    length, width = vehicle.dimensions[:2]
    clearance = (length**2 + width**2) ** 0.5 / 2 + master.margin
    south, north, west, east = world.extent
    grid = OccupancyGrid.rasterise(
        lambda n, e: world.clearance(n, e, master.depth), Extent(south, west, north, east), master.resolution
    )
    start = (scenario.start.north, scenario.start.east)
    inflated = grid.inflate(clearance)
    path = smooth(inflated, plan(inflated, start, master.goal))
    return Plan(grid, path, clearance, time.monotonic() - began)


class Mission:
    """Flies one plan with one vehicle."""

    def __init__(
        self, scenario: Scenario, plan: Plan, client: VehicleClient, recorder: Recorder, progress: Progress
    ) -> None:
        self._master = scenario.master
        self._plan = plan
        self._client = client
        self._recorder = recorder
        self._progress = progress
        self._world = load_world(scenario.world)
        self._pursuit = PurePursuit(
            plan.path, lookahead=self._master.lookahead, speed=self._master.speed, tolerance=self._master.tolerance
        )
        self._travelled = 0.0
        self._cross_track_max = 0.0
        self._least_clearance = float("inf")
        self._last: Point | None = None

    def fly(self, stop_fd: int) -> Outcome:
        """Fly until the goal, the time limit or a stop signal. Raises NetworkError when the vehicle stays away."""
        began, cpu_began = now_ns(), time.process_time()
        schedule = RateKeeper(seconds_ns(self._master.command_period), began)
        reason = ""
        while not reason:
            wait = max(schedule.deadline_ns - now_ns(), 0) / NS_PER_S
            if select.select((stop_fd,), (), (), wait)[0]:
                reason = "stopped by the user"
            elif schedule.due(now_ns()):
                elapsed = (now_ns() - began) / NS_PER_S
                reason = self._tick(elapsed)
        self._client.command(VelocityCommand())
        return self._outcome(reason, (now_ns() - began) / NS_PER_S, time.process_time() - cpu_began)

    def _tick(self, elapsed: float) -> str:
        """One command; why the mission ends, or "" to go on."""
        odometry, truth = self._client.latest.get("odom"), self._client.latest.get("ground_truth")
        if odometry is None or truth is None:
            return ""
        if odometry.age_s > GIVE_UP_AFTER_S:
            raise NetworkError(
                f"{self._client.node} at {self._client.endpoint} is gone for {odometry.age_s:.0f} s; "
                "look at the slave and at the network between"
            )
        if odometry.age_s > GONE_AFTER_S:
            self._progress.note(f"no word from the vehicle for {odometry.age_s:.1f} s, waiting for it")
            return ""
        north, east, depth = odometry.value.position
        command = self._pursuit.update((north, east), heading_of(odometry.value.orientation))
        orientation, nu = odometry.value.orientation, odometry.value.nu
        navigation = Navigation(orientation, nu[3:], nu[:3], depth)
        self._client.command(command._replace(heave=heave_for_depth(self._master.depth, navigation, DEPTH_HOLD)))
        self._measure(truth.value.position[:2])
        self._recorder.row(elapsed, truth.value, odometry.value, command)
        self._progress.show(elapsed, truth.value, self._pursuit.progress, self._client)
        if self._pursuit.done:
            return "goal reached"
        return "time limit" if elapsed > self._master.time_limit else ""

    def _measure(self, position: Point) -> None:
        north, east = position
        if self._last:
            self._travelled += ((north - self._last[0]) ** 2 + (east - self._last[1]) ** 2) ** 0.5
        self._last = (north, east)
        self._cross_track_max = max(self._cross_track_max, abs(self._pursuit.cross_track))
        self._least_clearance = min(self._least_clearance, self._world.clearance(north, east))

    def _outcome(self, reason: str, duration: float, cpu_s: float) -> Outcome:
        goal = self._master.goal
        error = float("nan")
        if self._last:
            error = ((goal[0] - self._last[0]) ** 2 + (goal[1] - self._last[1]) ** 2) ** 0.5
        return Outcome(
            self._pursuit.done,
            reason,
            duration,
            path_length(self._plan.path),
            self._travelled,
            error,
            self._cross_track_max,
            self._least_clearance,
            cpu_s,
        )


def prepare(scenario: Scenario) -> Plan:
    """Read the scenario's vehicle and world, and plan. Raises ConfigError, MissionError."""
    vehicle, _ = load_vehicle(scenario.vehicle)
    return make_plan(scenario, vehicle, load_world(scenario.world))


def require_success(outcome: Outcome) -> None:
    """Raise MissionError unless the goal was reached."""
    if not outcome.reached:
        raise MissionError(f"{outcome.reason} after {outcome.duration:.1f} s, {outcome.goal_error:.1f} m from the goal")

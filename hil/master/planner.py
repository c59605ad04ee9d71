"""The planner: a map, a way through it, a command for every position. No I/O; time is the caller's."""

import time
from typing import NamedTuple

from hil.autonomy.astar import path_length, plan, smooth
from hil.autonomy.control import HoldGains, Navigation, VelocityCommand, heading_of, heave_for_depth
from hil.autonomy.occupancy import Extent, OccupancyGrid
from hil.autonomy.pursuit import PurePursuit
from hil.config import Scenario
from hil.errors import MissionError
from sim.sensors.samples import OdometrySample
from sim.vehicle import Vehicle, load_vehicle
from sim.world import World, load_world

DEPTH_HOLD = HoldGains(p=0.8, limit=0.4)

Point = tuple[float, float]


class Plan(NamedTuple):
    """The map the planner made of the world, the way it found (north, east in m), and what finding it took (s)."""

    world: World
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
    return Plan(world, grid, path, clearance, time.monotonic() - began)


class Navigator:
    """Leads a vehicle along a plan, and keeps account of how it went."""

    def __init__(self, scenario: Scenario, plan: Plan) -> None:
        self._master = scenario.master
        self._plan = plan
        self._world = plan.world
        self._pursuit = PurePursuit(
            plan.path, lookahead=self._master.lookahead, speed=self._master.speed, tolerance=self._master.tolerance
        )
        self._travelled = 0.0
        self._cross_track_max = 0.0
        self._least_clearance = float("inf")
        self._last: Point | None = None

    @property
    def progress(self) -> float:
        """The share of the path that lies behind, 0 to 1."""
        return self._pursuit.progress

    def command(self, odometry: OdometrySample) -> VelocityCommand:
        """What to ask of the vehicle where its navigation says it is."""
        north, east, depth = odometry.position
        command = self._pursuit.update((north, east), heading_of(odometry.orientation))
        navigation = Navigation(odometry.orientation, odometry.nu[3:], odometry.nu[:3], depth)
        return command._replace(heave=heave_for_depth(self._master.depth, navigation, DEPTH_HOLD))

    def judge(self, elapsed: float, truth: OdometrySample) -> str:
        """Take account of where the vehicle truly is after `elapsed` s; why the mission ends, or "" to go on."""
        north, east, depth = truth.position
        if self._last:
            self._travelled += ((north - self._last[0]) ** 2 + (east - self._last[1]) ** 2) ** 0.5
        self._last = (north, east)
        self._cross_track_max = max(self._cross_track_max, abs(self._pursuit.cross_track))
        self._least_clearance = min(self._least_clearance, self._world.clearance(north, east, depth))
        if self._pursuit.done:
            return "goal reached"
        return "time limit" if elapsed > self._master.time_limit else ""

    def outcome(self, reason: str, duration: float, cpu_s: float) -> Outcome:
        """The account of a mission that took `duration` s and `cpu_s` s of the planner's processor."""
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

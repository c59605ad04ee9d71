"""One planner leading one vehicle, in the simulation or over the network, and the account of how it went."""

import time
from collections.abc import Sequence
from itertools import pairwise
from math import dist, hypot, inf, isfinite, nan
from typing import NamedTuple

from hil.autonomy.astar import path_length
from hil.autonomy.control import HoldGains, Navigation, VelocityCommand, clamp, heading_of, heave_for_depth, wrap
from hil.config import Scenario
from hil.errors import MissionError
from hil.master.follow import Follow
from hil.master.planner import Brief, Done, Planner, Point, Samples
from hil.master.world_map import known_map
from hil.topics import ALL
from sim.sensors.samples import OdometrySample
from sim.vehicle import Vehicle, load_vehicle
from sim.world import World, load_world

DEPTH_HOLD = HoldGains(p=0.8, limit=0.4)
RELIEF_WITHIN_M = 50.0
HEADING_HOLD = HoldGains(p=1.0, limit=0.5)


class Plan(NamedTuple):
    """A planner that is ready to go, what it was told, the world as it is, and what getting ready took (s)."""

    planner: Planner
    brief: Brief
    world: World
    duration: float


class Outcome(NamedTuple):
    """How a mission ended; times in s, lengths in m.

    `cpu_s` is processor time of the whole master while flying, `planner_cpu_s` that of the planner alone. `path_length`
    is that of the planner's first path, `cross_track_max` and `cross_track_rms` tell how far the vehicle truly was from
    the path it was on, `least_clearance` how near its middle came, on the level, to an obstacle or to ground that its
    lower end would touch. What does not apply is nan.
    """

    reached: bool
    reason: str
    duration: float
    path_length: float
    travelled: float
    goal_error: float
    cross_track_max: float
    least_clearance: float
    cpu_s: float
    cross_track_rms: float = nan
    planner_cpu_s: float = nan

    @property
    def summary(self) -> str:
        """How far it went and how well it kept to its path, in words, without what does not apply."""
        told = (
            (self.travelled, "{:.1f} m travelled"),
            (self.path_length, "on a path of {:.1f} m"),
            (self.goal_error, "{:.2f} m from the goal"),
            (self.cross_track_max, "at most {:.2f} m off the path"),
            (self.least_clearance, "at least {:.2f} m from every obstacle"),
        )
        return ", ".join(words.format(value) for value, words in told if isfinite(value))


def prepare(scenario: Scenario, world: World | None = None) -> Plan:
    """Read the scenario's vehicle, world and planner, and let it plan. Raises ConfigError, MissionError.

    `world` is the scenario's, read here if left out.
    """
    began = time.monotonic()
    world = world or load_world(scenario.world)
    vehicle, _ = load_vehicle(scenario.vehicle)
    planner = make_planner(scenario)
    brief = make_brief(scenario, vehicle, world)
    planner.begin(brief)
    return Plan(planner, brief, world, time.monotonic() - began)


def make_planner(scenario: Scenario) -> Planner:
    """The planner that the scenario names, or the default. Raises ConfigError."""
    if not scenario.planner:
        return Follow()
    from hil.plugins import load_class

    planner: Planner = load_class(dict(scenario.planner), Planner, f"{scenario.path}: planner")
    return planner


def make_brief(scenario: Scenario, vehicle: Vehicle, world: World) -> Brief:
    """What the scenario's planner is told. Raises ConfigError."""
    length, width = vehicle.dimensions[:2]
    clearance = hypot(length, width) / 2 + scenario.master.margin
    grid = known_map(scenario.master, vehicle, world)
    return Brief(scenario.slave.node, vehicle, scenario.start, scenario.master, grid, clearance)


class Flight:
    """Asks the planner for commands, holds depth and heading for it, and keeps account.

    `reason` is why the flight is over, "" while it goes on.
    """

    def __init__(self, scenario: Scenario, plan: Plan) -> None:
        self.planner = plan.planner
        self.reason = ""
        self._master = scenario.master
        self._world = plan.world
        self._below = 0.5 * plan.brief.vehicle.dimensions[2]
        self._first_path = path_length(plan.planner.path)
        self._reached = False
        self._travelled = 0.0
        self._planner_cpu_s = 0.0
        self._off_track = _Spread()
        self._least_clearance = inf
        self._last: Point | None = None

    def command(self, elapsed: float, samples: Samples, truth: OdometrySample) -> VelocityCommand:
        """The command `elapsed` s after the start; only velocities in it. `truth` is for the account alone."""
        began = time.thread_time()
        answer = self.planner.command(elapsed, self._listened(samples))
        self._planner_cpu_s += time.thread_time() - began
        if isinstance(answer, Done):
            self.reason, self._reached = answer.reason, answer.reached
            answer = VelocityCommand()
        self._note(truth)
        if not self.reason and elapsed > self._master.time_limit:
            self.reason = "time limit"
        return held(answer, samples["odom"])

    def outcome(self, duration: float, cpu_s: float, reason: str = "") -> Outcome:
        """The account of a flight of `duration` s and `cpu_s` s of processor; `reason` if it did not end by itself."""
        goal = self._master.goal
        return Outcome(
            self._reached,
            self.reason or reason,
            duration,
            self._first_path or nan,
            self._travelled,
            dist(goal, self._last) if goal and self._last else nan,
            self._off_track.most,
            self._least_clearance,
            cpu_s,
            self._off_track.rms,
            self._planner_cpu_s,
        )

    def _listened(self, samples: Samples) -> Samples:
        """What the planner listens to: with a simulator in the same process there may be more."""
        listens = self.planner.listens
        if ALL in listens:
            return samples
        return {topic: sample for topic, sample in samples.items() if topic == "odom" or topic in listens}

    def _note(self, truth: OdometrySample) -> None:
        north, east, depth = truth.position
        here = north, east
        self._travelled += dist(here, self._last or here)
        self._last = here
        if len(self.planner.path) > 1:
            self._off_track.add(distance_to_path(here, self.planner.path))
        least, deep = self._least_clearance, depth + self._below
        self._least_clearance = min(least, self._world.clearance(north, east, deep, min(least, RELIEF_WITHIN_M)))


class _Spread:
    """The greatest and the root mean square of some values; 0 and nan of none."""

    def __init__(self) -> None:
        self.most = 0.0
        self._sum, self._count = 0.0, 0

    def add(self, value: float) -> None:
        self.most = max(self.most, value)
        self._sum += value * value
        self._count += 1

    @property
    def rms(self) -> float:
        return (self._sum / self._count) ** 0.5 if self._count else nan


def held(command: VelocityCommand, odometry: OdometrySample) -> VelocityCommand:
    """`command` with the velocities that lead to its depth (m) and heading (rad), where it asks for them."""
    _, _, depth = odometry.position
    if command.depth is not None:
        navigation = Navigation(odometry.orientation, odometry.nu[3:], odometry.nu[:3], depth)
        command = command._replace(heave=heave_for_depth(command.depth, navigation, DEPTH_HOLD), depth=None)
    if command.heading is not None:
        error = wrap(command.heading - heading_of(odometry.orientation))
        turn = clamp(command.yaw_rate + HEADING_HOLD.p * error, HEADING_HOLD.limit)
        command = command._replace(yaw_rate=turn, heading=None)
    return command


def distance_to_path(point: Point, path: Sequence[Point]) -> float:
    """How far (m) a point is from a path of two points or more."""
    return min(_distance_to_leg(point, *leg) for leg in pairwise(path))


def _distance_to_leg(point: Point, start: Point, end: Point) -> float:
    north, east = end[0] - start[0], end[1] - start[1]
    square = north * north + east * east
    along = ((point[0] - start[0]) * north + (point[1] - start[1]) * east) / square if square else 0.0
    share = min(max(along, 0.0), 1.0)
    return dist(point, (start[0] + share * north, start[1] + share * east))


def require_success(outcome: Outcome) -> None:
    """Raise MissionError unless the planner reached what it was asked for."""
    if not outcome.reached:
        where = "" if outcome.goal_error != outcome.goal_error else f", {outcome.goal_error:.1f} m from the goal"
        raise MissionError(f"{outcome.reason} after {outcome.duration:.1f} s{where}")

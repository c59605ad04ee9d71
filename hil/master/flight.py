"""Run one planner with one vehicle, simulated or over the network, and evaluate the run."""

import time
from collections.abc import Sequence
from itertools import pairwise
from math import dist, hypot, inf, isfinite, nan
from typing import Any, NamedTuple

from hil.autonomy.control.controller import (
    HoldGains,
    Navigation,
    VelocityCommand,
    clamp,
    heading_of,
    heave_for_depth,
    wrap,
)
from hil.autonomy.paths.astar import path_length
from hil.autonomy.paths.curves import Position
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.autonomy.paths.trajectory import Limits
from hil.common.clock import NS_PER_S, seconds_ns
from hil.common.errors import MissionError, NoPathError
from hil.common.schema import shortened
from hil.common.vectors import off_line
from hil.master.follow import Follow
from hil.master.guidance import guide_by_fins
from hil.master.planner import Done, Planner, PlanRequest, Point, ReceivedSamples, Samples, topics_of
from hil.ros.topics import ALL
from hil.scenario.config import Scenario
from hil.scenario.map_parts import MapPart
from hil.scenario.world_map import known_map, parts_of
from sim.environment.world import World, load_world
from sim.run_events import EventKind, EventLog, RunEvent, RunMonitor, merge_events
from sim.sensors.samples import OdometrySample
from sim.vehicle.vehicle import Vehicle, load_vehicle

DEPTH_HOLD = HoldGains(p=0.8, limit=0.4)
RELIEF_WITHIN_M = 50.0
HEADING_HOLD = HoldGains(p=1.0, limit=0.5)
MAX_NAMED = 3  # events in one line


class Plan(NamedTuple):
    """A planner that is ready to run, its request, the world, and the time that planning took (s)."""

    planner: Planner
    request: PlanRequest
    world: World
    duration: float


class Outcome(NamedTuple):
    """Result of a mission; times in s, lengths in m. A value that does not apply is nan.

    `cpu_s` is the processor time of the whole master during the flight, `planner_cpu_s` that of the planner alone.
    `path_length` is the length of the planner's first path. `cross_track_max` and `cross_track_rms` are the true
    distances of the vehicle from its path. `least_clearance` is the least horizontal distance of its centre from an
    obstacle, or from ground that its lower end would touch. `reached` is what the planner returned. `events` (times
    from the start) are the problems of the run; events of the kinds in `allow` were expected.
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
    events: tuple[RunEvent, ...] = ()
    allow: tuple[EventKind, ...] = ()

    @property
    def faults(self) -> tuple[RunEvent, ...]:
        """Events that the scenario does not allow."""
        return tuple([event for event in self.events if event.kind not in self.allow])

    @property
    def success(self) -> bool:
        """True if the planner reached its goal and all events were allowed."""
        return self.reached and not self.faults

    @property
    def verdict(self) -> str:
        """Reason why the run ended, with the kinds of events that were not allowed."""
        names = list(dict.fromkeys(event.name for event in self.faults))
        more = [f"{len(names) - MAX_NAMED} more"] if len(names) > MAX_NAMED else []
        return f"{self.reason}, but {', '.join([*names[:MAX_NAMED], *more])}" if names else self.reason

    def as_plain(self) -> dict[str, Any]:
        """Return the outcome as plain values: whether it was a success, and each event as a table, times in s."""
        events = [
            {
                "kind": event.kind,
                "what": event.what,
                "start_s": event.start_ns / NS_PER_S,
                "duration_s": event.duration_ns / NS_PER_S,
                "place": event.position,
            }
            for event in self.events
        ]
        return self._asdict() | {"success": self.success, "events": events}

    @property
    def event_lines(self) -> list[str]:
        """A line of text for each event: kind, time, duration and place."""
        return [f"{'expected' if event.kind in self.allow else 'EVENT'}: {event.describe()}" for event in self.events]

    @property
    def summary(self) -> str:
        """Distances and deviations from the path as text, without values that do not apply."""
        reason = (
            (self.travelled, "{:.1f} m travelled"),
            (self.path_length, "on a path of {:.1f} m"),
            (self.goal_error, "{:.2f} m from the goal"),
            (self.cross_track_max, "at most {:.2f} m off the path"),
            (self.least_clearance, "its middle at least {:.2f} m from every obstacle"),
        )
        return ", ".join(words.format(value) for value, words in reason if isfinite(value))


def prepare(scenario: Scenario, world: World | None = None) -> Plan:
    """Read the scenario's vehicle, world and planner, and let the planner plan. Raises ConfigError, MissionError.

    `world` is the scenario's world, if the caller has loaded it already.
    """
    began = time.monotonic()
    world = world or load_world(scenario.world)
    vehicle, _ = load_vehicle(scenario.vehicle)
    planner, request = _begin(scenario, vehicle, world)
    return Plan(planner, request, world, time.monotonic() - began)


def _begin(scenario: Scenario, vehicle: Vehicle, world: World) -> tuple[Planner, PlanRequest]:
    """Return the planner after its `begin`, and the request. If no path is found, larger parts of the map are tried."""
    planner = make_planner(scenario)
    topics_of(planner)  # raises ConfigError for an unknown topic
    parts = parts_of(world, scenario.master, scenario.start, planner.destinations)
    failed: MissionError | None = None
    for area in parts:
        is_coarse = area.resolution > scenario.master.resolution
        request = make_request(scenario, vehicle, world, area)
        try:
            planner.begin(request)
            return planner, request
        except NoPathError as error:  # a larger part of the map may show a path
            failed = error
        except MissionError as error:
            if not is_coarse:
                raise
            failed = failed or error  # start or goal is too close to an obstacle for cells of that size
        planner = make_planner(scenario)
    assert failed is not None
    if len(parts) == 1 and not is_coarse:
        raise failed
    size = f"{area.extent.north - area.extent.south:.0f} m x {area.extent.east - area.extent.west:.0f} m"
    raise type(failed)(f"{failed}; the largest map shows {size} in cells of {area.resolution:g} m") from None


def make_planner(scenario: Scenario) -> Planner:
    """Return the planner that the scenario names, or the default. Raises ConfigError."""
    if not scenario.planner:
        return Follow()
    from hil.common.plugins import load_class

    planner: Planner = load_class(dict(scenario.planner), Planner, f"{scenario.path}: planner", "planners")
    return planner


def make_request(scenario: Scenario, vehicle: Vehicle, world: World, map_part: MapPart | None = None) -> PlanRequest:
    """Return the request for the scenario's planner, with the map of a `map_part` of the world. Raises ConfigError.

    Without `map_part`, the map shows the first part that `parts_of` returns.
    """
    master, limits = guide_by_fins(scenario, vehicle, world) if vehicle.fins else (scenario.master, Limits())
    reach = hypot(*vehicle.dimensions[:2]) / 2
    start, part = scenario.start, map_part or parts_of(world, master, scenario.start)[0]
    depth = start.depth if master.waypoint or vehicle.fins else master.depth  # others dive at once
    course = [(start.north, start.east, depth), *master.places()]

    def map_along(course: Sequence[Position]) -> OccupancyGrid:
        grid = known_map(master, vehicle, world, part, course)
        grid.is_open = not world.walls and world.terrain is None
        return grid

    grid, least, ends = map_along(course if master.goal else ()), scenario.master.margin, [one[:2] for one in course]
    while master.margin > least and not all(map(grid.inflate(reach + master.margin).is_free, ends)):
        master = master._replace(margin=max(0.5 * master.margin, least))  # a derived one gives way to start and goal
    clearance = reach + master.margin
    return PlanRequest(scenario.slave.node, vehicle, start, master, grid, clearance, course, map_along, limits)


class Flight:
    """Get commands from the planner, hold depth and heading for it, and evaluate the run.

    `reason` tells why the flight is over; "" while it continues. `log` has the events that can be detected from the
    vehicle's motion and link (sim/run_events.py), with times from the start.
    """

    def __init__(self, scenario: Scenario, plan: Plan) -> None:
        self.planner = plan.planner
        self.depth = scenario.master.depth
        self.reason = ""
        self._master = scenario.master
        self._world = plan.world
        self._below = 0.5 * plan.request.vehicle.dimensions[2]
        self._first_path = path_length(plan.planner.path)
        self._reached = False
        self._travelled = 0.0
        self._planner_cpu_s = 0.0
        self._off_track = _Spread()
        self._least_clearance = inf
        self._position: Sequence[float] = (scenario.start.north, scenario.start.east, scenario.start.depth)
        self._last: Point | None = None
        self.log = EventLog()
        vehicle = plan.request.vehicle
        self._monitor = RunMonitor(self.log, vehicle.capsize_tilt, self._below, self._master.depth_margin)

    def command(self, elapsed: float, samples: Samples, truth: OdometrySample) -> VelocityCommand:
        """Return the command, only velocities, `elapsed` s after the start. `truth` serves only to evaluate the run."""
        began = time.thread_time()
        command = self.planner.command(elapsed, self._subscribed(samples))
        self._planner_cpu_s += time.thread_time() - began
        if isinstance(command, Done):
            self.reason, self._reached = command.reason, command.reached
            command = VelocityCommand()
        if not _is_command(command):
            name = f"{type(self.planner).__module__}:{type(self.planner).__qualname__}"
            raise MissionError(
                f"planner {name}: command() returned {shortened(str(command))} {elapsed:.1f} s after the start: "
                "it returns a VelocityCommand of finite numbers, or Done"
            )
        self._add_truth(truth)
        self._monitor.observe(seconds_ns(elapsed), truth.position, truth.orientation, command.depth)
        if not self.reason and elapsed > self._master.time_limit:
            self.reason = "time limit"
        return held(command, samples["odom"])

    def lose_link(self, since: float, until: float, what: str) -> None:
        """Add an event: no odometry from `since` to `until` (s after the start)."""
        self.log.record("link_lost", seconds_ns(since), seconds_ns(until), self._position, what)

    def outcome(self, duration: float, cpu_s: float, reason: str = "", events: Sequence[RunEvent] = ()) -> Outcome:
        """Return the result of a flight of `duration` s and `cpu_s` s of processor time.

        `reason` tells why it was ended, if the planner did not end it. `events` are those that the vehicle itself
        reported, with times from the start.
        """
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
            merge_events(events, self.log.events()),
            self._master.allow,
        )

    def _subscribed(self, samples: Samples) -> Samples:
        """Return the samples of the planner's subscriptions: a simulator in the same process may give more."""
        wanted = ("odom", *self.planner.subscriptions)
        return ReceivedSamples({topic: samples[topic] for topic in samples if ALL in wanted or topic in wanted})

    def _add_truth(self, truth: OdometrySample) -> None:
        self._position = north, east, depth = truth.position
        point = north, east
        self._travelled += dist(point, self._last or point)
        self._last = point
        if len(self.planner.path) > 1:
            self._off_track.add(distance_to_path(point, self.planner.path))
        least, deep = self._least_clearance, depth + self._below
        clearance = self._world.clearance(north, east, deep, min(least, RELIEF_WITHIN_M), 2.0 * self._below)
        self._least_clearance = min(least, clearance)


class _Spread:
    """The maximum and the root mean square of values; nan if there are none."""

    def __init__(self) -> None:
        self.most = nan
        self._sum, self._count = 0.0, 0

    def add(self, value: float) -> None:
        self.most = max(value, self.most)  # in this order max() replaces nan
        self._sum += value * value
        self._count += 1

    @property
    def rms(self) -> float:
        return (self._sum / self._count) ** 0.5 if self._count else nan


def held(command: VelocityCommand, odometry: OdometrySample) -> VelocityCommand:
    """Return `command` with its depth (m) and heading (rad), if any, replaced by the velocities that hold them."""
    _, _, depth = odometry.position
    if command.depth is not None:
        navigation = Navigation(odometry.orientation, odometry.nu[3:], odometry.nu[:3], depth)
        command = command._replace(heave=heave_for_depth(command.depth, navigation, DEPTH_HOLD), depth=None)
    if command.heading is not None:
        error = wrap(command.heading - heading_of(odometry.orientation))
        turn = clamp(command.yaw_rate + HEADING_HOLD.p * error, HEADING_HOLD.limit)
        command = command._replace(yaw_rate=turn, heading=None)
    return command


def distance_to_path(point: Point, path: Sequence[Sequence[float]]) -> float:
    """Return the distance (m) of a point from a path of at least two points."""
    return min(hypot(*off_line(*point, *start[:2], *end[:2])) for start, end in pairwise(path))


def require_success(outcome: Outcome) -> None:
    """Raise MissionError unless the planner reached its goal and all events were allowed."""
    where = "" if outcome.goal_error != outcome.goal_error else f", {outcome.goal_error:.1f} m from the goal"
    ended = f"{outcome.reason} after {outcome.duration:.1f} s{where}"
    if outcome.faults:
        first, *others = outcome.faults
        more = f", and {len(others)} more" if others else ""
        raise MissionError(
            f"{ended}, but {first.describe()}{more}; if that is to be, name {first.kind!r} in [master] allow"
        )
    if not outcome.reached:
        raise MissionError(ended)


def _is_command(value: object) -> bool:
    """Return whether `value` is a VelocityCommand of finite numbers; a user's own planner may return anything."""
    if not isinstance(value, VelocityCommand):
        return False
    try:
        return all(number is None or isfinite(number) for number in value)
    except TypeError:  # a text, an array
        return False

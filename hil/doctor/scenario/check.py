"""Check a scenario without running it: the content of its files, and errors when it starts."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from math import ceil, dist, hypot

from hil.autonomy.paths.astar import path_length
from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.common.endpoint import split_endpoint
from hil.common.errors import ConfigError, MissingExtraError, MissionError, StartPositionError
from hil.doctor.scenario.guidance import check_guidance, check_places
from hil.doctor.scenario.sections import check_sections
from hil.doctor.vehicle.finding import Finding, problem, warning
from hil.doctor.vehicle.rules import CONTROLLED, check_vehicle
from hil.doctor.vehicle.subject import Subject
from hil.master.flight import DEPTH_HOLD, Plan, prepare
from hil.master.hunt import HuntPlanner
from hil.master.planner import Planner
from hil.scenario.attitude_warning import attitude_warning, requested_speed
from hil.scenario.config import AUTOPILOTS, Scenario, build_simulation
from hil.scenario.fleet import as_member
from hil.slave.drivers.ends import check_line_rate, end_protocol
from sim.environment.world import World, load_world
from sim.vehicle.vehicle import Vehicle, load_vehicle

SCANS = ("laser", "scanning_sonar")  # a planner that needs one of these topics does not move without it

# The subject of a MissionError -> the key that causes it.
KEYS = {"goal": "master: goal: ", "start": "start: ", "path": "master: margin: ", "waypoint": "master: "}


def check_scenario(scenario: Scenario) -> Iterator[Finding]:
    """Yield the problems that a flight of a loaded scenario would have; nothing if there are none.

    Raises ConfigError if the vehicle's or the world's file is invalid.
    """
    for level, text in _check(scenario):
        yield Finding(level, text if scenario.path in text else f"{scenario.path}: {text}")


def _check(scenario: Scenario) -> Iterator[Finding]:
    if scenario.member and not scenario.hunting:
        yield from _check_members(scenario)
        return
    vehicle, control = load_vehicle(scenario.vehicle)
    world = load_world(scenario.world)
    speed = None if vehicle.fins else requested_speed(scenario)[1]
    subject = Subject(vehicle, control, world.density, world.gravity, scenario.vehicle, speed)
    yield from _check_vehicle(scenario, subject)
    surge = subject.capabilities[0]
    top_speed = surge.speed[0] if surge.driven else 0.0
    attitude = attitude_warning(scenario, vehicle)
    if attitude:
        yield warning(attitude)
    else:
        yield from _check_speed(scenario, vehicle, top_speed)
    yield from _check_current(world, vehicle, top_speed)
    yield from _check_periods(scenario)
    yield from _check_event_times(scenario)
    yield from _check_mavlink(scenario)
    yield from check_sections(scenario, vehicle)
    if scenario.controller == "builtin":
        yield from _check_link(scenario, vehicle)
    elif scenario.controller == "px4":
        yield from _check_autopilot_link(scenario)
    if scenario.member:
        from hil.doctor.scenario.fleet import check_fleet

        for number, member in enumerate(scenario.member):
            yield from _check_start(as_member(scenario, member.node), vehicle, world, f"member[{number}]")
        yield from check_fleet(scenario, vehicle, world)
        yield from check_guidance(scenario, vehicle, HuntPlanner)
        return
    yield from _check_start(scenario, vehicle, world, "start")
    if scenario.modem:
        yield warning("modem: has no effect: only a fleet has modems, and there is no [[member]]")
    if scenario.controller in AUTOPILOTS:  # the autopilot flies its own mission
        return
    misplaced = list(check_places(scenario, subject, world))
    yield from misplaced
    if world.terrain is None and any(finding.level == "problem" for finding in misplaced):
        return
    try:
        plan = prepare(scenario, world)
    except ConfigError as error:
        yield problem(str(error))
        return
    except MissionError as error:
        yield problem(f"{KEYS.get(error.subject.partition('[')[0], '')}{error}")
        return
    yield from _check_plan(scenario, plan, min(plan.request.master.speed, top_speed or plan.request.master.speed))
    yield from check_guidance(scenario, vehicle, plan.planner, plan.request)


def _check_members(scenario: Scenario) -> Iterator[Finding]:
    """Check a fleet without a common task: each member for itself, then all together."""
    from hil.doctor.scenario.fleet import check_fleet

    for number, member in enumerate(scenario.member):
        own = as_member(scenario, member.node)._replace(member=(), modem=None)
        for level, text in _check(own) if own.master.goal else ():
            yield Finding(level, f"member[{number}] ({member.node}): {text}")
    yield from check_fleet(scenario, load_vehicle(scenario.vehicle)[0], load_world(scenario.world))


def _check_vehicle(scenario: Scenario, subject: Subject) -> Iterator[Finding]:
    """Find what is wrong with the vehicle's file; only the builtin controller is judged by its flight."""
    for level, text in check_vehicle(subject):
        is_flown = text.startswith(CONTROLLED)
        if is_flown and scenario.controller != "builtin":
            continue
        if is_flown or level != "note":  # who flies has to know also what is right for some vehicles
            yield Finding(level.replace("note", "warning"), f"vehicle: {scenario.vehicle}: {text}")


def _check_speed(scenario: Scenario, vehicle: Vehicle, top_speed: float) -> Iterator[Finding]:
    """Compare the requested speed with the vehicle's top speed."""
    key, speed = requested_speed(scenario)
    if top_speed and speed > top_speed:
        yield warning(
            f"{key}: {speed:g} m/s, but {vehicle.name} reaches {top_speed:.2f} m/s: request a lower speed, or "
            "use another vehicle",
        )


def _check_current(world: World, vehicle: Vehicle, top_speed: float) -> Iterator[Finding]:
    """Compare the steady current with the speed that the vehicle reaches."""
    current = hypot(*world.current[:2])
    if top_speed and current >= top_speed:
        yield warning(
            f"world: {world.name}: current: {current:.2f} m/s is faster than {vehicle.name}, which reaches "
            f"{top_speed:.2f} m/s: reduce current in the world's file",
        )


def _check_periods(scenario: Scenario) -> Iterator[Finding]:
    """Compare the period of the commands with the slave's deadman and its limit of the command rate."""
    period, slave = scenario.master.command_period, scenario.slave
    if slave.deadman < 2.0 * period:
        level, when = (
            ("problem", "between commands") if slave.deadman <= period else ("warning", "after a lost command")
        )
        yield Finding(
            level,
            f"slave: deadman: {slave.deadman:g} s, but commands are {period:g} s apart, so the thrusters go to neutral "
            f"{when}: use at least {2.0 * period:g} s, or a shorter command_period in [master]",
        )
    if scenario.network.command_rate * period < 1.0 - 1e-9:
        yield warning(
            f"network: command_rate: the slave accepts {scenario.network.command_rate:g} commands a second, but "
            f"command_period of [master] sends {1.0 / period:g}: use at least {1.0 / period:g} Hz",
        )
    if slave.control_period < slave.step:
        yield warning(
            f"slave: control_period: {slave.control_period:g} s is shorter than step, {slave.step:g} s: use a "
            "shorter step, or increase control_period to the same",
        )


def _check_event_times(scenario: Scenario) -> Iterator[Finding]:
    """Find failures and releases whose time is after the end of the run."""
    times = [(f"failure[{number}]", one.time) for number, one in enumerate(scenario.failure)]
    times += [(f"release[{number}]", one.time) for number, one in enumerate(scenario.release)]
    for key, time in times:
        if time > scenario.master.time_limit:
            yield warning(
                f"{key}: time: {time:g} s is after the end of the run, time_limit of [master], "
                f"{scenario.master.time_limit:g} s: use an earlier time, or increase time_limit",
            )


def _check_mavlink(scenario: Scenario) -> Iterator[Finding]:
    """Find duplicate endpoints, and ports of the slave's own."""
    mavlink = scenario.mavlink
    if mavlink is None:
        return
    duplicates = {one for one in mavlink.endpoints if mavlink.endpoints.count(one) > 1}
    for endpoint in sorted(duplicates):
        yield problem(f"mavlink: endpoints: {endpoint!r} is listed twice: remove one")
    _, _, port = split_endpoint(scenario.slave.listen)
    for endpoint in mavlink.endpoints:
        if endpoint.startswith("tcpin:") and endpoint.rpartition(":")[2] in (str(port), str(port + 1)):
            yield problem(
                f"mavlink: endpoints: {endpoint!r}: [slave] listen uses ports {port} and {port + 1}: use another port",
            )


def _check_link(scenario: Scenario, vehicle: Vehicle) -> Iterator[Finding]:
    """Check whether the thruster link can be opened, and whether its line rate is sufficient for the commands."""
    try:
        with suppress(MissingExtraError):  # the slave may run on another machine; `uuv-hil doctor` checks it there
            end_protocol(scenario.link, "host", len(vehicle.channels))
        check_line_rate(scenario.link, len(vehicle.channels), 1.0 / scenario.slave.control_period)
    except ConfigError as error:
        yield problem(str(error))


def _check_autopilot_link(scenario: Scenario) -> Iterator[Finding]:
    """Check whether the line rate to PX4 is sufficient for the samples."""
    from hil.autopilots.link_test import line_rate
    from hil.autopilots.opening import settings_of

    carried, settings = line_rate(scenario), settings_of(scenario)
    if 0.0 < carried < settings.rate:
        least = ceil(settings.baud * settings.rate / carried)
        yield problem(
            f"autopilot: baud: {settings.baud} bit/s transmits {carried:.0f} HIL_SENSOR messages a second, but rate is "
            f"{settings.rate:g} Hz: use at least {least} bit/s, or a lower rate",
        )


def _check_start(scenario: Scenario, vehicle: Vehicle, world: World, key: str) -> Iterator[Finding]:
    """Check whether the start position is free, and whether the simulation can be built."""
    start, tether = scenario.start, scenario.tether
    distance = dist(tether.anchor, (start.north, start.east, start.depth)) if tether else 0.0
    if tether and distance > tether.length:
        yield problem(
            f"tether: length: {tether.length:g} m, but the anchor is {distance:.1f} m away from {key}: use at least "
            f"{ceil(distance)} m, or move the anchor",
        )
        return
    try:
        build_simulation(scenario, vehicle, world)
    except StartPositionError as error:
        yield problem(f"{key}: {error}")
    except ConfigError as error:
        yield problem(str(error))


def _check_plan(scenario: Scenario, plan: Plan, speed: float) -> Iterator[Finding]:
    """Check a planner with a path: the time that it takes, the sensors that it needs, and its other places."""
    planner, grid, master = plan.planner, plan.request.map, scenario.master
    length = path_length(planner.path)
    least = sum(
        max(dist(a[:2], b[:2]) / speed, abs(sum(b[2:]) - sum(a[2:])) / DEPTH_HOLD.limit)
        for a, b in pairwise(planner.path)
    )
    if least > master.time_limit:
        yield problem(
            f"master: time_limit: the path of {length:.0f} m takes at least {least:.0f} s at {speed:.2f} m/s, "
            f"but the run ends after {master.time_limit:g} s: increase time_limit",
        )
    published = {spec.topic for spec in scenario.sensors.values()}
    for topic in planner.subscriptions:
        if topic in SCANS and topic not in published:
            yield problem(
                f"planner: {type(planner).__name__} needs the topic {topic!r}, but no sensor publishes it: add "
                f"[sensors.{topic}] with a rate above 0",
            )
    yield from _check_places(planner, grid, plan.request.clearance, master.time_limit)


def _check_places(planner: Planner, grid: OccupancyGrid, clearance: float, time_limit: float) -> Iterator[Finding]:
    """Check whether the planner's places besides the goal are free, and whether there is time for its tasks."""
    from hil.master.tasks import Tasks

    is_builtin = isinstance(planner, Tasks)  # a user's planner may reach its places differently
    inflated = grid.inflate(clearance)
    for north, east in planner.destinations:
        if not inflated.is_free((north, east)):
            where = "inside an obstacle" if grid.contains((north, east)) else "outside the map"
            nearest = inflated.nearest_free((north, east))
            remedy = (
                f"; the nearest free point is ({nearest[0]:.2f} m north, {nearest[1]:.2f} m east)" if nearest else ""
            )
            yield Finding(
                "problem" if is_builtin else "warning",
                f"planner: the place ({north:g} m north, {east:g} m east) is {where}{remedy}",
            )
    if isinstance(planner, Tasks):
        least = sum(task.duration for task in planner.mission.task if not task.when)
        if least > time_limit:
            yield problem(
                f"master: time_limit: the tasks take {least:g} s, without the travel between them, but the run ends "
                f"after {time_limit:g} s: increase time_limit",
            )

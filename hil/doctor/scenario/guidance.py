"""Check whether the vehicle can fly through a scenario's waypoints, and whether the guidance fits one with fins."""

from collections.abc import Iterator
from itertools import pairwise
from math import degrees, dist, tan

from hil.autonomy.paths.astar import path_length
from hil.doctor.vehicle.finding import Finding, note, problem, warning
from hil.doctor.vehicle.subject import Subject
from hil.master.flight import DEPTH_HOLD
from hil.master.guidance import LENGTHS, ROOM, fin_gains, narrow_turn
from hil.master.planner import Planner, PlanRequest
from hil.scenario.config import Scenario
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

HIT = 0.06  # greatest distance from the goal, in turning radii, of 48 flights of torpedoes in still water
DETOUR = 2.0  # a path so many times as long as the straight line is a circle back


def check_guidance(
    scenario: Scenario, vehicle: Vehicle, planner: Planner | type[Planner], request: PlanRequest | None = None
) -> Iterator[Finding]:
    """Yield the keys of [master] that do not fit the `vehicle`, or the `planner`: one that stops, with fins.

    `request` is what the planner has planned for, if it has.
    """
    name = planner.__name__ if isinstance(planner, type) else type(planner).__name__
    if request and scenario.master.waypoint and not planner.passes_waypoints:
        yield warning(
            f"master: waypoint: {name} does not pass the waypoints: leave out [planner], or set passes_waypoints in "
            "a planner of your own that does"
        )
    if not vehicle.fins:
        yield from _check_dives(scenario, vehicle, request)
        return
    if planner.hovers:
        yield warning(
            f"planner: {name} {planner.hovers}, but {vehicle.name} steers by fins and cannot stop: it goes on, in "
            "circles where it has no way; give it room for them, or use another planner or vehicle"
        )
    if request is None:
        return
    master, limits = request.master, request.limits
    radius = limits.turn_radius / ROOM
    circle = f"{vehicle.name} turns in circles of {radius:.1f} m in radius at {limits.speed:.2f} m/s"
    rules = (
        ("speed", fin_gains(scenario).least_speed, "m/s", f"{vehicle.name} goes at a higher speed, at which it steers"),
        ("lookahead", max(radius, LENGTHS * vehicle.dimensions[0]), "m", f"{circle}, and would swing about the path"),
        ("tolerance", HIT * limits.turn_radius, "m", f"{circle}, and misses so small a goal again and again"),
    )
    for key, least, unit, text in rules:
        if getattr(master, key) < 0.99 * least:  # derived keys are rounded
            yield warning(
                f"master: {key}: {getattr(master, key):g} {unit}, but {text}: use at least {least:.2g} {unit}, or "
                "leave out the key"
            )
    if narrow := narrow_turn(request):
        yield warning(narrow)
    straight, flown = path_length(request.course), path_length(planner.path)
    if straight < 2.0 * (len(request.course) - 1) * limits.turn_radius and flown > DETOUR * straight:
        yield warning(
            f"master: goal: {straight:.1f} m away, but {circle}, so the path has {flown:.0f} m: move the goal, or "
            "start with the heading towards it"
        )
    for key, (start, end) in zip(_keys(scenario), pairwise(request.course), strict=True):
        dive = abs(end[2] - start[2])
        if dive / tan(limits.climb_angle) > dist(start[:2], end[:2]):
            yield warning(
                f"master: {key}: {vehicle.name} changes its depth by at most {degrees(limits.climb_angle):.0f} deg, so "
                f"it needs {dive / tan(limits.climb_angle):.0f} m for {dive:g} m, and circles: begin nearer to that "
                "depth, or farther away"
            )


def check_places(scenario: Scenario, subject: Subject, world: World) -> Iterator[Finding]:
    """Yield depths of waypoints and goal that the vehicle cannot have: in the seabed, in the air, or without thrust."""
    master, vehicle, half = scenario.master, subject.vehicle, 0.5 * subject.vehicle.dimensions[2]
    south, north, west, east = world.extent
    below = half + master.seabed_margin
    can_dive = vehicle.fins or (not subject.floats and subject.capabilities[2].speed[0] > 0.0)
    for key, (place_north, place_east, depth) in zip(_keys(scenario), master.places(), strict=False):
        is_inside = south <= place_north <= north and west <= place_east <= east
        seabed = world.seabed(place_north, place_east)
        if is_inside and master.map == "known" and depth + below >= seabed:
            higher = f"use less than {seabed - below:.2f} m, " if seabed > below else ""
            yield problem(
                f"master: {key}: {depth:g} m, but the seabed there is {seabed:.2f} m deep, and {vehicle.name} needs "
                f"{below:.2f} m of water above it: {higher}move the place, or lessen seabed_margin",
            )
        elif not can_dive and abs(depth - scenario.start.depth) > half:
            yield problem(
                f"master: {key}: {depth:g} m, but the thrusters of {vehicle.name} do not change its depth: use "
                f"{scenario.start.depth:g} m, that of its start, or another vehicle",
            )
        elif depth < half and not subject.floats:
            yield warning(
                f"master: {key}: {depth:g} m, but the hull of {vehicle.name} reaches {half:.2f} m above its middle, so "
                f"it would leave the water: use at least {half:.2g} m"
            )


def _check_dives(scenario: Scenario, vehicle: Vehicle, request: PlanRequest | None) -> Iterator[Finding]:
    """Yield slopes between waypoints that slow down a vehicle which dives by its thrusters."""
    for key, (start, end) in zip(_keys(scenario), pairwise(request.course if request else ()), strict=False):
        dive, way = abs(end[2] - start[2]), dist(start[:2], end[:2])
        if dive / DEPTH_HOLD.limit > way / scenario.master.speed > 0.0:  # a vertical dive is meant to stop it
            yield note(
                f"master: {key}: {dive:g} m over {way:.1f} m is steeper than {vehicle.name} dives at "
                f"{scenario.master.speed:g} m/s: it slows down, as it changes its depth by at most "
                f"{DEPTH_HOLD.limit:g} m/s",
            )


def _keys(scenario: Scenario) -> list[str]:
    """Return the keys of [master] with the depths of its places."""
    return [*(f"waypoint[{number}]: depth" for number in range(len(scenario.master.waypoint))), "depth"]

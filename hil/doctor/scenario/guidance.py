"""Check whether the guidance of a scenario fits a vehicle that steers by fins, which cannot stop."""

from collections.abc import Iterator
from math import degrees, dist, tan

from hil.autonomy.paths.astar import path_length
from hil.doctor.vehicle.finding import Finding
from hil.master.guidance import LENGTHS, ROOM, fin_gains
from hil.master.planner import Planner, PlanRequest
from hil.scenario.config import Scenario
from sim.vehicle.vehicle import Vehicle

HIT = 0.06  # greatest distance from the goal, in turning radii, of 48 flights of torpedoes in still water
DETOUR = 2.0  # a path so many times as long as the straight line is a circle back


def check_guidance(
    scenario: Scenario, vehicle: Vehicle, planner: Planner | type[Planner], request: PlanRequest | None = None
) -> Iterator[Finding]:
    """Yield the keys of [master] that do not fit a `vehicle` with fins, and a `planner` that stops.

    `request` is what the planner has planned for, if it has.
    """
    if not vehicle.fins:
        return
    if planner.hovers:
        name = planner.__name__ if isinstance(planner, type) else type(planner).__name__
        yield _warning(
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
            yield _warning(
                f"master: {key}: {getattr(master, key):g} {unit}, but {text}: use at least {least:.2g} {unit}, or "
                "leave out the key"
            )
    start = request.start
    if not master.goal:
        return
    straight, flown = dist(master.goal, (start.north, start.east)), path_length(planner.path)
    if straight < 2.0 * limits.turn_radius and flown > DETOUR * straight:
        yield _warning(
            f"master: goal: {straight:.1f} m away, but {circle}, so the path has {flown:.0f} m: move the goal, or "
            "start with the heading towards it"
        )
    steep = abs(master.depth - start.depth) / tan(limits.climb_angle)
    if steep > straight:
        yield _warning(
            f"master: depth: {vehicle.name} changes its depth by at most {degrees(limits.climb_angle):.0f} deg, so it "
            f"needs {steep:.0f} m for {abs(master.depth - start.depth):g} m, and circles: start nearer to that depth"
        )


def _warning(text: str) -> Finding:
    return Finding("warning", text)

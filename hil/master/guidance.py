"""Derive the guidance of a vehicle that steers by fins, which cannot stop, from what the vehicle can do."""

from math import asin, ceil, dist, hypot, inf
from typing import Any

from hil.autonomy.control.controller import gains_of
from hil.autonomy.control.fin_control import FinGains
from hil.autonomy.paths.trajectory import Limits
from hil.common.errors import ConfigError
from hil.common.schema import parse
from hil.master.manoeuvring import Manoeuvring
from hil.master.planner import PlanRequest
from hil.scenario.config import Scenario
from hil.scenario.records import Master
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle, load_vehicle

_CRUISE, _STEERABLE = 0.65, 1.2  # cruising speed: share of the top speed, but at least so many least speeds
ROOM = 1.25  # turns are planned with so many least radii, so that the fins can correct while they turn
_SLOPE = 0.7  # share of the steepest slope that paths use
_DEPTH_RATE = 0.32  # m/s; 80 % of the limit of the depth hold (hil/master/flight.py)
LENGTHS = 3.0  # least lookahead in lengths of the vehicle
_HIT = 0.2  # tolerance as a share of the planned turning radius
_LEAST_TOLERANCE = 0.5  # m
_SLOWEST, _STRAIGHT = 0.01, 1e4  # m/s, m: a top speed below it and a turning radius above it are none
_BACK = 0.5  # cosine of the greatest angle between a line and the opposite of the one before
_OFF = 0.3  # margin to obstacles as a share of the planned turning radius: so far off the path may a turn begin


def fin_gains(scenario: Scenario) -> FinGains:
    """Return [control.fins] of the scenario's vehicle. Raises ConfigError."""
    return parse(load_vehicle(scenario.vehicle)[1].get("fins", {}), FinGains, f"{scenario.vehicle}: control.fins")


def cruising_speed(top: float, fins: FinGains) -> float:
    """Return the speed (m/s) at which a vehicle with fins cruises that reaches `top` m/s (0: without thrusters)."""
    return min(max(_CRUISE * top, _STEERABLE * fins.least_speed), top or inf)


def narrow_turn(request: PlanRequest) -> str:
    """Return a warning of survey lines that are nearer to each other than a vehicle with fins turns; "" if none are."""
    turns = 2.0 * request.limits.turn_radius
    for number, (first, start, end, last) in enumerate(zip(*(request.course[k:] for k in range(4)), strict=False)):
        apart = dist(start[:2], end[:2])
        cosine = sum((b - a) * (d - c) for a, b, c, d in zip(first[:2], start[:2], end[:2], last[:2], strict=True))
        if 0.0 < apart < 0.99 * turns and cosine < -_BACK * dist(first[:2], start[:2]) * dist(end[:2], last[:2]):
            return (
                f"master: waypoint[{number + 1}]: {apart:.1f} m from the line before, but {request.vehicle.name} needs "
                f"{turns:.1f} m to turn back, so it circles, and may miss the line and try again: plan lines at least "
                f"{turns:.1f} m apart, or fly first every line that is {ceil(turns / apart)} lines away, then those "
                "between"
            )
    return ""


def guide_by_fins(scenario: Scenario, vehicle: Vehicle, world: World) -> tuple[Master, Limits]:
    """Return [master] with speed, lookahead and tolerance that fit a `vehicle` with fins, and its limits.

    Keys that the scenario's file gives are left. The speed is 65 % of the top speed. Turns are 25 % wider than the
    tightest circle at that speed, and as much wider as the world's steady current carries the vehicle on. Raises
    ConfigError.
    """
    gains = gains_of(load_vehicle(scenario.vehicle)[1], f"{scenario.vehicle}: control")
    fins = fin_gains(scenario)
    cruise = Manoeuvring(vehicle, gains, fins, 0.0, world.density, world.gravity)
    master, top = scenario.master, cruise.top_speed
    if not _SLOWEST <= top < inf:
        raise ConfigError(f"{scenario.vehicle}: its top speed is {top:.3g} m/s: correct its thrusters and its damping")
    if "speed" in scenario.derived:
        master = master._replace(speed=round(cruising_speed(top, fins), 2))
    motion = Manoeuvring(vehicle, gains, fins, master.speed, world.density, world.gravity)
    least = motion.turn_radius()
    if not least < _STRAIGHT:
        raise ConfigError(f"{scenario.vehicle}: its fins do not turn it: correct their positions, axes and areas")
    radius = ROOM * least * (1.0 + min(1.0, hypot(*world.current[:2]) / motion.speed))
    derived: dict[str, Any] = {
        "lookahead": max(radius, LENGTHS * vehicle.dimensions[0]),
        "tolerance": max(_HIT * radius, _LEAST_TOLERANCE),
        "margin": max(_OFF * radius, master.margin),
    }
    master = master._replace(**{key: round(value, 2) for key, value in derived.items() if key in scenario.derived})
    slope = min(_SLOPE * motion.slope(), asin(min(1.0, _DEPTH_RATE / motion.speed)))
    return master, Limits(
        speed=motion.speed, yaw_rate=motion.speed / least, climb_angle=max(slope, 0.01), turn_radius=radius
    )

"""Check the scenario of a fleet: whether its vehicles, endpoints, modems and hunt are consistent."""

from collections.abc import Iterator
from itertools import combinations
from math import dist, hypot, pi, sin

from hil.autonomy.fleets.hunting import HuntPlan
from hil.common.endpoint import split_endpoint
from hil.common.errors import ConfigError, MissionError
from hil.doctor.vehicle.finding import Finding, problem, warning
from hil.master.flight import make_request
from hil.scenario.config import Scenario
from hil.scenario.fleet import hunt_plan
from hil.scenario.fleet_records import Hunting
from hil.scenario.modem import REPORT_BYTES, modem_of
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

PORTS = 2  # ports that an endpoint uses: its own, and the next one
PATH_POINTS = 50  # checked points of each vehicle's path


def check_fleet(scenario: Scenario, vehicle: Vehicle, world: World) -> Iterator[Finding]:
    """Yield problems of the fleet as a whole. `hil.doctor.scenario.check` finds those of single vehicles."""
    yield from _check_distances(scenario, vehicle)
    yield from _check_endpoints(scenario)
    if scenario.security and scenario.modem:
        yield problem("modem: the acoustic channel does not support [security]: remove one of them")
    if scenario.hunting is None:
        if any(member.goal for member in scenario.member):
            return
        yield warning("hunting: there is none, so `uuv-hil fleet agent` has no task: add it, with a target")
        return
    if scenario.modem:
        yield from _check_modem(scenario, scenario.hunting)
    try:
        plan = hunt_plan(scenario)
    except MissionError as error:
        yield problem(f"hunting: {error}")
        return
    yield from _check_ring(scenario, scenario.hunting)
    yield from _check_paths(scenario, plan, vehicle, world)


def _check_distances(scenario: Scenario, vehicle: Vehicle) -> Iterator[Finding]:
    """Find vehicles that overlap, or are too near to each other, at the start."""
    size = hypot(*vehicle.dimensions[:2])
    least = max(size, scenario.hunting.min_separation if scenario.hunting else 0.0)
    why = "min_separation of [hunting]" if least > size else f"the size of {vehicle.name}"
    for (number, one), (other, two) in combinations(enumerate(scenario.member), 2):
        apart = hypot(one.north - two.north, one.east - two.east)
        if apart < least:
            yield problem(
                f"member[{other}]: {two.node} starts {apart:.2f} m from {one.node} (member[{number}]), less than "
                f"{least:.2f} m ({why}): change its north or east",
            )


def _check_endpoints(scenario: Scenario) -> Iterator[Finding]:
    """Find endpoints of one host that share a port; each uses two ports."""
    users: dict[tuple[str, int], str] = {}
    for number, member in enumerate(scenario.member):
        for key, endpoint in (("listen", member.listen), ("agent", member.agent)):
            _, host, port = split_endpoint(endpoint)
            name = f"member[{number}]: {key}"
            ports = [(host, port + step) for step in range(PORTS)]
            other = next((users[one] for one in ports if one in users), None)
            if other:
                yield problem(
                    f"{name}: {endpoint} uses ports {port} and {port + 1}, and {other} uses one of them: use "
                    "another port",
                )
            users |= dict.fromkeys(ports, name)


def _check_modem(scenario: Scenario, hunting: Hunting) -> Iterator[Finding]:
    """Check whether a report fits into a message, and all reports into their period."""
    try:
        modem = modem_of(scenario)
    except ConfigError as error:
        yield problem(str(error))
        return
    longest = getattr(modem.model, "longest", REPORT_BYTES)
    if longest < REPORT_BYTES:
        yield problem(f"modem: longest: {longest} bytes is shorter than a report: use {REPORT_BYTES}")
    busy = modem.model.airtime_ns(REPORT_BYTES) * 1e-9 * len(scenario.member)
    if not modem.slot and hunting.report_period < busy:
        yield warning(
            f"hunting: report_period: {hunting.report_period:g} s, but the reports of all vehicles take {busy:.3g} s "
            "to send, so most are lost: increase it, or bit_rate of [modem], or set slot of [modem]",
        )


def _check_ring(scenario: Scenario, hunting: Hunting) -> Iterator[Finding]:
    """Compare the distance of neighbours on the ring with min_separation, and with the communication range."""
    apart = 2.0 * hunting.ring * sin(pi / len(scenario.member))
    if apart < hunting.min_separation:
        yield problem(
            f"hunting: ring: neighbours on it are {apart:.2f} m apart, less than min_separation, "
            f"{hunting.min_separation:g} m: increase ring",
        )
    if apart > hunting.fields.communication_range:
        yield warning(
            f"hunting: ring: neighbours on it are {apart:.2f} m apart, more than communication_range of "
            f"[hunting.fields], {hunting.fields.communication_range:g} m, so they do not receive each other: reduce "
            "ring",
        )


def _check_paths(scenario: Scenario, plan: HuntPlan, vehicle: Vehicle, world: World) -> Iterator[Finding]:
    """Check whether the hunt ends in time, and whether the paths are free. The vehicles do not avoid obstacles."""
    limit = scenario.master.time_limit
    if plan.duration > limit:
        yield problem(
            f"master: time_limit: the hunt takes at least {plan.duration:.0f} s, but the run ends after {limit:g} s: "
            "increase it, or max_speed of [hunting.fields]",
        )
    goal = scenario.hunting.target if scenario.hunting else None
    try:
        grid = make_request(scenario._replace(master=scenario.master._replace(goal=goal)), vehicle, world).map
    except ConfigError as error:
        yield problem(str(error))
        return
    inflated = grid.inflate(hypot(*vehicle.dimensions[:2]) / 2.0)
    for number, member in enumerate(scenario.member):
        path = [plan.position_at(number, plan.duration * step / PATH_POINTS) for step in range(PATH_POINTS + 1)]
        blocked = next((point for point in path if not inflated.is_free(point)), None)
        if blocked:
            where = "inside an obstacle" if grid.contains(blocked) else f"outside the map of {world.name}"
            yield problem(
                f"hunting: the path of {member.node} passes ({blocked[0]:.1f} m north, {blocked[1]:.1f} m east), "
                f"{where}, {dist(blocked, plan.target):.1f} m from the target: move the target or member[{number}]",
            )

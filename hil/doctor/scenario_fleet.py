"""Check the scenario of a fleet: whether its vehicles, endpoints, modems and hunt are consistent."""

from collections.abc import Iterator
from itertools import combinations
from math import dist, hypot, pi, sin

from hil.autonomy.fleets.hunting import HuntPlan
from hil.common.endpoint import split_endpoint
from hil.common.errors import ConfigError, MissionError
from hil.doctor.scenario_findings import ScenarioFinding
from hil.master.flight import make_request
from hil.scenario.config import Scenario
from hil.scenario.fleet import hunt_plan
from hil.scenario.fleet_records import Hunting
from hil.scenario.modem import REPORT_BYTES, modem_of
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

PORTS = 2  # ports that an endpoint uses: its own, and the next one
PLACES = 50  # checked points of each vehicle's path


def check_fleet(scenario: Scenario, vehicle: Vehicle, world: World) -> Iterator[ScenarioFinding]:
    """Yield problems of the fleet as a whole; those of single vehicles are found elsewhere."""
    yield from _check_distances(scenario, vehicle)
    yield from _check_endpoints(scenario)
    if scenario.security and scenario.modem:
        yield ScenarioFinding("problem", "modem: the acoustic channel has no [security]: leave out one of the two")
    if scenario.hunting is None:
        yield ScenarioFinding("warning", "hunting: is left out, so that `uuv-hil agent` has no task: only slaves fly")
        return
    if scenario.modem:
        yield from _check_modem(scenario, scenario.hunting)
    try:
        plan = hunt_plan(scenario)
    except MissionError as error:
        yield ScenarioFinding("problem", f"hunting: {error}")
        return
    yield from _check_ring(scenario, scenario.hunting)
    yield from _check_ways(scenario, plan, vehicle, world)


def _check_distances(scenario: Scenario, vehicle: Vehicle) -> Iterator[ScenarioFinding]:
    """Find vehicles that overlap, or are too near to each other, at the start."""
    size = hypot(*vehicle.dimensions[:2])
    least = max(size, scenario.hunting.min_separation if scenario.hunting else 0.0)
    why = "min_separation of [hunting]" if least > size else f"two {vehicle.name} may touch"
    for (number, one), (other, two) in combinations(enumerate(scenario.member), 2):
        apart = hypot(one.north - two.north, one.east - two.east)
        if apart < least:
            yield ScenarioFinding(
                "problem",
                f"member[{other}]: {two.node} starts {apart:.2f} m from {one.node} (member[{number}]), less than "
                f"{least:.2f} m ({why}): move its north or east",
            )


def _check_endpoints(scenario: Scenario) -> Iterator[ScenarioFinding]:
    """Find endpoints of one host that share a port; each uses two ports."""
    taken: dict[tuple[str, int], str] = {}
    for number, member in enumerate(scenario.member):
        for key, endpoint in (("listen", member.listen), ("agent", member.agent)):
            _, host, port = split_endpoint(endpoint)
            name = f"member[{number}]: {key}"
            ports = [(host, port + step) for step in range(PORTS)]
            other = next((taken[one] for one in ports if one in taken), None)
            if other:
                yield ScenarioFinding(
                    "problem",
                    f"{name}: {endpoint} takes ports {port} and {port + 1}, and {other} takes one of them: choose "
                    "another port",
                )
            taken |= dict.fromkeys(ports, name)


def _check_modem(scenario: Scenario, hunting: Hunting) -> Iterator[ScenarioFinding]:
    """Check whether a report fits into a message, and all reports into their period."""
    try:
        modem = modem_of(scenario)
    except ConfigError as error:
        yield ScenarioFinding("problem", str(error))
        return
    longest = getattr(modem.model, "longest", REPORT_BYTES)
    if longest < REPORT_BYTES:
        yield ScenarioFinding("problem", f"modem: longest: a report has {REPORT_BYTES} bytes, more than {longest}")
    busy = modem.model.airtime_ns(REPORT_BYTES) * 1e-9 * len(scenario.member)
    if not modem.slot and hunting.report_period < busy:
        yield ScenarioFinding(
            "warning",
            f"hunting: report_period: {hunting.report_period:g} s, and the reports of all vehicles take {busy:.3g} s "
            "on the air: most are lost: lengthen it, raise bit_rate of [modem], or set its slot",
        )


def _check_ring(scenario: Scenario, hunting: Hunting) -> Iterator[ScenarioFinding]:
    """Compare the distance of neighbours on the ring with min_separation, and with the communication range."""
    apart = 2.0 * hunting.ring * sin(pi / len(scenario.member))
    if apart < hunting.min_separation:
        yield ScenarioFinding(
            "problem",
            f"hunting: ring: neighbours on it are {apart:.2f} m apart, less than min_separation, "
            f"{hunting.min_separation:g} m: widen the ring",
        )
    if apart > hunting.fields.communication_range:
        yield ScenarioFinding(
            "warning",
            f"hunting: ring: neighbours on it are {apart:.2f} m apart, farther than communication_range of "
            f"[hunting.fields], {hunting.fields.communication_range:g} m: they do not receive each other",
        )


def _check_ways(scenario: Scenario, plan: HuntPlan, vehicle: Vehicle, world: World) -> Iterator[ScenarioFinding]:
    """Check whether there is time for the hunt, and whether the paths are free, as the vehicles avoid no obstacles."""
    limit = scenario.master.time_limit
    if plan.duration > limit:
        yield ScenarioFinding(
            "problem",
            f"master: time_limit: the hunt takes {plan.duration:.0f} s and more, and the run ends after {limit:g} s: "
            "lengthen it, or raise max_speed of [hunting.fields]",
        )
    goal = scenario.hunting.target if scenario.hunting else None
    try:
        grid = make_request(scenario._replace(master=scenario.master._replace(goal=goal)), vehicle, world).map
    except ConfigError as error:
        yield ScenarioFinding("problem", str(error))
        return
    room = grid.inflate(hypot(*vehicle.dimensions[:2]) / 2.0)
    for number, member in enumerate(scenario.member):
        way = [plan.place(number, plan.duration * step / PLACES) for step in range(PLACES + 1)]
        at = next((place for place in way if not room.is_free(place)), None)
        if at:
            where = "inside an obstacle" if grid.contains(at) else f"outside the map of {world.name}"
            yield ScenarioFinding(
                "problem",
                f"hunting: the way of {member.node} leads to ({at[0]:.1f} m north, {at[1]:.1f} m east), {where}, "
                f"{dist(at, plan.target):.1f} m from the target: move the target or member[{number}]",
            )

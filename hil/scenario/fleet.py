"""Functions on the scenario of a fleet: select one member's scenario, and plan the fleet's hunt."""

from hil.autonomy.fleets.hunting import HuntPlan
from hil.common.errors import ConfigError
from hil.common.schema import nearest
from hil.scenario.config import Scenario
from hil.scenario.fleet_records import Hunting


def member_number(scenario: Scenario, which: str) -> int:
    """Return the index of the member `which`, given by its node or its number from 1. Raises ConfigError."""
    nodes = [member.node for member in scenario.member]
    if not nodes:
        raise ConfigError(
            f"{scenario.path}: is of one vehicle, not of a fleet: it has no [[member]]; target_hunting has"
        )
    if which.isdigit() and 0 < int(which) <= len(nodes):
        return int(which) - 1
    if which in nodes:
        return nodes.index(which)
    if not which:
        raise ConfigError(f"{scenario.path}: say with --member which vehicle this is: {', '.join(nodes)}")
    raise ConfigError(f"{scenario.path}: no member {which!r}{nearest(which, nodes)}; there are: {', '.join(nodes)}")


def as_member(scenario: Scenario, which: str) -> Scenario:
    """Return the scenario of one vehicle of the fleet, with its own seed and frames. Raises ConfigError."""
    number = member_number(scenario, which)
    member, start, master = scenario.member[number], scenario.start, scenario.master
    if member.depth is not None:
        start, master = start._replace(depth=member.depth), master._replace(depth=member.depth)
    return scenario._replace(
        vehicle=member.vehicle or scenario.vehicle,
        master=master._replace(goal=member.goal or master.goal),
        seed=scenario.seed * len(scenario.member) + number,
        slave=scenario.slave._replace(node=member.node, listen=member.listen),
        start=start._replace(north=member.north, east=member.east, heading=member.heading),
        ros=scenario.ros._replace(frame_prefix=f"{member.node}/", clock=0.0 if number else scenario.ros.clock),
    )


def endpoints_of(scenario: Scenario) -> list[str]:
    """Return the endpoints of all vehicles and of a fleet's planners: the router's, or each one's own."""
    if scenario.network.mode == "routed":
        return [scenario.network.router]
    if not scenario.member:
        return [scenario.slave.listen]
    return [endpoint for member in scenario.member for endpoint in (member.listen, member.agent)]


def hunting_of(scenario: Scenario) -> Hunting:
    """Return the [hunting] section. Raises ConfigError if there is none."""
    if scenario.hunting is None:
        raise ConfigError(
            f"{scenario.path}: there is no [hunting], so its vehicles have no target: add one with a target, or use a "
            "scenario that has one, such as target_hunting"
        )
    return scenario.hunting


def hunt_plan(scenario: Scenario) -> HuntPlan:
    """Return the plan of the hunt: each member's position at any time. Raises ConfigError, MissionError."""
    hunting = hunting_of(scenario)
    starts = [(member.north, member.east) for member in scenario.member]
    return HuntPlan(starts, hunting.target, hunting.ring, hunting.fields.max_speed)

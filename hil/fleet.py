"""Several vehicles in one scenario: who they are, and what they hunt.

[[member]]                    # each a slave of its own, with a planner of its own
node = "uuv1"
listen = "tcp/127.0.0.1:7447" # its slave
agent = "tcp/127.0.0.1:7467"  # its planner, for those of the others

[hunting]
target = [5.0, 8.0]
ring = "1.5 m"
"""

from typing import Annotated, Any, NamedTuple

from hil.autonomy.formation import FieldSettings
from hil.autonomy.hunting import HuntPlan
from hil.config import VECTOR_M, Scenario, Slave
from hil.errors import ConfigError
from hil.schema import Range, nearest, parse


class Member(NamedTuple):
    """One vehicle: its slave is `node` and listens at `listen`, its planner is heard by the others at `agent`.

    It starts at `north`, `east` with `heading`, at the depth of [start]. Each endpoint takes two ports.
    """

    node: str
    listen: str
    agent: str
    north: Annotated[float, Range(-1e5, 1e5, "m")]
    east: Annotated[float, Range(-1e5, 1e5, "m")]
    heading: Annotated[float, Range(-6.3, 6.3, "rad")] = 0.0

    def problem(self) -> str | None:
        """A name that is none."""
        return Slave(node=self.node).problem()


class Hunting(NamedTuple):
    """A hunt: `target` (m north, m east) is surrounded on a ring of radius `ring`.

    `berth` is how near the middles of two vehicles may come. `noise` is the standard deviation of an error that each
    vehicle's own position has, each axis, in addition to its navigation's. Neighbours tell each other where they
    are every `report_period`; who has not been heard for `forget` is not there.
    """

    target: VECTOR_M
    ring: Annotated[float, Range(0.2, 1000.0, "m")] = 1.5
    berth: Annotated[float, Range(0.05, 100.0, "m")] = 0.5
    noise: Annotated[float, Range(0.0, 10.0, "m")] = 0.05
    report_period: Annotated[float, Range(0.01, 10.0, "s")] = 0.1
    forget: Annotated[float, Range(0.1, 60.0, "s")] = 1.0
    fields: FieldSettings = FieldSettings()

    def problem(self) -> str | None:
        """Times that do not go together."""
        if self.forget < 2.0 * self.report_period:
            return "forget must be at least twice report_period"
        return None


def read_members(tables: list[dict[str, Any]], where: str) -> tuple[Member, ...]:
    """The [[member]] tables of a scenario. Raises ConfigError."""
    members = tuple([parse(table, Member, f"{where}[{i}]") for i, table in enumerate(tables)])
    for key in ("node", "listen", "agent"):
        values = [getattr(member, key) for member in members]
        twice = next((value for value in values if values.count(value) > 1), None)
        if twice is not None:
            raise ConfigError(f"{where}: {key}: two members have {twice!r}")
    return members


def member_number(scenario: Scenario, which: str) -> int:
    """The place among the members of the one called `which`, by its node or its number from 1. Raises ConfigError."""
    nodes = [member.node for member in scenario.member]
    if not nodes:
        raise ConfigError(f"{scenario.path}: there is no [[member]]: leave out --member")
    if which.isdigit() and 0 < int(which) <= len(nodes):
        return int(which) - 1
    if which in nodes:
        return nodes.index(which)
    if not which:
        raise ConfigError(f"{scenario.path}: say with --member which vehicle this is: {', '.join(nodes)}")
    raise ConfigError(f"{scenario.path}: no member {which!r}{nearest(which, nodes)}; there are: {', '.join(nodes)}")


def as_member(scenario: Scenario, which: str) -> Scenario:
    """The scenario of one vehicle of the fleet, with a seed and frames of its own. Raises ConfigError."""
    number = member_number(scenario, which)
    member = scenario.member[number]
    return scenario._replace(
        seed=scenario.seed * len(scenario.member) + number,
        slave=scenario.slave._replace(node=member.node, listen=member.listen),
        start=scenario.start._replace(north=member.north, east=member.east, heading=member.heading),
        ros=scenario.ros._replace(frame_prefix=f"{member.node}/", clock=0.0 if number else scenario.ros.clock),
    )


def hunting_of(scenario: Scenario) -> Hunting:
    """Its [hunting] section. Raises ConfigError if there is none."""
    if scenario.hunting is None:
        raise ConfigError(f"{scenario.path}: a hunt needs a [hunting] section, with a target")
    return scenario.hunting


def hunt_plan(scenario: Scenario) -> HuntPlan:
    """Where each member's place is at any time of the hunt. Raises ConfigError, MissionError."""
    hunting = hunting_of(scenario)
    starts = [(member.north, member.east) for member in scenario.member]
    return HuntPlan(starts, hunting.target, hunting.ring, hunting.fields.max_speed)

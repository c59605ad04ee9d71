"""Records of a fleet's scenario sections: its vehicles, and the target that they hunt.

[[member]]                    # each has its own slave and its own planner
node = "uuv1"
listen = "tcp/127.0.0.1:7447" # endpoint of its slave
agent = "tcp/127.0.0.1:7467"  # endpoint of its planner, for the other planners

[hunting]
target = [5.0, 8.0]
ring = "1.5 m"
"""

from typing import Annotated, Any, NamedTuple

from hil.autonomy.fleets.formation import FieldSettings
from hil.common.endpoint import validate_endpoint
from hil.common.errors import ConfigError
from hil.common.schema import Range, parse_rows
from hil.scenario.records import VECTOR_M, Slave


class Member(NamedTuple):
    """One vehicle of a fleet: its slave is called `node` and listens at `listen`; its planner listens at `agent`.

    It starts at `north`, `east` with `heading`, at the depth of [start]. Each endpoint takes two ports. `vehicle`, and
    `depth` and `goal` of its start and task, replace those of the scenario. With `usbl` its modem also measures where
    the others are (sim/modems/usbl.py).
    """

    node: str
    listen: str
    agent: str
    north: Annotated[float, Range(-1e5, 1e5, "m")]
    east: Annotated[float, Range(-1e5, 1e5, "m")]
    heading: Annotated[float, Range(-6.3, 6.3, "rad")] = 0.0
    vehicle: str = ""
    depth: Annotated[float, Range(0.0, 11_000.0, "m")] | None = None
    goal: VECTOR_M | None = None
    usbl: bool = False

    def validate(self) -> str | None:
        """Return why the name or an endpoint is invalid; None if they are valid."""
        return Slave(node=self.node, listen=self.listen).validate() or validate_endpoint("agent", self.agent)


class Hunting(NamedTuple):
    """Hunt of a fleet: the vehicles surround `target` (m north, m east) on a ring of radius `ring`.

    `min_separation` is the least distance between the centres of two vehicles. `noise` is the standard deviation per
    axis of an error of each vehicle's own position, in addition to its navigation error. Neighbours report their
    positions to each other every `report_period`; one without a report for `report_timeout` counts as absent.
    """

    target: VECTOR_M
    ring: Annotated[float, Range(0.2, 1000.0, "m")] = 1.5
    min_separation: Annotated[float, Range(0.05, 100.0, "m")] = 0.5
    noise: Annotated[float, Range(0.0, 10.0, "m")] = 0.05
    report_period: Annotated[float, Range(0.01, 10.0, "s")] = 0.1
    report_timeout: Annotated[float, Range(0.1, 60.0, "s")] = 1.0
    fields: FieldSettings = FieldSettings()

    def validate(self) -> str | None:
        """Return why the times contradict each other, or None."""
        if self.report_timeout < 2.0 * self.report_period:
            return "report_timeout must be at least twice report_period"
        return None


def read_members(tables: list[dict[str, Any]], where: str) -> tuple[Member, ...]:
    """Read the [[member]] tables of a scenario. Raises ConfigError."""
    members = parse_rows(tables, Member, where)
    for key in ("node", "listen", "agent"):
        values = [getattr(member, key) for member in members]
        twice = next((value for value in values if values.count(value) > 1), None)
        if twice is not None:
            raise ConfigError(f"{where}: {key}: two members have {twice!r}; give each its own")
    return members

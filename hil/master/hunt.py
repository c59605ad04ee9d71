"""The planner of one vehicle in a hunt: own navigation and neighbours' reports in, a velocity out.

It knows the plan agreed on before the dive, its own noisy position, and the reports of neighbours within communication
range. It starts when all vehicles that begin close to it have reported.
"""

from math import dist
from typing import TYPE_CHECKING, NamedTuple

from hil.autonomy.control.controller import VelocityCommand, heading_of
from hil.autonomy.fleets.formation import Vector
from hil.autonomy.fleets.hunting import Hunter, Report
from hil.autonomy.fleets.localisation_noise import LocalisationNoise
from hil.common.clock import NS_PER_S, seconds_ns
from hil.master.planner import Done, Planner, Samples
from hil.ros.fleet import FormationSample, decode_formation, encode_formation
from hil.scenario.config import Scenario
from hil.scenario.fleet import as_member, hunt_plan, hunting_of
from sim.rotations import rotate

if TYPE_CHECKING:
    from hil.scenario.modem import ModemReport
    from sim.sensors.samples import OdometrySample

LONGEST_STEP_S = 0.5  # largest step of the plan's clock, even after a longer interruption


class _StoredReport(NamedTuple):
    """A neighbour's report at `time` (s after the start), with its velocity (m/s north, m/s east)."""

    report: Report
    velocity: Vector
    time: float


class HuntPlanner(Planner):
    """Planner of vehicle `number` (from 0) of the scenario's members. Raises ConfigError, MissionError.

    `received` counts the accepted reports, `beyond` the reports from outside of communication range, `malformed` those
    that could not be decoded.
    """

    subscriptions = ()
    hovers = "waits for the others and holds its place on the ring"

    def __init__(self, scenario: Scenario, number: int) -> None:
        self._hunting = hunting_of(scenario)
        plan = hunt_plan(scenario)
        fields = self._hunting.fields
        self._hunter = Hunter(plan, number, fields, self._hunting.min_separation)
        self._noise = LocalisationNoise(self._hunting.noise, as_member(scenario, str(number + 1)).seed)
        self._depth = scenario.master.depth
        self._awaited = {
            member.node
            for k, member in enumerate(scenario.member)
            if k != number and dist(plan.starts[k], plan.starts[number]) < fields.comfortable
        }
        self._reports: dict[str, _StoredReport] = {}  # by node
        self._confirmed: set[str] = set()  # neighbours that have been within the comfortable distance
        self._own_sample: FormationSample | None = None
        self._odometry: OdometrySample | None = None
        self._time = 0.0
        self._duration = plan.duration
        self.path = [plan.position_at(number, plan.duration * share / 50) for share in range(51)]
        self.received = self.beyond = self.malformed = 0

    @property
    def clock(self) -> float:
        """Time in the plan, s."""
        return self._hunter.clock

    @property
    def neighbours(self) -> list[str]:
        """Nodes whose last report is not older than the timeout."""
        return [
            node
            for node, stored in list(self._reports.items())
            if self._time - stored.time < self._hunting.report_timeout
        ]

    def on_report(self, node: str, payload: bytes, time: float) -> None:
        """Store the report of `node`, received at `time` (s after the start). May be called in any thread."""
        sample = decode_formation(payload)
        self._store_report(node, time, sample, (0.0, 0.0))

    def on_modem_report(self, node: str, payload: bytes, time: float) -> None:
        """Store a report received by modem; `time` is the time of sending (s after the start)."""
        from hil.scenario.modem import decode_report  # a late import: most fleets have no modems

        modem_report = decode_report(payload)
        self._store_report(node, time, modem_report, modem_report.velocity if modem_report else (0.0, 0.0))

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Return the next command. A hunt does not end: the vehicles keep the target surrounded."""
        odometry = samples["odom"]
        position = self._noise.measured(odometry.position[:2])
        self._odometry = odometry
        self._own_sample = FormationSample((*position, odometry.position[2]), odometry.orientation, 0)
        dt, self._time = min(time - self._time, LONGEST_STEP_S), time
        near = self.neighbours
        self._confirmed.intersection_update(near)
        self._confirmed.update(node for node in near if self._is_comfortable(self._reports[node].report))
        self._awaited.difference_update(near)
        reports = [self._present(node) for node in near]
        heading = heading_of(odometry.orientation)
        command = self._hunter.command(position, heading, reports, 0.0 if self._awaited else dt)
        self.progress = self.clock / self._duration
        self.status = f"{len(near)} neighbours in contact"
        if self._awaited:
            self.status = f"waiting for {', '.join(sorted(self._awaited))}"
        return command._replace(depth=self._depth)

    def report(self) -> bytes:
        """Return the report for the neighbours; b"" before the first command."""
        return encode_formation(self._own_sample._replace(clock_ns=seconds_ns(self.clock))) if self._own_sample else b""

    def modem_report(self) -> bytes:
        """Return the report in the short format for a modem; b"" before the first command."""
        from hil.scenario.modem import ModemReport, encode_report

        if self._own_sample is None or self._odometry is None:
            return b""
        north, east, _ = rotate(self._odometry.orientation, self._odometry.nu[:3])
        return encode_report(ModemReport(self._own_sample.position, (north, east), seconds_ns(self.clock)))

    def _store_report(
        self, node: str, time: float, sample: "FormationSample | ModemReport | None", velocity: Vector
    ) -> None:
        if sample is None:
            self.malformed += 1
        elif not self._in_range(sample):
            self.beyond += 1
        else:
            self.received += 1
            self._reports[node] = _StoredReport(Report(sample.position[:2], sample.clock_ns / NS_PER_S), velocity, time)

    def _present(self, node: str) -> Report:
        """Return the report of `node`, extrapolated to now: without this, old reports would slow the formation down."""
        report, velocity, time = self._reports[node]
        age = self._time - time
        north, east = report.position
        place = north + age * velocity[0], east + age * velocity[1]
        return Report(place, report.clock + age, node in self._confirmed)

    def _is_comfortable(self, report: Report) -> bool:
        assert self._own_sample is not None
        return dist(report.position, self._own_sample.position[:2]) < self._hunting.fields.comfortable

    def _in_range(self, sample: "FormationSample | ModemReport") -> bool:
        if self._own_sample is None:
            return False
        return dist(sample.position[:2], self._own_sample.position[:2]) < self._hunting.fields.communication_range

"""The planner of one vehicle in a hunt: its own navigation and its neighbours' reports in, a velocity out.

It knows the plan agreed on before the dive, its own noisy position, and what the neighbours within the range of
communication say. It sets out when all who begin next to it have been heard.
"""

from math import dist
from typing import TYPE_CHECKING, NamedTuple

from hil.autonomy.control import VelocityCommand, heading_of
from hil.autonomy.formation import Vector
from hil.autonomy.hunting import Hunter, Report
from hil.autonomy.localisation_noise import LocalisationNoise
from hil.clock import NS_PER_S, seconds_ns
from hil.config import Scenario
from hil.fleet import as_member, hunt_plan, hunting_of
from hil.master.planner import Done, Planner, Samples
from hil.transport.ros_formation import FormationSample, decode_formation, encode_formation
from sim.rotations import rotate

if TYPE_CHECKING:
    from hil.modem import Telegram
    from sim.sensors.samples import OdometrySample

LONGEST_STEP_S = 0.5  # that the plan's clock goes on at once, after whatever hold-up


class _Said(NamedTuple):
    """What a neighbour said of itself at `time` (s after the start), and how fast it moved (m/s north, m/s east)."""

    report: Report
    velocity: Vector
    time: float


class HuntPlanner(Planner):
    """Vehicle `number` (from 0) of the scenario's members.

    `heard` counts the reports taken in, `beyond` those that came from out of range, `malformed` those that were none.
    Raises ConfigError, MissionError.
    """

    listens = ()

    def __init__(self, scenario: Scenario, number: int) -> None:
        self._hunting = hunting_of(scenario)
        plan = hunt_plan(scenario)
        fields = self._hunting.fields
        self._hunter = Hunter(plan, number, fields, self._hunting.berth)
        self._noise = LocalisationNoise(self._hunting.noise, as_member(scenario, str(number + 1)).seed)
        self._depth = scenario.master.depth
        self._awaited = {
            member.node
            for k, member in enumerate(scenario.member)
            if k != number and dist(plan.starts[k], plan.starts[number]) < fields.comfortable
        }
        self._reports: dict[str, _Said] = {}  # by node
        self._kept: set[str] = set()  # neighbours that have been well within range
        self._here: FormationSample | None = None
        self._odometry: OdometrySample | None = None
        self._time = 0.0
        self._duration = plan.duration
        self.path = [plan.place(number, plan.duration * share / 50) for share in range(51)]
        self.heard = self.beyond = self.malformed = 0

    @property
    def clock(self) -> float:
        """How far it is in the plan, s."""
        return self._hunter.clock

    @property
    def neighbours(self) -> list[str]:
        """The nodes that it hears at present."""
        return [node for node, said in list(self._reports.items()) if self._time - said.time < self._hunting.forget]

    def hear(self, node: str, payload: bytes, time: float) -> None:
        """Take in what the planner of `node` said at `time` (s after the start); it may come from another thread."""
        sample = decode_formation(payload)
        self._take_in(node, time, sample, (0.0, 0.0))

    def overhear(self, node: str, payload: bytes, time: float) -> None:
        """As `hear`, for a telegram that came by modem; `time` is when it was sent."""
        from hil.modem import decode_telegram  # most fleets talk over the network

        telegram = decode_telegram(payload)
        self._take_in(node, time, telegram, telegram.velocity if telegram else (0.0, 0.0))

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """On with the hunt; it does not end, as a target that is surrounded has to be kept so."""
        odometry = samples["odom"]
        position = self._noise.measured(odometry.position[:2])
        self._odometry = odometry
        self._here = FormationSample((*position, odometry.position[2]), odometry.orientation, 0)
        dt, self._time = min(time - self._time, LONGEST_STEP_S), time
        near = self.neighbours
        self._kept.intersection_update(near)
        self._kept.update(node for node in near if self._is_comfortable(self._reports[node].report))
        self._awaited.difference_update(near)
        reports = [self._present(node) for node in near]
        heading = heading_of(odometry.orientation)
        command = self._hunter.command(position, heading, reports, 0.0 if self._awaited else dt)
        self.progress = self.clock / self._duration
        self.note = f"waiting for {', '.join(sorted(self._awaited))}" if self._awaited else f"hears {len(near)}"
        return command._replace(depth=self._depth)

    def report(self) -> bytes:
        """What to tell the neighbours; nothing (b"") before the first command."""
        return encode_formation(self._here._replace(clock_ns=seconds_ns(self.clock))) if self._here else b""

    def telegram(self) -> bytes:
        """As `report`, short enough for a modem."""
        from hil.modem import Telegram, encode_telegram

        if self._here is None or self._odometry is None:
            return b""
        north, east, _ = rotate(self._odometry.orientation, self._odometry.nu[:3])
        return encode_telegram(Telegram(self._here.position, (north, east), seconds_ns(self.clock)))

    def _take_in(self, node: str, time: float, sample: "FormationSample | Telegram | None", velocity: Vector) -> None:
        if sample is None:
            self.malformed += 1
        elif not self._in_range(sample):
            self.beyond += 1
        else:
            self.heard += 1
            self._reports[node] = _Said(Report(sample.position[:2], sample.clock_ns / NS_PER_S), velocity, time)

    def _present(self, node: str) -> Report:
        """What `node` said, it and its clock gone on since: else the age of reports would slow everybody down."""
        report, velocity, time = self._reports[node]
        age = self._time - time
        north, east = report.position
        place = north + age * velocity[0], east + age * velocity[1]
        return Report(place, report.clock + age, node in self._kept)

    def _is_comfortable(self, report: Report) -> bool:
        assert self._here is not None
        return dist(report.position, self._here.position[:2]) < self._hunting.fields.comfortable

    def _in_range(self, sample: "FormationSample | Telegram") -> bool:
        if self._here is None:
            return False
        return dist(sample.position[:2], self._here.position[:2]) < self._hunting.fields.communication_range

"""Record the true positions of a hunt, decide when it ends, and compute its result."""

from collections.abc import Callable, Mapping, Sequence
from itertools import permutations
from math import cos, degrees, dist, inf, nan, pi, sin, sqrt
from types import MappingProxyType
from typing import NamedTuple

from hil.autonomy.fleets.formation import Vector
from hil.autonomy.fleets.hunting import Criteria, HuntPlan, Judgement, Referee
from hil.cases.record import Mode, Result
from hil.cases.single import radius_of
from hil.common.clock import seconds_ns
from hil.scenario.config import Scenario
from hil.scenario.fleet import hunt_plan, hunting_of
from sim.run_events import EventLog, RunEvent, RunMonitor, merge_events
from sim.sensors.samples import OdometrySample
from sim.vehicle.vehicle import load_vehicle

SETTLE_S = 5.0  # from the end of the last vehicle's plan to the end of the hunt
RING_ANGLES = 180  # rotations of the ring that are tried for the shortest paths
NO_FIGURES: Mapping[str, float] = MappingProxyType({"energy": nan})
_ROUNDING_S = 1e-6  # rounding error of clocks in messages


class HuntRow(NamedTuple):
    """State at one time (s): true positions (m north, m east), and the time of each vehicle in the plan (s)."""

    time: float
    positions: tuple[Vector, ...]
    clocks: tuple[float, ...]


class HuntWatch:
    """Recorder of the rows of a hunt, which decides when it is over; `show` is called with the progress as text.

    Raises ConfigError, MissionError.
    """

    def __init__(self, scenario: Scenario, show: Callable[[str], None] = lambda text: None) -> None:
        self._show = show
        self.plan, self._seed = hunt_plan(scenario), scenario.seed
        self.rows: list[HuntRow] = []
        self.reason = ""
        self._time_limit = scenario.master.time_limit
        self._depth, self._allow = scenario.master.depth, scenario.master.allow
        self._nodes = [member.node for member in scenario.member]
        vehicle, _ = load_vehicle(scenario.vehicle)
        self._radius = radius_of(vehicle)
        limits = vehicle.capsize_tilt, 0.5 * vehicle.dimensions[2], scenario.master.depth_margin
        self._monitors = [RunMonitor(EventLog(), *limits) for _ in self._nodes]
        self._reported: list[Sequence[RunEvent]] = [() for _ in self._nodes]
        self._referee = Referee(self.plan, Criteria(hunting_of(scenario).min_separation))
        self._closed = inf
        self._travelled = 0.0
        self._nearest = inf
        self._place_error_max = self._place_error_squares = 0.0

    def add_row(self, row: HuntRow) -> str:
        """Add the next row; return the reason why the hunt is over, "" if it is not."""
        if self.rows:
            self._travelled += sum(map(dist, row.positions, self.rows[-1].positions))
        self.rows.append(row)
        self._show(f"{row.time:.1f} s, {min(row.clocks) / self.plan.duration:.0%}")
        self._referee.watch(row.positions, max(row.clocks))
        self._nearest = min(self._nearest, *(dist(position, self.plan.target) for position in row.positions))
        off = self._place_errors(row)
        self._place_error_max = max(self._place_error_max, *off)
        self._place_error_squares += sum(each * each for each in off) / len(off)
        if min(row.clocks) > self.plan.duration - _ROUNDING_S:
            self._closed = min(self._closed, row.time)
        if row.time >= self._closed + SETTLE_S:
            self.reason = "target surrounded"
        elif row.time > self._time_limit:
            self.reason = "time limit"
        return self.reason

    def observe(self, number: int, time: float, truth: OdometrySample) -> None:
        """Check attitude and depth of vehicle `number` (from 0) at `time` (s) for events."""
        self._monitors[number].observe(seconds_ns(time), truth.position, truth.orientation, self._depth)

    def add_events(self, number: int, events: Sequence[RunEvent]) -> None:
        """Set the events that vehicle `number`, or its simulation, has reported so far."""
        self._reported[number] = events

    def _events(self) -> tuple[tuple[str, RunEvent], ...]:
        both = zip(self._nodes, self._reported, self._monitors, strict=True)
        return tuple(
            [(node, event) for node, reported, own in both for event in merge_events(reported, own.log.events())]
        )

    @property
    def judgement(self) -> Judgement:
        """The referee's judgement of the end."""
        return self._referee.judge(self.rows[-1].positions)

    def result(self, case: str = "", mode: Mode = "sil", figures: Mapping[str, float] = NO_FIGURES) -> Result:
        """Return the result so far, with further `figures` by field or, with blanks, by heading."""
        events, judgement, closed = self._events(), self.judgement, self._closed < inf
        faults = list(dict.fromkeys([f"{node}: {e.name}" for node, e in events if e.kind not in self._allow]))
        reason = f"failed by {', '.join(judgement.failures)}" if closed and judgement.failures else self.reason
        reason = f"{reason}, but {', '.join(faults)}" if faults else reason
        clearance, optimum = min(judgement.separation - self._radius, self._nearest), shortest_paths(self.plan)
        touched = any(event.kind == "collision" for _, event in events)
        collided = touched or clearance <= self._radius
        return Result(
            case=case,
            mode=mode,
            seed=self._seed,
            success=closed and judgement.success and not faults and not collided,
            reason=f"collision; {reason}" if collided and not touched else reason,
            duration=self.rows[-1].time,
            path_length=self._travelled,
            optimum=optimum,
            ratio=self._travelled / optimum,
            least_clearance=clearance,
            collided=collided,
            cross_track_rms=sqrt(self._place_error_squares / len(self.rows)),
            cross_track_max=self._place_error_max,
            goal_error=max(self._place_errors(self.rows[-1])),
            events=tuple([f"{node}: {event.describe()}" for node, event in events]),
            extra={
                "least distance between two vehicles (m)": judgement.separation,
                "least distance from the target (m)": self._nearest,
                "formation error (m)": judgement.formation_error,
                "ring error (m)": judgement.ring_error,
                "largest gap round the target (deg)": degrees(judgement.largest_gap),
                "spacing error on the ring (share)": judgement.spacing_error,
                "ring closed after (s)": self._closed,
                **{name: value for name, value in figures.items() if " " in name},
            },
            **{name: value for name, value in figures.items() if " " not in name},
        )

    def _place_errors(self, row: HuntRow) -> list[float]:
        places = [self.plan.position_at(number, clock) for number, clock in enumerate(row.clocks)]
        return list(map(dist, row.positions, places))


def shortest_paths(plan: HuntPlan) -> float:
    """Return the least total length (m) of straight lines from the starts to evenly spaced places on the ring.

    Formation and mutual avoidance are ignored, so every hunt is longer.
    """
    count = len(plan.starts)
    return min(
        sum(map(dist, plan.starts, ends))
        for angle in range(RING_ANGLES)
        for ends in permutations(_ring(plan, 2.0 * pi * angle / (RING_ANGLES * count)))
    )


def _ring(plan: HuntPlan, first: float) -> Sequence[Vector]:
    """Return evenly spaced places around the target, one of them at the bearing `first` (rad)."""
    bearings = [first + 2.0 * pi * number / len(plan.starts) for number in range(len(plan.starts))]
    return [(plan.target[0] + plan.ring * cos(b), plan.target[1] + plan.ring * sin(b)) for b in bearings]


def modem_figures(counts: Mapping[str, int]) -> dict[str, float]:
    """Return the numbers of modem messages by outcome (sent, delivered, lost for a reason), by heading."""
    outcomes = ("sent", "delivered", "collided", "deaf", "damaged", "too_weak") if counts else ()
    return {f"modem: {outcome.replace('_', ' ')}": counts.get(outcome, 0) for outcome in outcomes}

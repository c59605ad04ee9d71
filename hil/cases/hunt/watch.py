"""Record the true positions of a hunt, decide when it ends, and compute its result."""

from collections.abc import Callable, Sequence
from itertools import permutations
from math import cos, dist, inf, pi, sin, sqrt
from typing import NamedTuple

from hil.autonomy.fleets.formation import Vector
from hil.autonomy.fleets.hunting import Criteria, HuntPlan, Judgement, Referee
from hil.common.clock import seconds_ns
from hil.scenario.config import Scenario
from hil.scenario.fleet import hunt_plan, hunting_of
from sim.run_events import EventLog, RunEvent, RunMonitor, merge_events
from sim.sensors.samples import OdometrySample
from sim.vehicle.vehicle import load_vehicle

SETTLE_S = 5.0  # from the end of the last vehicle's plan to the end of the hunt
RING_ANGLES = 180  # rotations of the ring that are tried for the shortest paths
_ROUNDING_S = 1e-6  # rounding error of clocks in messages


class HuntRow(NamedTuple):
    """State at one time (s): true positions (m north, m east), and the time of each vehicle in the plan (s)."""

    time: float
    positions: tuple[Vector, ...]
    clocks: tuple[float, ...]


class HuntOutcome(NamedTuple):
    """Result of a hunt; times in s, lengths in m.

    - `closed`: when the last vehicle's plan ended, inf if it did not.
    - `judgement`: result of the referee.
    - `travelled`: by all vehicles together; `optimum`: the shortest possible, see `shortest_paths`.
    - `target_distance`: least distance of a vehicle's centre from the target.
    - `place_error_rms`, `place_error_max`: distances of vehicles from their places in the plan by their own clocks;
      `end_error`: the greatest at the end.
    - `events`: node and event (sim/run_events.py), with times from the start.
    """

    success: bool
    reason: str
    duration: float
    closed: float
    judgement: Judgement
    travelled: float
    optimum: float
    target_distance: float
    place_error_rms: float
    place_error_max: float
    end_error: float
    events: tuple[tuple[str, RunEvent], ...] = ()


class HuntWatch:
    """Recorder of the rows of a hunt, which decides when it is over; `show` is called with the progress as text.

    Raises ConfigError, MissionError.
    """

    def __init__(self, scenario: Scenario, show: Callable[[str], None] = lambda text: None) -> None:
        self._show = show
        self.plan = hunt_plan(scenario)
        self.rows: list[HuntRow] = []
        self.reason = ""
        self._time_limit = scenario.master.time_limit
        self._depth, self._allow = scenario.master.depth, scenario.master.allow
        self._nodes = [member.node for member in scenario.member]
        vehicle, _ = load_vehicle(scenario.vehicle)
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

    def outcome(self) -> HuntOutcome:
        """Return the result so far."""
        events = self._events()
        faults = list(dict.fromkeys([f"{node}: {e.name}" for node, e in events if e.kind not in self._allow]))
        last, plan = self.rows[-1], self.plan
        judgement = self._referee.judge(last.positions)
        closed = self._closed < inf
        reason = f"failed by {', '.join(judgement.failures)}" if closed and judgement.failures else self.reason
        return HuntOutcome(
            success=closed and judgement.success and not faults,
            reason=f"{reason}, but {', '.join(faults)}" if faults else reason,
            duration=last.time,
            closed=self._closed,
            judgement=judgement,
            travelled=self._travelled,
            optimum=shortest_paths(plan),
            target_distance=self._nearest,
            place_error_rms=sqrt(self._place_error_squares / len(self.rows)),
            place_error_max=self._place_error_max,
            end_error=max(self._place_errors(last)),
            events=events,
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

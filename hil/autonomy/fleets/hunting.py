"""Target hunting by a fleet: the formation approaches a target and closes a ring around it.

Everything is agreed before the dive in one `HuntPlan`: the place of each vehicle at any time of the plan. Then each
vehicle acts for itself (`Hunter`). It has its own clock of the plan, and slows it while it lags behind its place or a
neighbour reports that it is late (formation feedback: Ren & Beard, Journal of Guidance, Control, and Dynamics 27,
2004). Places move to the ring by bearing and distance from the target, which keeps the vehicles in order around it: no
two places meet, and none passes through the target.

Horizontal plane; positions are north, east in m. The target does not move.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import atan2, cos, dist, inf, pi, sin
from typing import NamedTuple

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.autonomy.fleets.formation import Body, FieldSettings, Vector, formation_error, resultant, separation
from hil.common.errors import MissionError

_KEEP_OFF = 1.2  # ring radii; the approach ends when the first place is this close to the target
_WAIT = 0.5  # 1/s; slowdown of a clock for each second that a neighbour's clock is behind
_LAG = 0.3  # m; distance from its place at which a vehicle's clock has half its pace
_PACE = 0.7  # share of the top speed with which places move; the rest is for catching up
_TINY = 1e-3  # s, for velocities by finite differences


class HuntPlan:
    """Plan of a hunt: each vehicle's place, by the plan's clock (s).

    From `starts` the formation moves unchanged towards `target`, then opens into a ring of radius `ring` m. `speed` m/s
    is the vehicles' top speed. `approach` and `duration` are the times (s) when the ring begins to form and when it is
    closed. Raises MissionError if vehicles start within the ring or there are fewer than three.
    """

    def __init__(self, starts: Sequence[Vector], target: Vector, ring: float, speed: float) -> None:
        if len(starts) < 3:
            raise MissionError(f"{len(starts)} vehicles cannot surround a target; it takes three")
        if min(dist(start, target) for start in starts) < _KEEP_OFF * ring:
            raise MissionError(f"a vehicle starts within {_KEEP_OFF * ring:.1f} m of the target; lessen the ring")
        self.starts, self.target, self.ring = tuple(starts), target, ring
        centre = sum(p[0] for p in starts) / len(starts), sum(p[1] for p in starts) / len(starts)
        self._advance_vector = self._advance(centre)
        back = atan2(centre[1] - target[1], centre[0] - target[0])
        polar = (_polar(target, (p[0] + self._advance_vector[0], p[1] + self._advance_vector[1])) for p in starts)
        self._polar = [(distance, back + wrap(bearing - back)) for distance, bearing in polar]
        self._bearings = _space_evenly([bearing for _, bearing in self._polar])
        longest = max(
            abs(distance - ring) + distance * abs(end - bearing)
            for (distance, bearing), end in zip(self._polar, self._bearings, strict=True)
        )
        self.approach = dist((0.0, 0.0), self._advance_vector) / (_PACE * speed)
        self.duration = self.approach + longest / (_PACE * speed)

    def position_at(self, number: int, clock: float) -> Vector:
        """Return the position (m, north and east) of vehicle `number` when the plan's clock shows `clock` s."""
        if clock < self.approach:
            share = max(0.0, clock) / self.approach
            north, east = self.starts[number]
            return north + share * self._advance_vector[0], east + share * self._advance_vector[1]
        share = min(1.0, (clock - self.approach) / (self.duration - self.approach))
        distance, bearing = self._polar[number]
        distance += share * (self.ring - distance)
        bearing += share * (self._bearings[number] - bearing)
        return self.target[0] + distance * cos(bearing), self.target[1] + distance * sin(bearing)

    def velocity(self, number: int, clock: float) -> Vector:
        """Return the velocity of that place, in m per second of the plan's clock."""
        before, after = self.position_at(number, clock - _TINY), self.position_at(number, clock + _TINY)
        return (after[0] - before[0]) / (2.0 * _TINY), (after[1] - before[1]) / (2.0 * _TINY)

    def _advance(self, centre: Vector) -> Vector:
        """Return the vector by which the formation moves unchanged, until its first place is near the ring."""
        north, east = self.target[0] - centre[0], self.target[1] - centre[1]
        advance = 0.0, 0.0
        for percent in range(1, 101):
            on = 0.01 * percent * north, 0.01 * percent * east
            if any(dist((p[0] + on[0], p[1] + on[1]), self.target) < _KEEP_OFF * self.ring for p in self.starts):
                break
            advance = on
        return advance


class Report(NamedTuple):
    """State of a neighbour: position (m north, m east), its clock of the plan (s), and whether to stay in its range."""

    position: Vector
    clock: float
    stays_in_range: bool = True


class Hunter:
    """Controller of one vehicle of a hunt: vehicle `number` of the `plan`.

    `min_separation`: the least distance (m) between the centres of two vehicles. `clock`: its own clock of the plan, s.
    """

    def __init__(self, plan: HuntPlan, number: int, settings: FieldSettings, min_separation: float) -> None:
        self.clock = 0.0
        self._plan = plan
        self._number = number
        self._settings = settings
        self._min_separation = min_separation

    def update(self, position: Vector, reports: Sequence[Report], dt: float) -> Vector:
        """Return the target velocity (m/s) at `position`, `dt` s after the last call.

        `reports` are those of other vehicles; those from beyond the communication range are ignored. With `dt` 0 the
        clock stands still, and so does the vehicle's place.
        """
        in_range = [r for r in reports if dist(r.position, position) < self._settings.communication_range]
        lag = dist(position, self._plan.position_at(self._number, self.clock)) / _LAG
        pace = 1.0 / (1.0 + lag * lag)
        slowdown = _WAIT * sum(max(0.0, self.clock - report.clock) for report in in_range)
        before = self.clock
        self.clock = min(before + dt * max(0.0, pace - slowdown), self._plan.duration)
        rate = (self.clock - before) / dt if dt > 0.0 else 0.0
        north, east = self._plan.velocity(self._number, self.clock)
        return resultant(
            position,
            self._plan.position_at(self._number, self.clock),
            (rate * north, rate * east),
            [Body(report.position, self._min_separation, report.stays_in_range) for report in in_range],
            [Body(self._plan.target, self._min_separation)],
            self._settings,
        )

    def command(self, position: Vector, heading: float, reports: Sequence[Report], dt: float) -> VelocityCommand:
        """Return the command for the velocity of `update`; the bow (`heading`, rad) turns to the target."""
        north, east = self.update(position, reports, dt)
        target = self._plan.target
        error = wrap(atan2(target[1] - position[1], target[0] - position[0]) - heading)
        c, s = cos(heading), sin(heading)
        return VelocityCommand(
            surge=north * c + east * s, sway=east * c - north * s, yaw_rate=min(max(error, -0.5), 0.5)
        )


class Criteria(NamedTuple):
    """Success criteria of a hunt.

    Over the whole hunt: distance of any two centres above `separation` m. During the approach: formation error up to
    `formation` m. At the end: every vehicle within `ring` of the ring, as a share of its radius; no gap between
    neighbours, seen from the target, above `gap` rad; relative error of the spacing between neighbours up to `spacing`.
    """

    separation: float
    formation: float = 0.5
    ring: float = 0.25
    gap: float = 2.0
    spacing: float = 0.25


class Judgement(NamedTuple):
    """Results of a hunt, in the criteria's units. `failures` names the criteria that are not met."""

    separation: float
    formation_error: float
    ring_error: float
    largest_gap: float
    spacing_error: float
    failures: tuple[str, ...]

    @property
    def success(self) -> bool:
        """True if all criteria are met."""
        return not self.failures


class Referee:
    """Evaluate the true positions of the vehicles against the criteria."""

    def __init__(self, plan: HuntPlan, criteria: Criteria) -> None:
        self._plan = plan
        self._criteria = criteria
        self._separation = inf
        self._formation_error = 0.0

    def watch(self, positions: Sequence[Vector], clock: float) -> None:
        """Record all positions at one time; `clock` is that of the fastest vehicle, s."""
        self._separation = min(self._separation, separation(positions))
        if clock < self._plan.approach:
            self._formation_error = max(self._formation_error, formation_error(positions, self._plan.starts))

    def judge(self, positions: Sequence[Vector]) -> Judgement:
        """Return the results, with the vehicles at their last positions."""
        plan, criteria = self._plan, self._criteria
        polar = sorted((_polar(plan.target, position) for position in positions), key=lambda p: p[1])
        ring_error = max(abs(distance - plan.ring) for distance, _ in polar)
        gaps = [(b[1] - a[1]) % (2.0 * pi) for a, b in pairwise([*polar, polar[0]])]
        around = sorted(positions, key=lambda position: _polar(plan.target, position)[1])
        right = 2.0 * plan.ring * sin(pi / len(positions))
        spacing_error = max(abs(dist(a, b) / right - 1.0) for a, b in pairwise([*around, around[0]]))
        figures = self._separation, self._formation_error, ring_error, max(gaps), spacing_error
        most = criteria._replace(ring=criteria.ring * plan.ring)
        within = [value <= limit for value, limit in zip(figures[1:], most[1:], strict=True)]
        met = figures[0] > criteria.separation, *within
        failures = tuple(name for name, ok in zip(Criteria._fields, met, strict=True) if not ok)
        return Judgement(*figures, failures)


def _polar(target: Vector, position: Vector) -> tuple[float, float]:
    """Return distance (m) and bearing (rad) of `position` from `target`."""
    return dist(target, position), atan2(position[1] - target[1], position[0] - target[0])


def _space_evenly(bearings: Sequence[float]) -> list[float]:
    """Return evenly spaced bearings around the target, in the order of `bearings` and as near to them as possible."""
    apart = 2.0 * pi / len(bearings)
    order = sorted(range(len(bearings)), key=lambda number: bearings[number])
    rank = {number: place for place, number in enumerate(order)}
    first = sum(bearing - apart * rank[number] for number, bearing in enumerate(bearings)) / len(bearings)
    return [first + apart * rank[number] for number in range(len(bearings))]

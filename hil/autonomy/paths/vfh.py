"""Obstacle avoidance from scans: the vector field histogram VFH+.

Ulrich & Borenstein, "VFH+: Reliable Obstacle Avoidance for Fast Mobile Robots", ICRA 1998: obstacles widened by the
vehicle's size fill sectors around it; two thresholds keep a sector's state from flickering; directions that the
least turning circle cannot reach are masked; of the openings that are left the one of least cost is taken.

Two things differ. A sector takes the magnitude of the nearest obstacle in it where the paper adds up the cells of a
grid: the thresholds are then distances, the same for any number of beams, and one beam on a thin post is enough. And
the speed falls with the water ahead and with the turn to make, which VFH+ leaves open; the vehicle stops where no
direction is free. (The reference platform's own rule for the speed could not be compared.)

All in the level plane. Headings and sectors in rad from north, clockwise seen from above; a scan's angles from the
bow, starboard positive. Currents are not modelled.
"""

from collections.abc import Sequence
from math import asin, ceil, cos, floor, hypot, inf, isfinite, pi, sin
from typing import Annotated, NamedTuple

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.common.schema import Range


class Scan(NamedTuple):
    """A scan of a laser or sonar: distances in m, at angles `first`, `first` + `step`, ... rad from the bow.

    A distance that is not finite or not above 0 means that nothing came back.
    """

    first: float
    step: float
    ranges: Sequence[float]

    def points(self) -> list[tuple[float, float]]:
        """Yield angle and distance of every echo."""
        return [
            (self.first + number * self.step, distance)
            for number, distance in enumerate(self.ranges)
            if isfinite(distance) and distance > 0.0
        ]


class VfhSettings(NamedTuple):
    """`radius` m of the vehicle, `safety` m to keep beyond it; what is farther than `range` m does not count.

    Below `block_within` m a sector becomes blocked, beyond `free_beyond` m free again. `turning_radius` in m
    is that of the least circle (0: turns on the spot). An opening wider than `wide` rad is passed at its
    side. The weights are those of VFH+'s cost: for the target, the present heading, the last choice; the first
    should exceed the sum of the others.
    """

    radius: Annotated[float, Range(0.01, 20.0, "m")]
    safety: Annotated[float, Range(0.0, 20.0, "m")] = 0.3
    range: Annotated[float, Range(0.1, 200.0, "m")] = 6.0
    block_within: Annotated[float, Range(0.1, 200.0, "m")] = 3.0
    free_beyond: Annotated[float, Range(0.1, 200.0, "m")] = 3.6
    sectors: Annotated[int, Range(8, 720)] = 72
    turning_radius: Annotated[float, Range(0.0, 100.0, "m")] = 0.0
    wide: Annotated[float, Range(0.05, pi, "rad")] = 0.8
    target_weight: Annotated[float, Range(0.0, 100.0)] = 5.0
    heading_weight: Annotated[float, Range(0.0, 100.0)] = 2.0
    last_weight: Annotated[float, Range(0.0, 100.0)] = 2.0

    def validate(self) -> str | None:
        """Return what is wrong between the keys, or None."""
        if not self.radius + self.safety < self.block_within <= self.free_beyond <= self.range:
            return "radius + safety, block_within, free_beyond and range must grow in this order"
        return None


class Vfh:
    """Choose the direction of travel, scan by scan.

    `density` (0 to 1), `blocked` and `masked` are of each sector, sector k being centred on k x 2 pi / `sectors`
    from north. What is out of the scan's sight keeps its state.
    """

    def __init__(self, settings: VfhSettings) -> None:
        self.density = [0.0] * settings.sectors
        self.blocked = [False] * settings.sectors
        self.masked = [False] * settings.sectors
        self._settings = settings
        self._width = 2.0 * pi / settings.sectors
        self._clearance = settings.radius + settings.safety
        self._last: float | None = None

    def steer(self, scan: Scan, heading: float, target: float, reach: float = inf) -> float | None:
        """Return the free heading (rad) that leads best to the heading `target`; None if there is none.

        `heading` is the vehicle's own, rad. What is farther away than `reach` m, beyond the goal, does not count.
        """
        echoes = [
            (angle, distance) for angle, distance in scan.points() if distance <= min(reach, self._settings.range)
        ]
        self._fill(scan, echoes, heading)
        self.blocked = list(map(self._hysteresis, self.density, self.blocked))
        self._mask(echoes, heading)
        candidates = self._candidates(target)
        if not candidates:
            self._last = None
            return None
        self._last = min(candidates, key=lambda candidate: self._cost(candidate, heading, target))
        return self._last

    def command(
        self, scan: Scan, heading: float, target: float, speed: float, max_yaw_rate: float = 0.5, reach: float = inf
    ) -> VelocityCommand:
        """Return the command for the heading of `steer`: at most `speed` m/s ahead and `max_yaw_rate` rad/s.

        The speed falls with the cosine of the turn to make, and evenly with the free water straight ahead from
        `block_within` down to nothing at the distance of radius and safety. Without a free heading the vehicle
        turns on the spot towards its target, to look for one.
        """
        free = self.steer(scan, heading, target, reach)
        error = wrap((target if free is None else free) - heading)
        turn = min(max(error, -max_yaw_rate), max_yaw_rate)  # a gain of 1/s
        if free is None:
            return VelocityCommand(yaw_rate=turn)
        room = (self._ahead(scan) - self._clearance) / (self._settings.block_within - self._clearance)
        return VelocityCommand(surge=speed * max(0.0, cos(error)) * min(1.0, max(0.0, room)), yaw_rate=turn)

    def _fill(self, scan: Scan, echoes: list[tuple[float, float]], heading: float) -> None:
        """Return the polar histogram: for each visible sector the magnitude of the nearest obstacle, widened."""
        half = 0.5 * abs(scan.step)
        ends = sorted((scan.first, scan.first + scan.step * (len(scan.ranges) - 1)))
        for sector in self._between(heading + ends[0] - half, heading + ends[1] + half):
            self.density[sector] = 0.0
        for angle, distance in echoes:
            spread = asin(self._clearance / distance) if distance > self._clearance else pi / 2.0
            magnitude = 1.0 - (distance / self._settings.range) ** 2
            for sector in self._between(heading + angle - spread, heading + angle + spread):
                self.density[sector] = max(self.density[sector], magnitude)

    def _between(self, low: float, high: float) -> list[int]:
        """Return the sectors whose centre lies between two headings, `low` below `high`."""
        count = self._settings.sectors
        first, last = ceil(low / self._width), floor(high / self._width)
        return [sector % count for sector in range(first, min(last, first + count - 1) + 1)]

    def _hysteresis(self, density: float, blocked: bool) -> bool:
        threshold = self._settings.free_beyond if blocked else self._settings.block_within
        return density > 1.0 - (threshold / self._settings.range) ** 2

    def _mask(self, echoes: list[tuple[float, float]], heading: float) -> None:
        """Mask what lies behind an obstacle that the least circle to that side would hit."""
        circle = self._settings.turning_radius
        port, starboard = -pi, pi
        for angle, distance in echoes if circle else ():
            angle = wrap(angle)
            side = circle if angle > 0.0 else -circle
            if hypot(distance * cos(angle), distance * sin(angle) - side) < circle + self._clearance:
                port, starboard = (port, min(starboard, angle)) if angle > 0.0 else (max(port, angle), starboard)
        turns = [wrap(sector * self._width - heading) for sector in range(self._settings.sectors)]
        self.masked = [not port <= turn <= starboard for turn in turns]

    def _candidates(self, target: float) -> list[float]:
        """Return the candidate headings: through the middle of narrow openings, along the sides of wide ones."""
        closed = [blocked or masked for blocked, masked in zip(self.blocked, self.masked, strict=True)]
        if not any(closed):
            return [target]
        headings: list[float] = []
        for first, count in _openings(closed):
            low, span = (first - 0.5) * self._width, count * self._width
            if span <= self._settings.wide:
                headings.append(wrap(low + 0.5 * span))
                continue
            half = 0.5 * self._settings.wide
            headings += [wrap(low + half), wrap(low + span - half)]
            if half <= (target - low) % (2.0 * pi) <= span - half:
                headings.append(wrap(target))
        return headings

    def _cost(self, candidate: float, heading: float, target: float) -> float:
        settings = self._settings
        last = candidate if self._last is None else self._last
        return (
            settings.target_weight * abs(wrap(candidate - target))
            + settings.heading_weight * abs(wrap(candidate - heading))
            + settings.last_weight * abs(wrap(candidate - last))
        )

    def _ahead(self, scan: Scan) -> float:
        """Return how far (m) the vehicle can go straight on before an obstacle is abeam within the safety distance."""
        ahead = [d * cos(angle) for angle, d in scan.points() if abs(d * sin(angle)) < self._clearance]
        return min((distance for distance in ahead if distance > 0.0), default=inf)


def _openings(closed: list[bool]) -> list[tuple[int, int]]:
    """Return first sector and number of sectors of every run of open ones, all round; at least one is closed."""
    count, start = len(closed), closed.index(True)
    runs: list[tuple[int, int]] = []
    for step in range(1, count):
        sector = (start + step) % count
        if closed[sector]:
            continue
        if runs and not closed[sector - 1]:
            runs[-1] = runs[-1][0], runs[-1][1] + 1
        else:
            runs.append((sector, 1))
    return runs

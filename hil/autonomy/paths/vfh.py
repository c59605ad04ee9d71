"""Avoid obstacles by scans with the vector field histogram VFH+.

Ulrich & Borenstein, "VFH+: Reliable Obstacle Avoidance for Fast Mobile Robots", ICRA 1998. The directions around the
vehicle are divided into sectors. Obstacles, widened by the vehicle's size, block the sectors that they cover. Two
thresholds (a hysteresis) keep a sector from flickering between blocked and free. Directions that the vehicle cannot
reach on its smallest turning circle are masked. Of the remaining openings, the one of least cost is taken.

This implementation differs from the paper in two ways. First, the magnitude of a sector comes from its nearest
obstacle, not from a sum over the cells of a grid: the thresholds are then distances, independent of the number of
beams, and one beam on a thin post is enough. Second, the speed, which VFH+ leaves open, falls with the free distance
ahead and with the turn to make; the vehicle stops when no direction is free. (It could not be compared with the
reference platform's rule for the speed.)

All geometry is in the horizontal plane. Headings and sectors are in rad from north, clockwise seen from above; angles
of a scan are from the bow, positive to starboard. Currents are not modelled.
"""

from collections.abc import Sequence
from math import asin, ceil, cos, floor, hypot, inf, isfinite, pi, sin
from typing import Annotated, NamedTuple

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.common.schema import Range


class Scan(NamedTuple):
    """A scan of a laser or sonar: distances in m, at angles `first`, `first` + `step`, ... rad from the bow.

    A distance that is not finite, or not above 0, means no echo.
    """

    first: float
    step: float
    ranges: Sequence[float]

    def points(self) -> list[tuple[float, float]]:
        """Return angle (rad) and distance (m) of every echo."""
        return [
            (self.first + number * self.step, distance)
            for number, distance in enumerate(self.ranges)
            if isfinite(distance) and distance > 0.0
        ]


class VfhSettings(NamedTuple):
    """Settings of a `Vfh`. The vehicle has `radius` m and keeps `safety` m more from obstacles.

    Obstacles farther than `range` m are ignored. A sector becomes blocked when an obstacle is nearer than
    `block_within` m, and free again when none is nearer than `free_beyond` m. `turning_radius` (m) is that of the
    smallest turning circle; 0 means that the vehicle turns on the spot. The vehicle passes an opening wider than `wide`
    rad along its side. The weights are those of VFH+'s cost for deviations from the target, from the present heading
    and from the last choice; the first should exceed the sum of the other two.
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
        """Return an error message if keys contradict each other, else None."""
        if not self.radius + self.safety < self.block_within <= self.free_beyond <= self.range:
            return "radius + safety, block_within, free_beyond and range must grow in this order"
        return None


class Vfh:
    """Choose the direction of travel, scan by scan.

    `density` (0 to 1), `blocked` and `masked` have one value per sector; the centre of sector k is at k x 2 pi /
    `sectors` from north. Sectors outside of the scan keep their state.
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
        """Return the free heading (rad) of least cost on the way to the heading `target`; None if no heading is free.

        `heading` (rad) is the vehicle's own. Obstacles farther than `reach` m, that is beyond the goal, are ignored.
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

        The speed falls with the cosine of the turn to make. It also falls linearly with the free distance straight
        ahead, from `block_within` to zero at radius + safety. If no heading is free, the vehicle turns on the spot
        towards the target, to find one.
        """
        free = self.steer(scan, heading, target, reach)
        error = wrap((target if free is None else free) - heading)
        yaw_rate = min(max(error, -max_yaw_rate), max_yaw_rate)  # a gain of 1/s
        if free is None:
            return VelocityCommand(yaw_rate=yaw_rate)
        room = (self._ahead(scan) - self._clearance) / (self._settings.block_within - self._clearance)
        return VelocityCommand(surge=speed * max(0.0, cos(error)) * min(1.0, max(0.0, room)), yaw_rate=yaw_rate)

    def _fill(self, scan: Scan, echoes: list[tuple[float, float]], heading: float) -> None:
        """Update the polar histogram: the magnitude of each visible sector is that of its nearest widened obstacle."""
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
        """Return the sectors whose centre lies between the headings `low` and `high` (rad; `low` is below `high`)."""
        count = self._settings.sectors
        first, last = ceil(low / self._width), floor(high / self._width)
        return [sector % count for sector in range(first, min(last, first + count - 1) + 1)]

    def _hysteresis(self, density: float, blocked: bool) -> bool:
        threshold = self._settings.free_beyond if blocked else self._settings.block_within
        return density > 1.0 - (threshold / self._settings.range) ** 2

    def _mask(self, echoes: list[tuple[float, float]], heading: float) -> None:
        """Mask directions behind an obstacle that the smallest turning circle to that side would hit."""
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
        """Return the candidate headings: the middle of narrow openings, headings along the sides of wide ones."""
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
    """Return first sector and length of every run of open sectors, all round; at least one sector must be closed."""
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

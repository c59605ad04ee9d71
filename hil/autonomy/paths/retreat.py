"""Back out of a dead end along the vehicle's own track, when it makes no progress.

VFH sees only directions that are free now. In front of a gap that the path on the map allows, but that is too narrow
for its safety distance, it turns to and fro for ever; so it does in a pocket. The way in was free, so the vehicle takes
it out again.
"""

from collections import deque
from math import cos, dist, hypot, inf, sin

from hil.autonomy.control.controller import VelocityCommand
from hil.autonomy.paths.occupancy import Point

_LEAST_PATIENCE_S = 20.0
_GAP_S = 3.0  # between two positions; a vehicle that was stopped for so long has not tried


class Retreat:
    """Retreat of a vehicle that travels at `speed` m/s, astern and sideways too: at most `length` m at half the speed.

    There is no progress if it has stayed within `reach` m for `patience` s; with inf it never retreats.
    """

    def __init__(self, reach: float, length: float, speed: float) -> None:
        self.patience = max(_LEAST_PATIENCE_S, 6.0 * reach / speed)
        self._reach, self._length, self._speed = reach, length, 0.5 * speed
        self._track: list[Point] = []
        self._recent: deque[tuple[float, Point]] = deque()
        self._left = 0.0  # m of the retreat that remain

    @property
    def is_active(self) -> bool:
        """Whether the vehicle is on its way back."""
        return self._left > 0.0

    def makes_progress(self, time: float, point: Point) -> bool:
        """Store that the vehicle is at `point` (m north, m east) at `time` s; return False if it should retreat."""
        if not self._track or dist(point, self._track[-1]) > 0.25 * self._reach:
            self._track.append(point)
        if self._recent and time - self._recent[-1][0] > _GAP_S:
            self._recent.clear()
        self._recent.append((time, point))
        while len(self._recent) > 1 and self._recent[1][0] <= time - self.patience:
            self._recent.popleft()
        if time - self._recent[0][0] < self.patience:
            return True
        return max(dist(point, other) for _, other in self._recent) > self._reach

    def begin(self) -> None:
        """Begin to go back."""
        self._left = self._length
        self._recent.clear()

    def command(self, point: Point, heading: float) -> VelocityCommand:
        """Return the command that leads back along the track from `point`, with the present `heading` (rad)."""
        while self._track and dist(point, self._track[-1]) < 0.25 * self._reach:
            last = self._track.pop()
            self._left -= dist(last, self._track[-1]) if self._track else inf
        if not self._track or not self.is_active:
            self._left = 0.0
            return VelocityCommand()
        north, east = (a - b for a, b in zip(self._track[-1], point, strict=True))
        share = self._speed / max(hypot(north, east), 1e-9)
        return VelocityCommand(
            surge=share * (north * cos(heading) + east * sin(heading)),
            sway=share * (east * cos(heading) - north * sin(heading)),
        )

"""A vehicle's track: past positions, thinned out as they become many."""

from math import dist

from hil.common.vectors import Vector3

STEP = 0.1  # m between two points
MAX_POINTS = 4000  # an even number; beyond it every second point is removed


class Track:
    """Past positions (NED, m). The page adds the newest itself, by the same rule."""

    def __init__(self) -> None:
        self.points: list[Vector3] = []

    def add(self, point: Vector3) -> None:
        """Add a position, unless it is within STEP of the last."""
        if not self.points or dist(point, self.points[-1]) >= STEP:
            self.points.append(point)
        if len(self.points) > MAX_POINTS:
            self.points = self.points[::2]

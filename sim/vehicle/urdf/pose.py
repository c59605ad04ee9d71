"""Poses of a URDF's frames, in the axes of its base link (FLU)."""

from typing import NamedTuple

from sim.matrices import Matrix, product

_IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


class Pose(NamedTuple):
    """Pose of a frame in the base link's: `rotation` 3x3 from it to the base, `position` in m."""

    rotation: Matrix = _IDENTITY
    position: tuple[float, ...] = (0.0, 0.0, 0.0)

    def turn(self, vector: tuple[float, ...]) -> tuple[float, ...]:
        """Return a direction of this frame in the base's axes."""
        return tuple(sum(a * x for a, x in zip(row, vector, strict=True)) for row in self.rotation)

    def then(self, inner: "Pose") -> "Pose":
        """Return the pose of a frame that is at `inner` in this one."""
        moved = zip(self.position, self.turn(inner.position), strict=True)
        return Pose(product(self.rotation, inner.rotation), tuple(a + b for a, b in moved))

"""Poses of frames relative to a base frame (axes FLU)."""

from collections.abc import Sequence
from math import asin, atan2
from typing import NamedTuple

from sim.matrices import Matrix, product, square, transpose
from sim.rotations import from_euler, matrix, normalise

_IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


class Pose(NamedTuple):
    """Pose of a frame relative to the base: `rotation` (3x3) from the frame to the base, `position` in m."""

    rotation: Matrix = _IDENTITY
    position: tuple[float, ...] = (0.0, 0.0, 0.0)

    def rotate(self, vector: Sequence[float]) -> tuple[float, ...]:
        """Return a direction of this frame in the base's axes."""
        return tuple(sum(a * x for a, x in zip(row, vector, strict=True)) for row in self.rotation)

    def then(self, inner: "Pose") -> "Pose":
        """Return the pose, relative to the base, of a frame whose pose relative to this one is `inner`."""
        return Pose(product(self.rotation, inner.rotation), self.transform(inner.position))

    def transform(self, point: Sequence[float]) -> tuple[float, ...]:
        """Return a point of this frame in the base frame."""
        return tuple(a + b for a, b in zip(self.position, self.rotate(point), strict=True))

    def inverse(self) -> "Pose":
        """Return the pose of the base in this frame."""
        back = Pose(transpose(self.rotation))
        return Pose(back.rotation, tuple(-x for x in back.rotate(self.position)))

    def angles(self) -> tuple[float, float, float]:
        """Return roll, pitch and yaw (rad) of its axes."""
        (xx, _, _), (yx, _, _), (zx, zy, zz) = self.rotation
        return atan2(zy, zz), asin(max(-1.0, min(1.0, -zx))), atan2(yx, xx)


def pose_at(position: Sequence[float], angles: Sequence[float] = (0.0, 0.0, 0.0)) -> Pose:
    """Return the pose at `position` (m) whose axes are turned by roll, pitch and yaw (rad)."""
    return Pose(square(matrix(from_euler(*angles)), 3), tuple(position))


def pose_with(position: Sequence[float], quaternion: Sequence[float]) -> Pose:
    """Return the pose at `position` (m) with the rotation of a quaternion (x, y, z, w; of any length except 0)."""
    x, y, z, w = quaternion
    is_zero = not any(quaternion)
    return Pose(square(matrix(normalise((1.0 if is_zero else w, x, y, z))), 3), tuple(position))

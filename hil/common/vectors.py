"""Types of vectors in space: tuples of floats, which cost the real-time loop less than objects or arrays."""

from collections.abc import Sequence
from math import sqrt

Vector3 = tuple[float, float, float]  # x, y, z, in the frame that the value's name or docstring states
Quaternion = tuple[float, float, float, float]  # w, x, y, z, from the body frame to the world frame


def minus(a: Sequence[float], b: Sequence[float]) -> Vector3:
    """Return the difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def cross(a: Sequence[float], b: Sequence[float]) -> Vector3:
    """Return the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the dot product of two vectors of equal length."""
    return sum([x * y for x, y in zip(a, b, strict=True)])


def unit(vector: Sequence[float]) -> Vector3:
    """Return the unit vector in the same direction; the zero vector for a zero vector."""
    x, y, z = vector
    length = sqrt(x * x + y * y + z * z) or 1.0
    return x / length, y / length, z / length


def off_line(
    north: float, east: float, from_north: float, from_east: float, to_north: float, to_east: float
) -> tuple[float, float]:
    """Return the vector (m north, m east) from the nearest point of a line segment to a position."""
    x, y, at_x, at_y = to_north - from_north, to_east - from_east, north - from_north, east - from_east
    square = x * x + y * y
    share = min(max((at_x * x + at_y * y) / square, 0.0), 1.0) if square else 0.0
    return at_x - share * x, at_y - share * y

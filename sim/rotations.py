"""Attitude as a unit quaternion (w, x, y, z) that turns body axes (FRD) into world axes (NED).

Functions that a step uses need only `+ - * /` and `sqrt`; only the Euler conversions need sines and cosines.
"""

from collections.abc import Sequence
from math import asin, atan2, cos, sin, sqrt

from hil.common.vectors import Quaternion, Vector3

# A 3x3 matrix, row after row: (xx, xy, xz, yx, yy, yz, zx, zy, zz).
Rotation = tuple[float, float, float, float, float, float, float, float, float]


def matrix(quaternion: Sequence[float]) -> Rotation:
    """Return the rotation matrix R, body to world: world = R body, body = R' world."""
    w, x, y, z = quaternion
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz = x * y, x * z, y * z
    wx, wy, wz = w * x, w * y, w * z
    return (
        1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy),
        2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx),
        2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy),
    )  # fmt: skip


def down_axis(quaternion: Sequence[float]) -> Vector3:
    """Return the world's down axis in body axes, a unit vector: the last row of the rotation matrix."""
    w, x, y, z = quaternion
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


def rotate(quaternion: Sequence[float], body: Sequence[float]) -> Vector3:
    """Return a vector of body axes in world axes."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix(quaternion)
    x, y, z = body
    return xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z


def rotate_inverse(quaternion: Sequence[float], world: Sequence[float]) -> Vector3:
    """Return a vector of world axes in body axes."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix(quaternion)
    x, y, z = world
    return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


def multiply(first: Sequence[float], second: Sequence[float]) -> Quaternion:
    """Return the Hamilton product: the rotation `second`, then `first`, both about world axes."""
    a, b, c, d = first
    w, x, y, z = second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def normalise(quaternion: Sequence[float]) -> Quaternion:
    """Return the quaternion with length 1. Raises FloatingPointError for one of length 0."""
    w, x, y, z = quaternion
    length = sqrt(w * w + x * x + y * y + z * z)
    if length == 0.0:
        raise FloatingPointError("a quaternion of length 0")
    scale = 1.0 / length
    return w * scale, x * scale, y * scale, z * scale


def integrate(quaternion: Sequence[float], omega: Sequence[float], dt: float) -> Quaternion:
    """Return the attitude after turning for `dt` seconds at `omega` (p, q, r in rad/s along the body axes).

    Uses the Cayley map, which needs no sines: the angle a = |omega| dt of a step is a**3 / 12 too small, which is
    1e-8 rad at 2 rad/s and 2.5 ms.
    """
    a, b, c, d = quaternion
    p, q, r = omega
    half = 0.5 * dt
    x, y, z = half * p, half * q, half * r
    # the product of the quaternion and (1, x, y, z)
    return normalise(
        (a - b * x - c * y - d * z, a * x + b + c * z - d * y, a * y - b * z + c + d * x, a * z + b * y - c * x + d)
    )


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the quaternion of Euler angles in rad: yaw about z, then pitch about y, then roll about x (ZYX)."""
    cr, sr = cos(0.5 * roll), sin(0.5 * roll)
    cp, sp = cos(0.5 * pitch), sin(0.5 * pitch)
    cy, sy = cos(0.5 * yaw), sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def to_euler(quaternion: Sequence[float]) -> Vector3:
    """Return roll, pitch and yaw (ZYX) in rad: roll and yaw within ±pi, pitch within ±pi/2."""
    xx, _, _, yx, _, _, zx, zy, zz = matrix(quaternion)
    return atan2(zy, zz), asin(max(-1.0, min(1.0, -zx))), atan2(yx, xx)

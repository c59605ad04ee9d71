"""Convert NED and FRD to the axes of the scene.

The scene has x east, y north, z up; a vehicle in it has x forward, y left, z up.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np


def to_scene(points: Any) -> Any:
    """Return n x 3 points in NED (m) in the axes of the scene."""
    north, east, down = np.asarray(points, float).reshape(-1, 3).T
    return np.stack([east, north, -down], axis=1)


def from_scene(point: Sequence[float]) -> tuple[float, float, float]:
    """Return a point of the scene as north, east, depth (m)."""
    east, north, up = (float(value) for value in point)
    return north, east, -up


def to_body(points: Any) -> Any:
    """Return n x 3 points in FRD in the axes of a vehicle in the scene."""
    x, y, z = np.asarray(points, float).reshape(-1, 3).T
    return np.stack([x, -y, -z], axis=1)


def body_attitude(quaternion: Sequence[float]) -> tuple[float, float, float, float]:
    """Convert the attitude (w, x, y, z) of a sensor from FRD to the axes of a vehicle in the scene."""
    w, x, y, z = quaternion
    return w, x, -y, -z

"""Move the cameras of browsers along with a vehicle."""

from collections.abc import Sequence
from typing import Any

import numpy as np

CAMERA_OFFSET = (-1.8, -3.0, 1.8)  # m, from the vehicle to a camera that follows it
MIN_DISTANCE = 1e-3  # m


def move_camera(camera: Any, position: Sequence[float]) -> None:
    """Point the camera at a vehicle's `position`, and keep the direction and distance that a person has chosen.

    A slow browser reports its camera late. The reported position may be old, but its offset from the reported point
    that the camera looks at is still valid.
    """
    offset = np.asarray(camera.position) - np.asarray(camera.look_at)
    if np.linalg.norm(offset) < MIN_DISTANCE:
        offset = np.array(CAMERA_OFFSET)
    camera.position = np.asarray(position) + offset
    camera.look_at = np.asarray(position)

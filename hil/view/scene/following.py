"""Move the cameras of browsers along with a vehicle."""

from collections.abc import Sequence
from typing import Any

import numpy as np

CAMERA_OFFSET = (-1.8, -3.0, 1.8)  # m, from the vehicle to a camera that follows
LEAST_DISTANCE = 1e-3  # m


def follow(camera: Any, place: Sequence[float]) -> None:
    """Have the camera look at a vehicle's place, from the side and the distance that a person has turned it to.

    A slow browser reports its camera late. So the last report does not show where the camera is now, but its place
    and the point that it looks at belong together.
    """
    offset = np.asarray(camera.position) - np.asarray(camera.look_at)
    if np.linalg.norm(offset) < LEAST_DISTANCE:
        offset = np.array(CAMERA_OFFSET)
    camera.position = np.asarray(place) + offset
    camera.look_at = np.asarray(place)

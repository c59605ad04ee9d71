"""A camera that follows a vehicle, in a browser that reports its view late."""

from collections import deque
from typing import Any

import numpy as np
import pytest

from hil.view.scene.following import CAMERA_OFFSET, move_camera

STEP = np.array([0.04, 0.02, 0.0])  # m a frame: 0.9 m/s


class Camera:
    """A camera as in viser: setting its position also moves the point that it looks at."""

    def __init__(self, position: Any, offset: Any) -> None:
        self._position, self.look_at = position + offset, position

    @property
    def position(self) -> Any:
        return self._position

    @position.setter
    def position(self, value: Any) -> None:
        self.look_at = self.look_at + value - self._position
        self._position = value

    def report(self, position: Any, look_at: Any) -> None:
        """Receive the view that a browser shows."""
        self._position, self.look_at = position, look_at


@pytest.mark.parametrize("frames_late", [0, 1, 20])
def test_the_camera_does_not_fall_behind(frames_late: int) -> None:
    position, offset = np.zeros(3), np.array(CAMERA_OFFSET)
    camera = Camera(position, offset)
    views = deque([(camera.position, camera.look_at)] * (frames_late + 1))
    for _ in range(1000):
        position = position + STEP
        move_camera(camera, position.tolist())
        views.append((camera.position, camera.look_at))
        last = views[-1]
        camera.report(*views.popleft())
    assert np.allclose(last[0], position + offset)
    assert np.allclose(last[1], position)


def test_the_camera_keeps_the_chosen_side_and_distance() -> None:
    camera = Camera(np.zeros(3), np.array(CAMERA_OFFSET))
    camera.report(np.array([0.0, 8.0, 1.0]), np.zeros(3))
    move_camera(camera, STEP.tolist())
    assert np.allclose(camera.position, STEP + np.array([0.0, 8.0, 1.0]))


def test_a_camera_inside_the_vehicle_moves_out() -> None:
    camera = Camera(np.zeros(3), np.zeros(3))
    move_camera(camera, STEP.tolist())
    assert np.allclose(camera.position, STEP + np.array(CAMERA_OFFSET))

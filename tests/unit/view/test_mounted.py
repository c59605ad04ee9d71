"""Measurements of sensors are drawn from where the scenario mounts them."""

from math import pi

import numpy as np
import pytest

from hil.view.panels import pictures
from hil.view.scene.frames import body_attitude
from hil.view.scene.sensors import FIELD_OF_VIEW, SensorScene
from sim.rotations import rotate
from sim.sensors.imaging.samples import SonarImageSample
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import read_sensors
from tests.unit.view.scene_recorder import Recorder

PICTURE = np.zeros((30, 40, 3), np.uint8)


def test_a_camera_is_drawn_with_its_position_direction_and_field_of_view() -> None:
    camera = {"position": [0.3, 0.1, 0.2], "orientation": ["0 deg", "-30 deg", "90 deg"], "field_of_view": "60 deg"}
    recorder = Recorder()
    scene = SensorScene(recorder, "/vehicles/a", read_sensors({"camera": camera}, "here"))
    scene.draw_camera(PICTURE)
    _, _, seat = recorder.added["/vehicles/a/camera"]
    assert seat["position"].tolist() == [0.3, -0.1, -0.2], "x ahead, y to port, z up"
    ahead = rotate(seat["wxyz"], (1.0, 0.0, 0.0))
    assert ahead == pytest.approx((0.0, -np.cos(pi / 6), -0.5)), "to starboard, and down"
    _, (vertical, aspect), _ = recorder.added["/vehicles/a/camera/frustum"]
    assert np.tan(0.5 * vertical) * aspect == pytest.approx(np.tan(pi / 6))


def test_a_camera_without_a_scenario_looks_ahead() -> None:
    recorder = Recorder()
    SensorScene(recorder, "/a", {}).draw_camera(PICTURE)
    _, (vertical, aspect), _ = recorder.added["/a/camera/frustum"]
    assert np.tan(0.5 * vertical) * aspect == pytest.approx(np.tan(0.5 * FIELD_OF_VIEW))
    assert recorder.added["/a/camera"][2]["wxyz"] == body_attitude((1.0, 0.0, 0.0, 0.0))


def test_the_fan_of_a_sonar_starts_at_its_mounting() -> None:
    echoes = np.full((20, 3), 255, np.uint8)
    sample = SonarImageSample(1, (-0.5, 0.0, 0.5), 20, 0.0, 0.5, 7e5, 1500.0, 0.02, 0.3, "uint8", echoes.tobytes())
    sits = Mounting(position=(0.5, 0.0, 1.0), orientation=(0.0, 0.0, 0.5 * pi))
    points, _ = pictures.fan_points(sample, 3.0, sits)
    middle = points[1::3]
    assert middle[:, 0] == pytest.approx(np.full(len(middle), 0.5)), "it looks to starboard"
    assert (middle[:, 1] > 0.0).all()
    on_bed = points[points[:, 2] == 3.0]
    assert len(on_bed) > 30
    ranges = np.linalg.norm(on_bed - (0.5, 0.0, 1.0), axis=1)
    assert ranges.max() == pytest.approx(9.75)

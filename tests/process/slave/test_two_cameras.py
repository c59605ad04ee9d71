"""A slave with two cameras and two sonars, and a client that has not read its scenario."""

import subprocess
import sys
import threading
from pathlib import Path

import pytest

import hil
from hil.client.vehicle_state import VehicleState
from hil.common.errors import NetworkError
from hil.ros.diagnostics import Diagnostics
from hil.ros.topics import TOPICS
from tests.support.clients.imaging_slave import start

pytestmark = pytest.mark.timeout(280)
SENSORS = """
[ros]
images = "both"
[sensors.camera]
rate = 5
width = 64
height = 48
[sensors.camera_down]
sensor = "camera"
rate = 5
width = 32
height = 24
orientation = ["0 deg", "-90 deg", "0 deg"]
[sensors.forward_sonar]
rate = 2
beams = 64
[sensors.sonar_aft]
sensor = "forward_sonar"
rate = 2
beams = 32
[sensors.pressure_2]
sensor = "pressure"
"""


def test_each_camera_and_sonar_has_topics_of_its_name(tmp_path: Path) -> None:
    program, endpoint = start(tmp_path, SENSORS)
    with program:
        program.expect("ready")
        with hil.connect(endpoint, observe=True) as fleet:
            vehicle = fleet.wait_for("uuv1", seconds=60.0)[0]
            assert "camera_down/image_raw" not in TOPICS, "its scenario was not read here"
            down = vehicle.newest("camera/image_raw"), vehicle.newest("camera_down/image_raw")
            assert [(each.width, each.height) for each in down] == [(64, 48), (32, 24)]
            assert len(vehicle.newest("sonar_aft/image").beams) == 32
            assert vehicle.newest("camera_down/camera_info").width == 32
            assert abs(vehicle.newest("pressure_2").pascal - vehicle.newest("pressure").pascal) < 1e4
            listed = {"camera_down/image_raw/compressed", "sonar_aft/image", "camera/depth/image_raw"}
            assert listed <= vehicle.pictures()
        command = [sys.executable, "-m", "hil.cli", "topic", "echo", "/uuv1/camera_down/camera_info", "--count", "1"]
        echo = subprocess.run(
            [*command, "--connect", endpoint, "--wait", "60"], capture_output=True, text=True, timeout=120, check=True
        )
        assert "camera_down_optical_frame" in echo.stdout


class _Client:
    """The client of a slave whose imaging process has published nothing yet."""

    def __init__(self) -> None:
        self.latest: dict[str, object] = {}

    def watch(self, *_: str) -> None:
        """Watch nothing."""

    def offers(self) -> set[str]:
        return {"imu"}

    def diagnostics(self) -> Diagnostics:
        figures = Diagnostics()
        figures.imaging_requested = {"camera": 3.0}
        return figures


class _Starting(VehicleState):
    """A vehicle with a given graph, whose sensors are awaited only for a moment."""

    present = True

    def __init__(self, published: dict[str, str]) -> None:
        self.name, self.client, self.graph = "uuv1", _Client(), published  # type: ignore[assignment]
        self._first, self._closing = threading.Condition(), threading.Event()
        self._streams, self._listeners = {}, []

    def _published(self) -> dict[str, str]:
        return self.graph


def test_a_camera_whose_process_is_starting_is_reported_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FIRST_WITHIN_S", "MADE_WITHIN_S"):
        monkeypatch.setattr(f"hil.client.vehicle_state.{name}", 0.01)
    with pytest.raises(NetworkError, match=r"has sent no 'camera/image_raw'.*pictures of its camera is still starting"):
        _Starting({}).newest("camera/image_raw")
    with pytest.raises(NetworkError, match=r"'forward_sonar/image'.*other sensors are sections"):
        _Starting({}).newest("forward_sonar/image")
    with pytest.raises(NetworkError, match=r"'camera/labels'.*other sensors are sections"):
        _Starting({"camera/image_raw": "sensor_msgs/msg/Image"}).newest("camera/labels")


@pytest.mark.parametrize("how", ["newest", "samples"])
def test_topics_of_a_starting_process_may_appear_one_after_the_other(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.client.vehicle_state.FIRST_WITHIN_S", 0.01)
    monkeypatch.setattr("hil.client.vehicle_state.samples.aged", lambda _, stamped: stamped)

    class Appearing(_Starting):
        """A vehicle whose process starts at the first call; the picture appears half a second later."""

        def _published(self) -> dict[str, str]:
            before, self.graph = self.graph, {"camera/camera_info": "sensor_msgs/msg/CameraInfo"}
            if not before:
                threading.Timer(0.5, self._send).start()
            return before

        def _send(self) -> None:
            self.client.latest["camera/image_raw"] = "a picture"  # type: ignore[assignment]
            self._on_message("camera/image_raw", "a picture")  # type: ignore[arg-type]

    vehicle = Appearing({})
    if how == "newest":
        assert vehicle.newest("camera/image_raw") == "a picture"
    else:
        assert next(vehicle.samples("camera/image_raw", timeout=0.01)) == "a picture"

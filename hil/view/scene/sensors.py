"""Measurements of a vehicle's sensors in the scene, each drawn at the sensor's mounting from the scenario."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hil.ros.topics import first_of
from hil.view.scene import colours
from hil.view.scene.frames import body_attitude, to_body
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import SensorSet

FIELD_OF_VIEW = 1.4  # rad, of a camera that is not in the scenario
FRUSTUM = 0.6  # m
LOOKS_AHEAD = (0.5, -0.5, 0.5, -0.5)  # quaternion of a frustum that points forward; it looks along z, with x right


class SensorScene:
    """The sensors of the vehicle whose frame in the scene is `root`. Those not in `sensors` are at its origin."""

    def __init__(self, scene: Any, root: str, sensors: SensorSet) -> None:
        self._scene, self._root, self._sensors = scene, root, sensors
        self._seats: dict[str, str] = {}

    def mounting(self, sensor: str) -> Mounting:
        """Return position and attitude of a sensor in the vehicle."""
        return self._sensors[sensor].mounting if sensor in self._sensors else Mounting()

    def draw_scans(self, latest: Mapping[str, Any]) -> None:
        """Show the points of laser scanners and profilers."""
        for topic, scan in latest.items():
            colour, points = SCANS.get(first_of(topic), (None, None))
            if points is not None and len(places := points(scan)):
                self._scene.add_point_cloud(
                    f"{self._seat(topic)}/points", to_body(places), colour, point_size=0.06, point_shape="circle"
                )

    def draw_camera(self, picture: Any, sensor: str = "camera") -> None:
        """Show a camera's frustum with its picture (height x width x 3)."""
        camera = self._sensors.get(sensor)
        horizontal = float(camera.model.field_of_view) if camera else FIELD_OF_VIEW
        height, width = picture.shape[:2]
        vertical = 2.0 * np.arctan(np.tan(0.5 * horizontal) * height / width)
        self._scene.add_camera_frustum(
            f"{self._seat(sensor)}/frustum", float(vertical), width / height, scale=FRUSTUM, image=picture,
            wxyz=LOOKS_AHEAD, color=colours.SONAR,
        )  # fmt: skip

    def draw_sonar(self, points: Any, strengths: Any, sensor: str = "forward_sonar") -> None:
        """Show the fan of a forward sonar: points in the vehicle's FRD (m), and their strengths from 0 to 1."""
        shade = np.clip(strengths, 0.0, 1.0)[:, None]
        tint = (np.array(colours.SONAR) * shade).astype(np.uint8)
        self._scene.add_point_cloud(f"{self._root}/sonar/{sensor}", to_body(points), tint, point_size=0.08)

    def _seat(self, sensor: str) -> str:
        """Return the name of the sensor's frame in the scene, which moves with the vehicle; make it if needed."""
        if sensor not in self._seats:
            seat, name = self.mounting(sensor), f"{self._root}/{sensor}"
            self._scene.add_frame(
                name, show_axes=False, position=to_body([seat.position])[0], wxyz=body_attitude(seat.quaternion)
            )
            self._seats[sensor] = name
        return self._seats[sensor]


def _laser_points(scan: Any) -> Any:
    """Return the end points (FRD of the sensor, m) of the beams of a horizontal fan; angles are to starboard."""
    return _fan(scan, lambda r, a: (r * np.cos(a), r * np.sin(a), np.zeros_like(r)))


def _profiler_points(scan: Any) -> Any:
    """Return the end points (FRD of the sensor, m) of the beams of a fan across the vehicle; 0 is straight down."""
    return _fan(scan, lambda r, a: (np.zeros_like(r), r * np.sin(a), r * np.cos(a)))


def _fan(scan: Any, position: Any) -> Any:
    ranges = np.asarray(scan.ranges, float)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    there = np.isfinite(ranges)
    return np.stack(position(ranges[there], angles[there]), axis=1)


SCANS = {"laser": (colours.LASER, _laser_points), "profiler": (colours.PROFILER, _profiler_points)}

"""One vehicle in the scene: its shape, thrusts and tracks."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hil.ros.encoders import swap_attitude
from hil.view.scene import colours
from hil.view.scene.frames import to_body, to_scene
from hil.view.scene.sensors import SensorScene
from hil.view.scene.world import arrows
from sim.sensors.sensor_set import SensorSet
from sim.vehicle.vehicle import Vehicle

TRACK_STEP = 0.1  # m between two points of a track
MAX_POINTS = 4000  # in a track, an even number; beyond it every second point is removed
THRUST_SCALE = 0.02  # m of an arrow per N
AXES = 0.6  # m


def draw_line(scene: Any, name: str, line: Any, colour: colours.RGB) -> None:
    """Draw a line through points of the scene (n x 3). It replaces a line of the same name."""
    segments = np.stack([line[:-1], line[1:]], axis=1)
    scene.add_line_segments(name, segments, colour, thickness=2.5, thickness_units="screen")


class Track:
    """A line along past positions, thinned out as it grows."""

    def __init__(self, scene: Any, name: str, colour: colours.RGB) -> None:
        self._scene, self._name, self._colour = scene, name, colour
        self._points = np.empty((MAX_POINTS + 1, 3), np.float32)
        self._count = self._drawn = 0

    def add(self, point: Any) -> None:
        """Add a point of the scene, unless it is within TRACK_STEP of the last."""
        if not self._count or np.linalg.norm(point - self._points[self._count - 1]) >= TRACK_STEP:
            self._points[self._count] = point
            self._count += 1
        if self._count > MAX_POINTS:
            self._count = MAX_POINTS // 2 + 1
            self._points[: self._count] = self._points[::2]
            self._drawn = 0

    def draw(self) -> None:
        """Draw the line if points were added."""
        if self._count < 2 or self._count == self._drawn:
            return
        self._drawn = self._count
        draw_line(self._scene, self._name, self._points[: self._count], self._colour)


class VehicleScene:
    """A vehicle drawn from its file: box or mesh, thrusters, axes. `server` is a viser.ViserServer.

    Without `vehicle` it is a box 1 m long. `sensors` draws the measurements of the `carried` sensors.
    """

    def __init__(self, server: Any, name: str, vehicle: Vehicle | None, carried: SensorSet) -> None:
        self._scene = server.scene
        self._vehicle = vehicle
        self._root = f"/vehicles/{name}"
        self.position, self.is_placed = np.zeros(3), False
        self._frame = self._scene.add_frame(self._root, axes_length=AXES, axes_radius=0.01)
        self._scene.add_label(f"{self._root}/name", name, position=(0.0, 0.0, 0.8), anchor="bottom-center")
        self.sensors = SensorScene(self._scene, self._root, carried)
        self._draw_shape()
        self._thrusts: Any = None
        self._tether = f"/tethers/{name}"
        self._track = Track(self._scene, f"/tracks/{name}/true", colours.TRACK)
        self._navigation = Track(self._scene, f"/tracks/{name}/navigation", colours.NAVIGATION)

    def move(self, latest: Mapping[str, Any]) -> None:
        """Move the vehicle to the pose of the newest samples: the ground truth, or else the odometry."""
        state = latest.get("ground_truth") or latest.get("odom")
        if state is None:
            return
        self.position = to_scene([state.position])[0]
        self.is_placed = True
        self._frame.position, self._frame.wxyz = self.position, swap_attitude(state.orientation)
        self._track.add(self.position)
        if "ground_truth" in latest and "odom" in latest:
            self._navigation.add(to_scene([latest["odom"].position])[0])
        if tether := latest.get("tether"):
            draw_line(self._scene, self._tether, to_scene(tether), colours.TETHER)
        if joints := latest.get("joint_states"):
            self._draw_thrusts(joints.efforts)

    def draw_tracks(self) -> None:
        """Draw the tracks of ground truth and navigation."""
        self._track.draw()
        self._navigation.draw()

    def _draw_shape(self) -> None:
        vehicle = self._vehicle
        size = vehicle.dimensions if vehicle else (1.0, 0.5, 0.4)
        meshes = [drawn for mesh in vehicle.meshes if (drawn := _mesh(mesh)) is not None] if vehicle else []
        for number, drawn in enumerate(meshes):
            self._scene.add_mesh_simple(f"{self._root}/hull/{number}", drawn.vertices, drawn.faces, color=colours.HULL)
        if not meshes:
            self._scene.add_box(f"{self._root}/hull", color=colours.HULL, dimensions=size)
        for number, thruster in enumerate(vehicle.thrusters if vehicle else ()):
            along = to_body([thruster.unit_direction])[0]
            self._scene.add_cylinder(
                f"{self._root}/thrusters/{number}", 0.05, 0.1, color=colours.THRUSTER,
                position=to_body([thruster.position])[0], wxyz=_turn_up_to(along),
            )  # fmt: skip

    def _draw_thrusts(self, thrusts: Sequence[float]) -> None:
        vehicle = self._vehicle
        if vehicle is None or len(thrusts) < len(vehicle.thrusters):
            return
        thrusts = thrusts[: len(vehicle.thrusters)]  # the fins come after the thrusters
        starts = to_body([thruster.position for thruster in vehicle.thrusters])
        along = to_body([thruster.unit_direction for thruster in vehicle.thrusters])
        segments = arrows(starts, along * np.array(thrusts)[:, None] * THRUST_SCALE).astype(np.float32)
        if self._thrusts is None:
            self._thrusts = self._scene.add_line_segments(
                f"{self._root}/thrusts", segments, colours.THRUST, thickness=4.0, thickness_units="screen"
            )
        else:
            self._thrusts.points = segments


def _mesh(mesh: Any) -> Any:
    """Return a mesh file as a trimesh.Trimesh (m, axes of the vehicle in the scene); None if there is no such file."""
    import os

    from sim.rotations import from_euler, matrix
    from sim.vehicle.mesh_files import load_mesh

    if not os.path.exists(mesh.file):
        return None
    loaded = load_mesh(mesh.file)
    rotation = np.array(matrix(from_euler(*mesh.orientation))).reshape(3, 3)
    loaded.vertices = to_body((loaded.vertices * mesh.scale) @ rotation.T + mesh.position)
    return loaded


def _turn_up_to(along: Any) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) that turns z to the unit vector `along`."""
    x, y, z = (float(value) for value in along)
    if z < -0.999999:
        return 0.0, 1.0, 0.0, 0.0
    w = float(np.sqrt(0.5 * (1.0 + z)))
    return w, -y / (2.0 * w), x / (2.0 * w), 0.0

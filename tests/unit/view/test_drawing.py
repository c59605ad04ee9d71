"""Elements passed to the scene and the panels: axes, meshes, arrows, pictures, instruments."""

from math import pi
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from hil.ros.encoders import swap_attitude
from hil.ros.images import Picture
from hil.view.panels import instruments, pictures
from hil.view.scene import frames
from hil.view.scene import world as world_scene
from sim.environment.obstacles import Box, Cylinder
from sim.environment.terrain import Terrain
from sim.environment.terrain_grid import Grid
from sim.environment.world import World
from sim.rotations import from_euler, rotate
from sim.sensors.imaging.samples import SideScanSample, SonarImageSample
from tests.unit.view.scene_recorder import Recorder


def test_positions_and_attitudes_are_converted_to_scene_axes() -> None:
    assert frames.to_scene([(1.0, 2.0, 3.0)]).tolist() == [[2.0, 1.0, -3.0]]
    assert frames.from_scene((2.0, 1.0, -3.0)) == (1.0, 2.0, 3.0)
    attitude = from_euler(0.1, 0.2, 0.5 * pi)
    ahead = frames.to_scene([rotate(attitude, (1.0, 0.0, 0.0))])[0]
    assert rotate(swap_attitude(attitude), (1.0, 0.0, 0.0)) == pytest.approx(ahead)
    starboard = frames.to_scene([rotate(attitude, (0.0, 1.0, 0.0))])[0]
    assert rotate(swap_attitude(attitude), frames.to_body([(0.0, 1.0, 0.0)])[0]) == pytest.approx(starboard)


def relief(rows: int, columns: int) -> Terrain:
    from array import array

    depths = array("f", [5.0 + 0.01 * row + 0.002 * column for row in range(rows) for column in range(columns)])
    depths[3 * columns + 3] = float("nan")
    return Terrain(Grid(-10.0, 20.0, 1.0, rows, columns), depths, 9.0)


def test_a_seabed_is_drawn_with_holes_contours_and_a_limited_number_of_nodes() -> None:
    world = World("bay", "", (-10.0, 90.0, 20.0, 120.0), 9.0, terrain=relief(1001, 901))
    recorder = Recorder()
    scene = world_scene.WorldScene(recorder, world)
    kind, (mesh,), _ = recorder.added["/seabed"]
    assert kind == "add_mesh_trimesh"
    assert len(mesh.vertices) <= world_scene.MAX_NODES**2
    east, north, up = mesh.vertices[-1]
    assert (east, north) == (20.0 + 900.0, -10.0 + 999.0)
    assert up == pytest.approx(-scene.seabed(north, east), abs=1e-4)
    levels = [name for name in recorder.added if name.startswith("/contours") and name.endswith("depth")]
    assert 4 <= len(levels) <= world_scene.CONTOURS + 1
    assert recorder.added[levels[0]][1][0].endswith(" m")
    small = Recorder()
    world_scene.WorldScene(small, world._replace(terrain=relief(30, 30)))
    faces = small.added["/seabed"][1][0].faces
    assert len(faces) == 2 * 29 * 29 - 2 * 4 + 2, "the four cells round the node without data are left out, but corners"


def test_obstacles_current_path_and_goal_are_drawn() -> None:
    world = World(
        "pool", "", (0.0, 10.0, 0.0, 10.0), 4.0, current=(0.2, 0.0, 0.0), cylinder=(Cylinder(3.0, 4.0, 0.5),),
        box=(Box(6.0, 7.0, 1.0, 2.0, 0.25 * pi, 1.0),),
    )  # fmt: skip
    recorder = Recorder()
    scene = world_scene.WorldScene(recorder, world)
    scene.draw_path([(1.0, 1.0), (2.0, 3.0), (5.0, 5.0)], 2.0)
    scene.draw_goal(5.0, 5.0, 2.0)
    assert recorder.added["/obstacles/0"][0] == "add_cylinder"
    assert recorder.added["/obstacles/1"][0] == "add_box"
    assert recorder.added["/obstacles/1"][2]["position"].tolist() == [7.0, 6.0, -2.5]
    assert recorder.added["/path"][1][0].shape == (2, 2, 3)
    assert recorder.added["/goal"][2]["position"].tolist() == [5.0, 5.0, -2.0]
    starts, ends = recorder.added["/current"][1][0][0]
    assert ends[1] > starts[1], "to the north"
    assert ends[0] == pytest.approx(starts[0])
    assert not any(name.startswith("/contours") for name in recorder.added), "of a flat bed"


def test_arrows_are_drawn_for_any_direction_and_length() -> None:
    along = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, -2.0), (0.0, 0.0, 0.0)])
    tips = world_scene.arrows(np.zeros((3, 3)), along)
    assert tips.shape == (9, 2, 3)
    assert np.isfinite(tips).all()
    assert tips[:3, 1].tolist() == along.tolist()


def sonar(echoes: np.ndarray[Any, Any]) -> SonarImageSample:
    bins, beams = echoes.shape
    angles = tuple(np.linspace(-1.0, 1.0, beams))
    return SonarImageSample(1, angles, bins, 0.0, 0.1, 7e5, 1500.0, 0.02, 0.3, "uint8", echoes.tobytes())


def test_a_sonar_target_has_its_position_in_the_fan() -> None:
    echoes = np.zeros((100, 65), np.uint8)
    echoes[50, 48] = 255  # 5 m ahead, half a radian to starboard
    picture = pictures.fan_picture(sonar(echoes))
    rows, columns = np.nonzero(picture.sum(axis=2) > 500)
    ahead = (pictures.FAN_SIZE - 1 - rows.mean()) * 10.0 / pictures.FAN_SIZE
    right = (columns.mean() - 0.5 * picture.shape[1]) * 10.0 / pictures.FAN_SIZE
    assert (ahead, right) == (pytest.approx(5.05 * np.cos(0.5), abs=0.1), pytest.approx(5.05 * np.sin(0.5), abs=0.15))
    points, strengths = pictures.fan_points(sonar(np.full((100, 65), 255, np.uint8)), 3.0)
    assert len(points) == len(strengths)
    assert points[:, 2].max() == 3.0
    assert np.linalg.norm(points, axis=1).max() <= 10.0


def test_a_side_scan_scrolls() -> None:
    waterfall = pictures.Waterfall()
    ping = SideScanSample(1, 3, 0.1, 4e5, 1500.0, 0.01, 0.8, 2.0, "uint8", bytes((10, 20, 255)), bytes((1, 2, 3)))
    assert waterfall.add(ping)
    assert not waterfall.add(ping)
    assert waterfall.add(ping._replace(time_ns=2, port=bytes(3), starboard=bytes(3)))
    picture = waterfall.picture()
    assert picture.shape == (pictures.WATERFALL, 6, 3)
    assert picture[0].sum() == 0, "the newest on top"
    assert picture[1, 0].sum() > 600, "port on the left, farthest outside"


def test_a_side_scan_scrolls_by_the_distance_travelled() -> None:
    """The pings are 1 m apart in bins of 10 cm: ten rows from one to the next, and between them a slope, no brick."""
    waterfall = pictures.Waterfall()
    for number in range(4):
        level = bytes([60 * number] * 3)
        ping = SideScanSample(number + 1, 3, 0.1, 4e5, 1500.0, 0.01, 0.8, 2.0, "uint8", level, level)
        assert waterfall.add(ping, (float(number), 0.0, 5.0))
    red = waterfall.picture()[:, 0, 0].astype(int)
    assert (np.diff(red[:31]) <= 0).all()
    assert np.abs(np.diff(red[:31])).max() < 30
    assert (red[40:] == pictures.BACKGROUND[0]).all()


def test_camera_pictures_are_shown_and_malformed_ones_ignored() -> None:
    raw = Picture(1, 2, 1, "rgb8", bytes((1, 2, 3, 4, 5, 6)))
    assert pictures.camera_picture(raw).tolist() == [[[1, 2, 3], [4, 5, 6]]]
    for broken in (raw._replace(data=b"12"), Picture(1, 0, 0, "jpeg", b"no picture")):
        assert pictures.camera_picture(broken) is None


def test_instruments_are_an_svg_image_with_escaped_text() -> None:
    now = instruments.Reading(
        0.1, -0.2, 1.0, 3.456, float("nan"), 0.5, (1.0, 2.0, 3.0), 15.5, (1500, 1700), (0.0, 12.5), ("<left>", "right")
    )
    svg = ElementTree.fromstring(instruments.draw(now))
    texts = " ".join(text.strip() for text in svg.itertext() if text.strip())
    for expected in (
        "roll +6°",
        "pitch -11°",
        "heading 57°",
        "3.46 m",
        "altitude -",
        "15.5 V",
        "<left>",
        "1700 us",
        "+12.5 N",
    ):
        assert expected in texts
    bars = [each for each in svg.iter() if each.get("fill") == "#dc2626" and each.tag == "rect"]
    assert [float(each.get("width", "")) for each in bars] == [0.0, 20.0]

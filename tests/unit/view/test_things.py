"""Meshes, shapes, pipelines and zones in the live view, and as markers of ROS 2."""

from pathlib import Path

import numpy as np

from hil.client.message_text import lines
from hil.ros import message
from hil.ros.world import encode_obstacles
from hil.view.scene import colours
from hil.view.scene import world as world_scene
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone
from sim.environment.world import World, load_world
from tests.support.lazy import import_lazily
from tests.unit.view.scene_recorder import Recorder

trimesh = import_lazily("trimesh")

ZONE = Zone("restricted", ((0.0, 0.0), (0.0, 10.0), (10.0, 10.0)), "reserve")
PIPE = Pipeline(((0.0, 0.0), (0.0, 30.0)), 0.4, colour=(0.2, 0.4, 0.6))
KEYS = "north = 10\neast = -5\ndepth = 8\n"


def world_of(folder: Path) -> World:
    trimesh.creation.box((4.0, 2.0, 1.0)).export(str(folder / "block.stl"))
    (folder / "w.toml").write_text(
        'name = "w"\nsource = ""\nextent = [-50, 50, -50, 50]\ndepth = 20\n'
        f'[[mesh]]\nfile = "block.stl"\ncolour = [1.0, 0.0, 0.2]\n{KEYS}'
        f'[[mesh]]\nfile = "block.stl"\nhidden = true\n{KEYS}'
        '[[shape]]\nkind = "net_pen"\nnorth = 0\neast = 20\n'
    )
    return load_world(str(folder / "w.toml"))._replace(pipeline=(PIPE,), zone=(ZONE,))


def test_the_live_view_draws_meshes_shapes_pipelines_and_zones(tmp_path: Path) -> None:
    recorder = Recorder()
    world_scene.WorldScene(recorder, world_of(tmp_path))
    kind, (corners, faces), options = recorder.added["/meshes/0"]
    assert kind == "add_mesh_simple"
    np.testing.assert_allclose(corners.min(axis=0), (-6.0, 8.0, -8.5), atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=0), (-4.0, 12.0, -7.5), atol=1e-6)
    assert faces.shape == (12, 3)
    assert (options["color"], options["opacity"], options["side"]) == ((255, 0, 51), None, "double")
    assert recorder.added["/meshes/1"][2]["color"] == colours.OBSTACLE
    assert recorder.added["/meshes/2"][2]["opacity"] == world_scene.OPACITY, "a net is seen through"
    _, (segments, colour), options = recorder.added["/pipelines/0"]
    np.testing.assert_allclose(segments, [[(0.0, 0.0, -19.8), (30.0, 0.0, -19.8)]])
    assert (colour, options["thickness"], options["thickness_units"]) == ((51, 102, 153), 0.4, "world")
    _, (segments, _), _ = recorder.added["/zones/0"]
    assert segments.shape == (3, 2, 3), "closed"
    assert recorder.added["/zones/0/name"][1][0] == "restricted area: reserve"


def test_topic_echo_prints_markers_briefly_and_omits_hidden_ones(tmp_path: Path) -> None:
    payload = encode_obstacles(1, world_of(tmp_path))
    fields = message.decode("visualization_msgs/msg/MarkerArray", payload)
    assert fields is not None
    block, net, head, pipe, zone = fields["markers"]
    assert [(one["ns"], one["id"], one["type"]) for one in fields["markers"]] == [
        ("obstacles", 0, 11), ("obstacles", 1, 11), ("obstacles", 2, 11), ("pipelines", 0, 5), ("zones", 0, 4)
    ]  # fmt: skip
    assert len(block["points"]) == 36
    assert block["color"]["r"] == 1.0
    assert net["text"] == head["text"] == "the net pen at (0, 20)"
    assert pipe["points"][1] == {"x": 30.0, "y": 0.0, "z": -19.8}
    assert pipe["scale"]["x"] == 0.4
    assert len(zone["points"]) == 4
    assert zone["text"] == "restricted area: reserve"
    shown = lines(fields)
    assert len(shown) < 200 * len(fields["markers"])
    assert any("in all" in line for line in shown)

"""Meshes, shapes, pipelines and zones in the live view, and as markers of ROS 2."""

from pathlib import Path

import numpy as np

from hil.client.message_text import lines
from hil.ros import message
from hil.ros.world import encode_obstacles
from hil.view.scene.content import SceneContent
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.zones import Zone
from sim.environment.world import World, load_world
from tests.support.lazy import import_lazily
from tests.unit.view.content_reader import read

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
    world = read(SceneContent(world_of(tmp_path)))[0]["world"]
    block, hidden, net = world["meshes"][:3]
    corners = np.array(block["triangles"]).reshape(-1, 3)
    np.testing.assert_allclose(
        (corners.min(axis=0), corners.max(axis=0)), [(8.0, -6.0, 7.5), (12.0, -4.0, 8.5)], atol=1e-5
    )
    assert (len(corners), block["colour"], block["net"]) == (36, [1.0, 0.0, 0.2], False)
    assert hidden["colour"] is None
    assert net["net"], "a net is seen through"
    pipe, zone = world["pipelines"][0], world["zones"][0]
    np.testing.assert_allclose(pipe["pieces"], [[(0.0, 0.0, 19.8), (0.0, 30.0, 19.8)]])
    assert (pipe["colour"], pipe["diameter"]) == ([0.2, 0.4, 0.6], 0.4)
    assert (len(zone["outline"]), zone["name"]) == (3, "restricted area: reserve")


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

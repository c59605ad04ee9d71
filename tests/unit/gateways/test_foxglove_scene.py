"""The scene for Foxglove, decoded by its own schema: meshes, shapes, pipelines and zones in ENU."""

from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet  # type: ignore[import-untyped]
from google.protobuf.descriptor_pool import DescriptorPool  # type: ignore[import-untyped]
from google.protobuf.message_factory import GetMessageClass  # type: ignore[import-untyped]

from hil.gateways.foxglove.scene import encode_scene, scene_channel
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle
from tests.support.lazy import import_lazily

trimesh = import_lazily("trimesh")

WORLD = """\
name = "w"
source = ""
extent = [-50, 50, -50, 50]
depth = 20
[[mesh]]
file = "block.stl"
north = 10
east = -5
depth = 8
colour = [0.9, 0.1, 0.2]
[[shape]]
kind = "net"
north = 0
east = 20
[[pipeline]]
points = [[0, 0], [0, 30]]
diameter = 0.4
[[zone]]
kind = "restricted"
outline = [[0, 0], [0, 10], [10, 10]]
"""


def decoded(data: bytes) -> Any:
    channel, pool, files = scene_channel(), DescriptorPool(), FileDescriptorSet()
    files.ParseFromString(b64decode(channel.schema))
    for file in files.file:
        pool.Add(file)
    message = GetMessageClass(pool.FindMessageTypeByName(channel.type))()
    message.ParseFromString(data)
    return message


def points(primitive: Any) -> Any:
    return np.array([(point.x, point.y, point.z) for point in primitive.points])


def test_meshes_pipelines_and_zones_have_their_positions(tmp_path: Path) -> None:
    trimesh.creation.box((4.0, 2.0, 1.0)).export(str(tmp_path / "block.stl"))
    (tmp_path / "w.toml").write_text(WORLD)
    data = encode_scene(
        load_scenario("paper_field"), load_world(str(tmp_path / "w.toml")), load_vehicle("paper_six")[0]
    )
    placed, hull = decoded(data).entities
    assert (placed.frame_id, hull.id) == ("map", "vehicle")
    _, block, net, head = placed.triangles
    corners = points(block)
    assert len(block.indices) == len(corners) == 36
    np.testing.assert_allclose(corners.min(axis=0), (-6.0, 8.0, -8.5), atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=0), (-4.0, 12.0, -7.5), atol=1e-6)
    assert (block.color.r, block.color.g, block.color.a) == pytest.approx((0.9, 0.1, 1.0))
    assert net.color.a < head.color.a == 1.0, "a net is seen through"
    pipe, zone = placed.lines
    np.testing.assert_allclose(points(pipe), [(0.0, 0.0, -19.8), (30.0, 0.0, -19.8)], atol=1e-6)
    assert (pipe.type, pipe.thickness, pipe.scale_invariant) == (2, 0.4, False)
    np.testing.assert_allclose(points(zone), [(0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (10.0, 10.0, 0.0)])
    assert zone.type == 1, "a loop"

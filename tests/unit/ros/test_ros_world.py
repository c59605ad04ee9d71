"""A world as map and markers, compared with an independent codec, and with the planner's own map."""

import pickle
from array import array
from math import pi
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

from hil.ros.topics import DESCRIPTIONS
from hil.ros.world import GridMap, encode_map, encode_obstacles
from hil.scenario.config import load_scenario
from hil.scenario.world_map import known_map
from hil.slave.ros.describe import MAKERS
from sim.environment.mesh import MeshKeys, place_triangles
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World, load_world
from sim.vehicle.vehicle import load_vehicle

STORE = get_typestore(Stores.ROS2_JAZZY)


def decode_by_rosbags(payload: bytes, kind: str) -> Any:
    return STORE.deserialize_cdr(payload, kind)


def test_a_map_has_rows_from_the_south_and_columns_from_the_west() -> None:
    payload = encode_map(3 * 10**9 + 5, GridMap(bytes([0, 1, 0, 0, 0, 1]), 3, 0.5, south=-2.0, west=7.0))
    grid = decode_by_rosbags(payload, "nav_msgs/msg/OccupancyGrid")
    assert (grid.header.frame_id, grid.header.stamp.sec, grid.header.stamp.nanosec) == ("map", 3, 5)
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (3, 2, 0.5)
    origin = grid.info.origin
    assert (origin.position.x, origin.position.y, origin.orientation.w) == (7.0, -2.0, 1.0)
    assert grid.data.tolist() == [0, 100, 0, 0, 0, 100]


def test_obstacles_reach_from_top_to_seabed_and_hidden_ones_are_omitted() -> None:
    world = load_world("pool")._replace(
        cylinder=(Cylinder(2.0, 3.0, 0.5, top=1.0, name="post"), Cylinder(1.0, 1.0, 0.5, hidden=True)),
        box=(Box(4.0, 5.0, 2.0, 1.0, heading=pi / 2),),
    )
    markers = decode_by_rosbags(encode_obstacles(1, world), "visualization_msgs/msg/MarkerArray").markers
    assert [(marker.type, marker.ns, marker.id, marker.action) for marker in markers] == [
        (3, "obstacles", 0, 0),
        (1, "obstacles", 1, 0),
    ]
    post, block = markers
    bottom = world.seabed(2.0, 3.0)
    assert (post.pose.position.x, post.pose.position.y) == (3.0, 2.0)
    assert post.pose.position.z == pytest.approx(-0.5 * (bottom + 1.0))
    assert (post.scale.x, post.scale.z, post.text) == (1.0, pytest.approx(bottom - 1.0), "post")
    assert (block.scale.x, block.scale.y) == (1.0, 2.0)  # east, north, before it is turned
    assert block.pose.orientation.z == pytest.approx(-(0.5**0.5))  # a compass heading is clockwise
    assert post.color.a > 0.0


def test_every_description_is_made_from_a_pickled_scenario() -> None:
    scenario = pickle.loads(pickle.dumps(load_scenario("paper_field")))
    assert set(MAKERS) == set(DESCRIPTIONS)
    text = decode_by_rosbags(MAKERS["robot_description"](scenario), "std_msgs/msg/String").data
    assert text.startswith("<?xml")
    assert '<link name="base_link">' in text
    grid = decode_by_rosbags(MAKERS["map"](scenario), "nav_msgs/msg/OccupancyGrid")
    planner = known_map(scenario.master, load_vehicle(scenario.vehicle)[0], load_world(scenario.world))
    assert ((grid.data == 100).reshape(grid.info.height, grid.info.width) == planner.cells).all()
    assert planner.cells.any()
    assert decode_by_rosbags(MAKERS["obstacles"](scenario), "visualization_msgs/msg/MarkerArray").markers


def test_a_mesh_is_a_triangle_list_marker() -> None:
    """The axes are x east, y north and z up; a mesh that is hidden is left out."""
    keys = MeshKeys("wreck.stl", 10.0, 1.0, depth=7.0, name="the wreck")
    mesh = place_triangles(keys, array("d", (2.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0)))
    world = World("w", "", (-50.0, 50.0, -50.0, 50.0), 30.0, box=(Box(0.0, 0.0, 1.0, 1.0),))
    world = world._replace(mesh=(mesh, mesh._replace(keys=keys._replace(hidden=True))))
    markers = decode_by_rosbags(encode_obstacles(1, world), "visualization_msgs/msg/MarkerArray").markers
    assert [marker.type for marker in markers] == [1, 11]
    assert [(p.x, p.y, p.z) for p in markers[1].points] == [(1.0, 12.0, -7.0), (2.0, 10.0, -8.0), (3.0, 11.0, -9.0)]
    assert (markers[1].text, markers[1].id, markers[1].pose.orientation.w) == ("the wreck", 1, 1.0)

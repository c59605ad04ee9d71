"""The package for ROS 2 in examples/ros2, as far as it can be tested without ROS.

Its manifest is read by ROS's own parser, its Python compiles as 3.10, which Humble has, and the topics of its view are
the vehicle's with their types and durability. tests/system/ros/test_ros2_bridge.py runs its node.
"""

import ast
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from catkin_pkg.package import parse_package
from ruamel.yaml import YAML

from hil.ros.topics import TOPICS
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from tests.support.processes import ROOT

PACKAGE = ROOT / "examples" / "ros2" / "uuv_hil_ros2"
PYTHON = sorted(PACKAGE.rglob("*.py"))
NAME = "uuv_hil_ros2"
KINDS = {
    "Map": "nav_msgs/msg/OccupancyGrid", "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Odometry": "nav_msgs/msg/Odometry", "Path": "nav_msgs/msg/Path", "LaserScan": "sensor_msgs/msg/LaserScan",
    "RobotModel": "std_msgs/msg/String",
}  # fmt: skip


def displays() -> list[dict[str, Any]]:
    view = YAML(typ="safe").load(PACKAGE / "rviz" / "vehicle.rviz")["Visualization Manager"]
    assert view["Global Options"]["Fixed Frame"] == "map"
    return list(view["Displays"])


def test_the_manifest_is_valid_and_lists_all_imports() -> None:
    manifest = parse_package(str(PACKAGE / "package.xml"))
    manifest.validate()
    assert (manifest.name, manifest.get_build_type()) == (NAME, "ament_python")
    imported = {name for path in PYTHON if path.name != "setup.py" for name in imports(path)}
    ours = {NAME, "typing", "math"}
    named = {depend.name for depend in manifest.exec_depends}
    assert imported - ours <= named
    assert (PACKAGE / "resource" / NAME).exists()


def imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 10))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.partition(".")[0]
        elif isinstance(node, ast.Import):
            yield from [alias.name.partition(".")[0] for alias in node.names]


def test_the_rviz_view_shows_topics_of_the_vehicle_with_their_types() -> None:
    published = {}
    for display in displays():
        topic = display.get("Topic") or display.get("Description Topic")
        if topic:
            kind = display["Class"].rpartition("/")[2]
            row = TOPICS[topic["Value"].removeprefix("/uuv1/")]
            assert row.type == KINDS[kind]
            assert topic["Durability Policy"] == ("Transient Local" if row.qos.latched else "Volatile")
            published[row.name] = kind
    assert set(published) == {"robot_description", "map", "obstacles", "odom", "plan", "laser"}


def test_the_nodes_course_is_free_of_obstacles() -> None:
    text = (PACKAGE / NAME / "follow_course.py").read_text()
    (points,) = re.findall(r'"points", (\[.*?\])', text)
    flat = ast.literal_eval(points)
    scenario = load_scenario("paper_field")
    obstacles = load_world(scenario.world).obstacles()
    places = [(scenario.start.east, scenario.start.north), *zip(flat[::2], flat[1::2], strict=True)]
    for (a, b), (c, d) in pairwise(places):
        along = [(a + 0.01 * k * (c - a), b + 0.01 * k * (d - b)) for k in range(101)]
        assert min(each.separation(north, east)[0] for each in obstacles for east, north in along) > 1.5

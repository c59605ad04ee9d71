"""The package for ROS 2 in examples/ros2, as far as it can be tested without ROS.

Its manifest is read by ROS's own parser, its Python compiles as 3.10, which Humble has, the topics it names are the
vehicle's with their types and durability, and its node flies a simulated vehicle where stand-ins take rclpy's place.
"""

import ast
import importlib.util
import sys
from collections.abc import Iterator
from itertools import pairwise
from math import cos, dist, remainder, sin, tau
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from catkin_pkg.package import parse_package
from ruamel.yaml import YAML

from hil.ros import encoders as ros
from hil.ros import message as ros_message
from hil.ros.topics import TOPICS
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from sim.rotations import from_euler
from sim.sensors.samples import OdometrySample
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


# --- the node, with stand-ins for ROS


class StandIn:
    """The part of rclpy.node.Node that the example uses; `sent` are the commands by topic."""

    def __init__(self, _name: str) -> None:
        self.sent: dict[str, Any] = {}
        self.types: dict[str, Any] = {}
        self.timers: list[Any] = []

    def declare_parameter(self, _name: str, value: Any) -> Any:
        return SimpleNamespace(value=value)

    def create_publisher(self, kind: Any, topic: str, _depth: int) -> Any:
        self.types[topic] = kind
        return SimpleNamespace(publish=lambda message: self.sent.__setitem__(topic, message))

    def create_subscription(self, kind: Any, topic: str, _deliver: Any, _depth: int) -> None:
        self.types[topic] = kind

    def create_timer(self, _period: float, call: Any) -> None:
        self.timers.append(call)

    def get_logger(self) -> Any:
        return SimpleNamespace(info=lambda text: None)


class Twist:
    """A stand-in for geometry_msgs/Twist."""

    def __init__(self) -> None:
        self.linear, self.angular = SimpleNamespace(x=0.0), SimpleNamespace(z=0.0)


class Float64:
    """A stand-in for std_msgs/Float64."""

    def __init__(self, data: float = 0.0) -> None:
        self.data = data


class Odometry:
    """A stand-in for nav_msgs/Odometry."""


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Any:
    def publish(name: str, **members: Any) -> None:
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)

    for package in ("rclpy", "geometry_msgs", "nav_msgs", "std_msgs"):
        publish(package)
    publish("rclpy.node", Node=StandIn)
    publish("geometry_msgs.msg", Twist=Twist)
    publish("nav_msgs.msg", Odometry=Odometry)
    publish("std_msgs.msg", Float64=Float64)
    monkeypatch.syspath_prepend(str(PACKAGE))
    for name in ("follow_course", "steering", ""):
        monkeypatch.delitem(sys.modules, f"{NAME}.{name}".rstrip("."), raising=False)
    spec = importlib.util.spec_from_file_location("example", PACKAGE / NAME / "follow_course.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.FollowCourse()


def test_the_node_uses_topics_of_the_vehicle_with_their_types(node: Any) -> None:
    for topic, kind in node.types.items():
        assert TOPICS[topic.removeprefix("/uuv1/")].type.rpartition("/")[2] == kind.__name__


def namespace(value: Any) -> Any:
    return SimpleNamespace(**{k: namespace(v) for k, v in value.items()}) if isinstance(value, dict) else value


def test_the_nodes_course_is_free_of_obstacles(node: Any) -> None:
    scenario = load_scenario("paper_field")
    obstacles = load_world(scenario.world).obstacles()
    places = [(scenario.start.east, scenario.start.north), *node.points]
    for (a, b), (c, d) in pairwise(places):
        along = [(a + 0.01 * k * (c - a), b + 0.01 * k * (d - b)) for k in range(101)]
        assert min(each.separation(north, east)[0] for each in obstacles for east, north in along) > 1.5


def test_the_node_follows_its_course(node: Any) -> None:
    """The vehicle, in the slave's messages, turns at 0.5 rad/s at most and at the commanded speed."""
    north, east, heading = 0.0, 0.0, 3.0
    visited: list[tuple[float, float]] = []
    expected = list(node.points)
    for _ in range(4000):
        sample = sample_at(north, east, heading)
        payload = ros.encode_odometry(sample)
        node.on_odometry(namespace(ros_message.decode("nav_msgs/msg/Odometry", payload)))
        for timer in node.timers:
            timer()
        if len(node.points) < len(expected) - len(visited):
            visited.append((east, north))
        north, east, heading = pose_after(north, east, heading, node.sent)
    assert len(visited) == len(expected)
    assert all(dist(one, other) < 1.0 for one, other in zip(visited, expected, strict=True))
    assert node.sent["/uuv1/cmd_depth"].data == 3.0


def sample_at(north: float, east: float, heading: float) -> Any:
    return OdometrySample(1, (north, east, 3.0), from_euler(0.0, 0.0, heading), (0.0,) * 6)


def pose_after(north: float, east: float, heading: float, sent: dict[str, Any]) -> tuple[float, float, float]:
    off = remainder(sent["/uuv1/cmd_heading"].data - heading, tau)
    heading += max(-0.025, min(0.025, off))
    ahead = 0.05 * sent["/uuv1/cmd_vel"].linear.x
    return north + ahead * cos(heading), east + ahead * sin(heading), heading

"""Types of ROS 1: md5 sums, and messages both ways."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from hil.common.errors import ConfigError
from hil.gateways.ros1.messages import UnreadableError, kind_of, to_cdr, to_ros1
from hil.ros import message as ros_message
from hil.ros.topics import COMMANDS, TOPICS
from hil.ros.types import names

# Sums printed by `rosmsg md5` and `rossrv md5` of Noetic.
MD5 = {
    "geometry_msgs/msg/Twist": "9f195f881246fdfa2798d1d3eebca84a",
    "std_msgs/msg/String": "992ce8a1687cec8c8bd883ec73ca41d1",
    "sensor_msgs/msg/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/msg/CameraInfo": "c9a58c1b0b154e0e6da7578cb991d214",
    "sensor_msgs/msg/Range": "c005c34273dc426c67a020a87bc24148",
    "tf2_msgs/msg/TFMessage": "94810edda583a504dfda3829e70d7eec",
    "rosgraph_msgs/msg/Clock": "a9c97c1d230cfc112e270351a944ee47",
}
SERVICES = {
    "std_srvs/srv/SetBool": "09fb03525b03e7ea1fd3992bafd87e16",
    "std_srvs/srv/Trigger": "937c9679a518e3a18d831e57125ea522",
    "std_srvs/srv/Empty": "d41d8cd98f00b204e9800998ecf8427e",
}
NOETIC = get_typestore(Stores.ROS1_NOETIC)
CARRIED = sorted({topic.type for topic in TOPICS.values() if not topic.type.startswith("rcl_interfaces")})


def test_md5_sums_equal_those_of_noetic() -> None:
    assert {name: kind_of(name).md5sum for name in MD5} == MD5
    assert {name: kind_of(name).md5sum for name in SERVICES} == SERVICES
    assert kind_of("sensor_msgs/msg/Imu").definition.startswith("std_msgs/Header header\n")
    assert len({kind_of(name).md5sum for name in names() if name.startswith("simulation_interfaces/srv/")}) == 10


@pytest.mark.parametrize("kind", CARRIED)
def test_every_topic_has_a_ros_1_type_and_a_round_trip(kind: str) -> None:
    payload = ros_message.encode(kind, {})
    there = to_ros1(kind, payload)
    assert ros_message.decode(kind, to_cdr(kind, there)) == ros_message.decode(kind, payload)


def test_fields_that_differ_between_releases_are_converted() -> None:
    camera: Any = NOETIC.deserialize_ros1(
        to_ros1(
            "sensor_msgs/msg/CameraInfo",
            ros_message.encode(
                "sensor_msgs/msg/CameraInfo",
                {"k": range(9), "r": range(9, 18), "p": range(12), "d": (0.5,), "height": 4},
            ),
            5,
        ),
        "sensor_msgs/msg/CameraInfo",
    )
    assert (list(camera.K), list(camera.R)) == (list(range(9)), list(range(9, 18)))
    assert (list(camera.P), list(camera.D), camera.height, camera.header.seq) == (list(range(12)), [0.5], 4, 5)
    wanted = {"header": ros_message.header(3_000_000_007, "sonar"), "range": 2.5, "variance": 0.25, "max_range": 9.0}
    echo: Any = NOETIC.deserialize_ros1(
        to_ros1("sensor_msgs/msg/Range", ros_message.encode("sensor_msgs/msg/Range", wanted)), "sensor_msgs/msg/Range"
    )
    assert (echo.range, echo.max_range, echo.header.stamp.sec, echo.header.stamp.nanosec) == (2.5, 9.0, 3, 7)


@given(st.binary(max_size=300))
def test_any_bytes_are_decoded_or_refused(data: bytes) -> None:
    for name in COMMANDS:
        try:
            payload = to_cdr(TOPICS[name].type, data)
        except UnreadableError:
            continue
        assert ros_message.decode(TOPICS[name].type, payload) is not None


def test_types_without_a_ros_1_counterpart_are_refused() -> None:
    for name in ("rcl_interfaces/msg/ParameterEvent", "nobody_msgs/msg/Thing"):
        with pytest.raises(ConfigError, match=name):
            kind_of(name)
    with pytest.raises(ConfigError, match="no counterpart"):
        kind_of("rcl_interfaces/srv/SetParameters")
    with pytest.raises(UnreadableError):
        to_ros1("sensor_msgs/msg/Imu", b"\x00\x01\x00\x00short")

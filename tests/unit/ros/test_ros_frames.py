"""Transforms, clock and wrench: bytes of another implementation, and geometry by rotation matrices."""

import json
import math
import os
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.ros import encoders as ros
from hil.ros import frames as ros_frames
from hil.ros.frames import Transform
from hil.scenario.records import Ros
from hil.slave.ros.node import static_transforms
from sim.rotations import from_euler, rotate
from sim.sensors.sensor_set import read_sensors

with open(os.path.join(os.path.dirname(__file__), "..", "..", "vectors", "cdr_golden.json"), encoding="utf-8") as _file:
    MESSAGES = json.load(_file)["messages"]

TIME_NS = 1_700_000_000_123_456_789
HALF = 0.5**0.5
PLACE, TURN = (10.5, -20.25, -3.125), (HALF, 0.0, 0.0, HALF)
NUMBERS = st.floats(-1e3, 1e3)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
ANGLES = st.tuples(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3))


def golden(type_name: str, index: int = 0) -> bytes:
    return bytes.fromhex([message["hex"] for message in MESSAGES if message["type"] == type_name][index])


@pytest.mark.parametrize(
    ("index", "names"), [(0, [("odom", "base_link")]), (1, [("map", "a"), ("uuv1/base_link", "uuv1/b")]), (2, [])]
)
def test_transforms_have_the_golden_bytes(index: int, names: list[tuple[str, str]]) -> None:
    transforms = [Transform(TIME_NS, *pair, PLACE, TURN) for pair in names]
    data = golden("tf2_msgs/msg/TFMessage", index)
    assert ros_frames.encode_transforms(transforms) == data
    assert ros_frames.decode_transforms(data) == transforms


def test_clock_has_the_golden_bytes() -> None:
    data = golden("rosgraph_msgs/msg/Clock")
    assert ros_frames.encode_clock(TIME_NS) == data
    assert ros_frames.decode_clock(data) == TIME_NS


def test_wrench_has_the_golden_bytes() -> None:
    data = golden("geometry_msgs/msg/WrenchStamped")
    assert ros_frames.encode_wrench(TIME_NS, (12.5, 3.25, -40.5, 0.5, 1.25, -2.75)) == data
    assert ros_frames.decode_wrench(data) == (TIME_NS, (12.5, 3.25, -40.5), (0.5, 1.25, -2.75))


@given(VECTORS, ANGLES, VECTORS)
def test_a_mounting_transforms_points_like_its_rotation_matrix(
    position: Any, angles: Any, point: Sequence[float]
) -> None:
    """A point measured by the sensor is the same point of the vehicle, in FRD as mounted and in FLU as in tf."""
    attitude = from_euler(*angles)
    transform = ros_frames.mounted(0, "base_link", "s", position, attitude)
    frd = [p + r for p, r in zip(position, rotate(attitude, point), strict=True)]
    turned = rotate(transform.rotation, ros.swap_body(point))
    flu = [p + r for p, r in zip(transform.translation, turned, strict=True)]
    assert ros.swap_body(flu) == pytest.approx(frd, abs=1e-9)


def test_static_transforms_of_a_sensor_set_have_their_frames() -> None:
    sensors = read_sensors(
        {"imu": {"position": [0.1, 0.2, 0.3]}, "gps": {"orientation": [0.0, 0.0, math.pi / 2]}}, "here"
    )
    frames = {t.child: t for t in static_transforms(sensors, Ros(frame_prefix="uuv1/"), 7)}
    links = {"imu_link", "dvl_link", "dvl_transducer_link", "pressure_link", "gps_link"}
    assert set(frames) == {"uuv1/odom", *[f"uuv1/{link}" for link in links]}
    assert frames["uuv1/odom"] == (7, "map", "uuv1/odom", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    assert frames["uuv1/imu_link"][:4] == (7, "uuv1/base_link", "uuv1/imu_link", (0.1, -0.2, -0.3))
    assert frames["uuv1/gps_link"].rotation == pytest.approx((HALF, 0.0, 0.0, -HALF))  # to starboard
    down = rotate(frames["uuv1/dvl_transducer_link"].rotation, (0.0, 0.0, 1.0))
    assert frames["uuv1/dvl_transducer_link"].frame == "uuv1/dvl_link"
    assert down == pytest.approx((0.0, 0.0, -1.0))  # z of the log's axes is down, where up is z

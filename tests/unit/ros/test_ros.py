"""ROS messages: golden bytes of another implementation, frames by rotation matrices, noise."""

import json
import math
import os
import runpy
import struct
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.ros import encoders as ros
from hil.ros import types
from hil.ros.topics import TOPICS, TYPE_HASHES, hash_of
from sim.rotations import from_euler, matrix
from sim.sensors.samples import ImuSample, OdometrySample, PressureSample

with open(os.path.join(os.path.dirname(__file__), "..", "..", "vectors", "cdr_golden.json"), encoding="utf-8") as _file:
    GOLDEN = json.load(_file)

TIME_NS = 1_700_000_000_123_456_789
LEVEL_NORTH = (1.0, 0.0, 0.0, 0.0)
NUMBERS = st.floats(-1e6, 1e6)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
ATTITUDES = st.builds(from_euler, st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3))


def golden(type_name: str, index: int = 0) -> tuple[dict[str, Any], bytes]:
    found = [message for message in GOLDEN["messages"] if message["type"] == type_name][index]
    return found["fields"], bytes.fromhex(found["hex"])


def decode(topic: str, data: bytes) -> Any:
    decoder = ros.decoder(topic)
    assert decoder is not None
    return decoder(data)


# --- golden bytes


def test_type_hashes_equal_those_of_rosbags() -> None:
    """The hashes are those of rosbags, as are those of the definitions, see test_ros_types."""
    assert {name: TYPE_HASHES[name] for name in GOLDEN["hashes"]} == GOLDEN["hashes"]
    assert {name: types.type_hash(name) for name in TYPE_HASHES} == TYPE_HASHES


def test_each_topic_has_a_hash_a_decoder_and_an_encoder() -> None:
    assert set(TYPE_HASHES) <= {topic.type for topic in TOPICS.values()}
    assert all(hash_of(topic.type).startswith("RIHS01_") for topic in TOPICS.values())
    assert all(ros.decoder(topic) for topic in TOPICS)
    assert ros.decoder("imy") is None


def test_twist_has_the_golden_bytes() -> None:
    _, data = golden("geometry_msgs/msg/Twist")
    linear, angular = (1.5, 0.5, -0.25), (0.125, 0.25, -0.75)
    assert ros.encode_twist(linear, angular) == data
    assert ros.decode_twist(data) == (linear, angular)


def test_imu_level_and_heading_north_has_the_golden_bytes() -> None:
    _, data = golden("sensor_msgs/msg/Imu")
    sample = ImuSample(TIME_NS, LEVEL_NORTH, (0.1, 0.2, -0.3), (-0.4, -0.5, -9.75))
    assert ros.encode_imu(sample, variances=(1.0, 1.0, 2.0, 3.0)) == data
    decoded = ros.decode_imu(data)
    assert decoded is not None
    assert decoded.orientation == pytest.approx(LEVEL_NORTH)
    assert decoded._replace(orientation=LEVEL_NORTH) == sample


def test_imu_at_any_attitude_and_frame_has_the_golden_bytes() -> None:
    fields, data = golden("sensor_msgs/msg/Imu", 1)
    sample = ros.decode_imu(data)
    assert sample is not None
    w, x, y, z = ros.swap_attitude(sample.orientation)
    assert {"w": w, "x": x, "y": y, "z": z} == pytest.approx(fields["orientation"])
    again = ros.encode_imu(sample, "vehicle_1/imu", (1.0, 1.0, 2.0, 3.0))
    head = len(data) - 37 * 8
    assert again[:head] == data[:head]
    assert struct.unpack("<37d", again[head:]) == pytest.approx(struct.unpack("<37d", data[head:]), abs=1e-15)


@pytest.mark.parametrize(("index", "frames"), [(0, ("odom", "base_link")), (1, ("map", "a"))])
def test_odometry_has_the_golden_bytes(index: int, frames: tuple[str, str]) -> None:
    _, data = golden("nav_msgs/msg/Odometry", index)
    sample = OdometrySample(TIME_NS, (-20.25, 10.5, 3.125), LEVEL_NORTH, (1.5, 0.25, -0.125, 0.01, 0.02, -0.03))
    assert ros.encode_odometry(sample, *frames, variances=(0.25, 0.25, 0.5, 0.75, 1.25)) == data
    decoded = ros.decode_odometry(data)
    assert decoded is not None
    assert decoded.orientation == pytest.approx(LEVEL_NORTH)
    assert decoded._replace(orientation=LEVEL_NORTH) == sample


def test_pressure_has_the_golden_bytes() -> None:
    _, data = golden("sensor_msgs/msg/FluidPressure")
    sample = PressureSample(TIME_NS, 201_325.5)
    assert ros.encode_pressure(sample, "p", 4.0) == data
    assert ros.decode_pressure(data) == sample


def test_the_transform_of_an_odometry_sample_has_the_golden_bytes() -> None:
    _, data = golden("tf2_msgs/msg/TFMessage")
    sample = OdometrySample(TIME_NS, (-20.25, 10.5, 3.125), LEVEL_NORTH, (0.0,) * 6)
    assert ros.encode_transform(sample) == data
    ((topic, message), (other, transform)) = ros.encoder("odom")(sample, "uuv1/")
    assert (topic, other) == ("odom", "/tf")
    assert (b"uuv1/odom\0" in message, b"uuv1/base_link\0" in transform) == (True, True)


@pytest.mark.parametrize("index", [0, 1])
def test_int64_array_has_the_golden_bytes(index: int) -> None:
    fields, data = golden("std_msgs/msg/Int64MultiArray", index)
    assert ros.encode_int64_array(fields["data"]) == data
    assert ros.decode_int64_array(data) == tuple(fields["data"])


def test_int64_array_with_named_dimensions_is_decoded() -> None:
    fields, data = golden("std_msgs/msg/Int64MultiArray", 2)
    assert ros.decode_int64_array(data) == tuple(fields["data"])


@pytest.mark.parametrize("index", [0, 1])
def test_diagnostics_have_the_golden_bytes(index: int) -> None:
    fields, data = golden("diagnostic_msgs/msg/DiagnosticArray", index)
    statuses = [
        (status["name"], status["level"], status["message"], {pair["key"]: pair["value"] for pair in status["values"]})
        for status in fields["status"]
    ]
    assert ros.encode_diagnostics(TIME_NS, statuses, "pi4b") == data
    assert ros.decode_diagnostics(data) == statuses


def test_the_golden_file_equals_the_output_of_rosbags() -> None:
    path = os.path.join(os.path.dirname(__file__), "..", "..", "vectors", "make_cdr_golden.py")
    made = runpy.run_path(path)["golden"]()
    assert made["messages"] == GOLDEN["messages"]
    assert made["hashes"] == GOLDEN["hashes"]


# --- frames

ENU_OF_NED = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
FRD_OF_FLU = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
Rows = Sequence[Sequence[float]]


def multiply(a: Rows, b: Rows) -> list[list[float]]:
    return [[sum(row[k] * b[k][column] for k in range(3)) for column in range(3)] for row in a]


def rows(quaternion: Sequence[float]) -> list[Sequence[float]]:
    flat = matrix(quaternion)
    return [flat[0:3], flat[3:6], flat[6:9]]


@given(ATTITUDES)
def test_attitude_conversion_agrees_with_rotation_matrices(attitude: Sequence[float]) -> None:
    expected = multiply(multiply(ENU_OF_NED, rows(attitude)), FRD_OF_FLU)
    for found, wanted in zip(rows(ros.swap_attitude(attitude)), expected, strict=True):
        assert found == pytest.approx(wanted, abs=1e-12)
    assert ros.swap_attitude(ros.swap_attitude(attitude)) == pytest.approx(attitude, abs=1e-12)


@given(VECTORS)
def test_vector_conversion_agrees_with_rotation_matrices(vector: tuple[float, float, float]) -> None:
    world = tuple(sum(row[k] * vector[k] for k in range(3)) for row in ENU_OF_NED)
    body = tuple(sum(row[k] * vector[k] for k in range(3)) for row in FRD_OF_FLU)
    assert ros.swap_world(vector) == world
    assert ros.swap_body(vector) == body
    assert ros.swap_world(ros.swap_world(vector)) == ros.swap_body(ros.swap_body(vector)) == vector


# --- round trips


@given(st.lists(st.tuples(st.text(), st.integers(0, 255), st.text(), st.dictionaries(st.text(), st.text()))))
def test_diagnostics_survive_a_round_trip(statuses: list[Any]) -> None:
    def strip_prefix(message: str) -> str:
        return message.encode(errors="replace").decode().rstrip("\0")

    decoded = ros.decode_diagnostics(ros.encode_diagnostics(TIME_NS, statuses))
    assert decoded is not None
    assert [status[:3] for status in decoded] == [
        (strip_prefix(name), level, strip_prefix(words)) for name, level, words, _ in statuses
    ]


# --- noise


@pytest.mark.parametrize("message", GOLDEN["messages"], ids=lambda message: message["type"])
def test_a_truncated_message_is_none(message: dict[str, Any]) -> None:
    topics = [name for name, topic in TOPICS.items() if topic.type == message["type"]]
    data = bytes.fromhex(message["hex"])
    for topic in topics:
        # Humble's Range ends before the variance, and is one too.
        least = len(data) - 4 if message["type"] == "sensor_msgs/msg/Range" else len(data)
        assert all(decode(topic, data[:end]) is None for end in range(least))
        assert decode(topic, data) is not None


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("index", range(6))
def test_a_command_that_is_not_finite_is_malformed(index: int, value: float) -> None:
    values = [0.0] * 6
    values[index] = value
    assert ros.decode_twist(ros.encode_twist(values[:3], values[3:])) is None


# --- rmw_zenoh


def test_the_data_key_has_the_form_of_rmw_zenoh() -> None:
    name = "sensor_msgs/msg/Imu"
    expected = f"7/auv/imu/sensor_msgs::msg::dds_::Imu_/{TYPE_HASHES[name]}"
    assert ros.data_key(7, "/auv/imu", name, TYPE_HASHES[name]) == expected
    assert ros.data_key(7, "auv/imu", name, TYPE_HASHES[name]) == expected


def test_an_attachment_has_the_form_of_rmw_zenoh() -> None:
    gid = bytes(range(16))
    data = ros.pack_attachment(1, 2, gid)
    assert data == b"\x01" + bytes(7) + b"\x02" + bytes(7) + b"\x10" + gid
    assert ros.unpack_attachment(data) == (1, 2, gid, gid)
    assert ros.unpack_attachment(data + bytes(16)) == (1, 2, gid, bytes(16))
    assert ros.unpack_attachment(data[:-1]) is None
    assert ros.unpack_attachment(data + b"\0") is None
    assert ros.unpack_attachment(data[:16] + b"\x0f" + gid) is None
    assert ros.unpack_attachment(b"") is None

"""Message definitions and the codec driven by them, against an independent implementation (rosbags)."""

import array
import importlib.util
import json
import math
import os
import random
import struct
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hil.client.message_text import parse_values
from hil.common.errors import ConfigError
from hil.ros import message as ros_message
from hil.ros import types
from hil.ros.cdr import HEADER
from hil.ros.types import PRIMITIVES, Field

ROOT = os.path.join(os.path.dirname(__file__), "..", "..", "..")
STORE: Any = get_typestore(Stores.ROS2_JAZZY)
NAMES = types.names()
MESSAGES = [name for name in NAMES if "/msg/" in name]
SERVICES = [name for name in NAMES if "/srv/" in name]
HALVES = [f"{name}_{half}" for name in SERVICES for half in ("Request", "Response")]
# A char of a .msg is a uint8 of the IDL, which these two hashes of rosbags do not know. ServiceEventInfo's right one
# is in that of every service, and those are held against what ROS 2 Jazzy prints, below.
MISTAKEN = {"std_msgs/msg/Char", "service_msgs/msg/ServiceEventInfo"}
# Hashes printed by `ros2 topic info -v` and `ros2 service info -v`, from public repositories.
PRINTED = {
    "std_msgs/msg/String": "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "std_msgs/msg/Empty": "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312",
    "sensor_msgs/msg/CameraInfo": "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "service_msgs/msg/ServiceEventInfo": "RIHS01_41bcbbe07a75c9b52bc96bfd5c24d7f0fc0a08c0cb7921b3373c5732345a6f45",
    "std_srvs/srv/SetBool": "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
    "std_srvs/srv/Trigger": "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    "rcl_interfaces/srv/DescribeParameters": "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
    "rcl_interfaces/srv/GetParameterTypes": "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
    "rcl_interfaces/srv/GetParameters": "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
    "rcl_interfaces/srv/ListParameters": "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
    "rcl_interfaces/srv/SetParameters": "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
    "rcl_interfaces/srv/SetParametersAtomically": (
        "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd"
    ),
    "std_srvs/srv/Empty": "RIHS01_5888399dedec5ccc85ea6451949fd2c9f97bfdf963f9a588821639fcd31b5d19",
}


def _register() -> None:
    """Register in rosbags the definitions it lacks, from our files; the halves of services as messages."""
    definitions: dict[str, Any] = {}
    for name in [*MESSAGES, *HALVES]:
        if name not in STORE.types:
            definitions |= get_types_from_msg(types.definition(name).text, name)
    STORE.register(definitions)


_register()


def definition_of_rosbags(name: str) -> str:
    """Return the name of the type in rosbags."""
    return name if name in STORE.types else name.replace("/srv/", "/srv/msg/")


# --- random messages: a value as ours and as theirs


def random_number(kind: str, source: random.Random) -> Any:
    if kind == "bool":
        return source.random() < 0.5
    if kind == "float32":
        return struct.unpack("<f", struct.pack("<f", source.uniform(-1e6, 1e6)))[0]
    if kind == "float64":
        return source.choice([source.uniform(-1e9, 1e9), math.inf, -math.inf, 0.0])
    if kind == "byte":
        return source.randrange(128)  # rosbags packs an octet as a signed number
    bits = 8 * struct.calcsize(f"<{PRIMITIVES[kind]}")
    return source.randrange(2**bits) - (2 ** (bits - 1) if kind.startswith("int") else 0)


def random_string(source: random.Random) -> str:
    return "".join(source.choices("abcdefg_/ äπ0123", k=source.randrange(12)))


def random_value(field: Field, source: random.Random) -> tuple[Any, Any]:
    if field.length is None:
        return random_one(field.type, source)
    count = field.length or source.choice(range(field.most + 1) if field.most else [0, 1, 2, 3, 7])
    pairs = [random_one(field.type, source) for _ in range(count)]
    values, others = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    code = PRIMITIVES.get(field.type, "")
    if code:
        return bytes(values) if code == "B" else tuple(values), np.array(others, dtype=f"<{code}".replace("<?", "?"))
    return values, others


def random_one(kind: str, source: random.Random) -> tuple[Any, Any]:
    if kind == "string":
        text = random_string(source)
        return text, text
    if kind in PRIMITIVES:
        number = random_number(kind, source)
        return number, number
    return random_message(kind, source)


def random_message(name: str, source: random.Random) -> tuple[dict[str, Any], Any]:
    pairs = {field.name: random_value(field, source) for field in types.definition(name).fields}
    made = STORE.types[definition_of_rosbags(name)](**{key: pair[1] for key, pair in pairs.items()})
    return {key: pair[0] for key, pair in pairs.items()}, made


def test_random_messages_equal_those_of_rosbags_both_ways() -> None:
    for name in [*MESSAGES, *HALVES]:
        source = random.Random(name)
        for _ in range(12):
            encoded, other = random_message(name, source)
            data = bytes(STORE.serialize_cdr(other, definition_of_rosbags(name)))
            assert ros_message.encode(name, encoded) == data, name
            assert ros_message.decode(name, data) == encoded, name


# --- definitions


def test_the_type_hash_of_a_message_equals_that_of_rosbags() -> None:
    for name in MESSAGES:
        if name not in MISTAKEN:
            assert types.type_hash(name) == STORE.hash_rihs01(name), name


@pytest.mark.parametrize("name", PRINTED)
def test_the_type_hash_has_the_form_that_ros_prints(name: str) -> None:
    assert types.type_hash(name) == PRINTED[name]


def test_the_hash_file_equals_the_output_of_its_tool() -> None:
    spec = importlib.util.spec_from_file_location("ros_types", os.path.join(ROOT, "tools", "ros_types.py"))
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert {name: tool.type_hash(name) for name in NAMES} == {name: types.type_hash(name) for name in NAMES}
    for package in tool.FROM_ROSBAGS:
        kept = {name: types.definition(name).text for name in MESSAGES if name.startswith(f"{package}/")}
        assert tool.definitions_of_rosbags(package) == kept


def test_the_full_definition_text_is_self_contained() -> None:
    """A recording carries the text with all types in it, each once."""
    text = types.full_text("nav_msgs/msg/Odometry")
    assert text.startswith("std_msgs/Header header\nstring child_frame_id\n")
    read = get_types_from_msg(text, "nav_msgs/msg/Odometry")
    assert {name: read[name] for name in read} == {name: STORE.fielddefs[name] for name in read}
    assert {"builtin_interfaces/msg/Time", "geometry_msgs/msg/PoseWithCovariance"} < set(read)


# --- values


def test_omitted_fields_are_zero_and_orientations_level() -> None:
    message = ros_message.empty("geometry_msgs/msg/PoseStamped")
    assert message["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert ros_message.encode("std_srvs/srv/Trigger_Request", {}) == HEADER + b"\0"


@pytest.mark.parametrize(
    "data",
    [np.arange(5.0, dtype=np.float32), array.array("f", range(5)), [0.0, 1.0, 2.0, 3.0, 4.0], np.arange(5),
     struct.pack("<5f", *range(5)), memoryview(struct.pack("<5f", *range(5))), range(5)],
    ids=["numpy", "array", "list", "numpy of integers", "bytes", "memoryview", "range"],
)  # fmt: skip
def test_arrays_may_be_any_sequence_or_buffer(data: Any) -> None:
    payload = ros_message.encode("sensor_msgs/msg/LaserScan", {"ranges": data, "header": {"frame_id": "ab"}})
    message = ros_message.decode("sensor_msgs/msg/LaserScan", payload)
    assert message is not None
    assert message["ranges"] == (0.0, 1.0, 2.0, 3.0, 4.0)


def test_an_image_may_be_an_array_of_rows() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(4, 6)
    message = ros_message.decode("sensor_msgs/msg/Image", ros_message.encode("sensor_msgs/msg/Image", {"data": pixels}))
    assert message is not None
    assert message["data"] == bytes(range(24))


def test_a_bounded_sequence_is_limited() -> None:
    name, one = "rcl_interfaces/msg/ParameterDescriptor", {"to_value": 3}
    message = ros_message.decode(name, ros_message.encode(name, {"integer_range": [one]}))
    assert message is not None
    assert message["integer_range"] == [{"from_value": 0, "to_value": 3, "step": 0}]
    with pytest.raises(ConfigError, match=r"ParameterDescriptor.integer_range: 2 values, at most 1"):
        ros_message.encode(name, {"integer_range": [one, one]})
    too_many = ros_message.encode("std_msgs/msg/UInt32", {"data": 2})[4:] + bytes(64)
    assert ros_message.decode(name, ros_message.encode(name, {})[:-8] + bytes(4) + too_many) is None


@pytest.mark.parametrize("value", ["off", "false", "true", "", 2, -1, 1.5, [1], (), {}, [], np.zeros(3), math.nan])
def test_a_bool_field_refuses_other_values(value: Any) -> None:
    """Python's truth value of "off" would arm a vehicle."""
    with pytest.raises(ConfigError, match=r"SetBool_Request\.data: expected true or false, found "):
        ros_message.encode("std_srvs/srv/SetBool_Request", {"data": value})


@pytest.mark.parametrize("value", [False, 0, np.False_, True, 1, np.True_])
def test_a_bool_field_accepts_bools_0_and_1(value: Any) -> None:
    payload = ros_message.encode("std_srvs/srv/SetBool_Request", {"data": value})
    assert payload == HEADER + bytes([bool(value)])


def test_a_list_of_bools_is_encoded() -> None:
    name = "rcl_interfaces/msg/ParameterValue"
    message = ros_message.decode(name, ros_message.encode(name, {"bool_array_value": [True, 0, False, 1]}))
    assert message is not None
    assert message["bool_array_value"] == (True, False, False, True)
    with pytest.raises(ConfigError, match=r"bool_array_value: expected true or false, found 'no'"):
        ros_message.encode(name, {"bool_array_value": [True, "no"]})


# --- noise


@given(st.sampled_from(MESSAGES), st.binary(max_size=300))
def test_noise_never_raises(name: str, noise: bytes) -> None:
    """A message decoded from noise can be sent again."""
    for data in (noise, HEADER + noise):
        found = ros_message.decode(name, data)
        assert found is None or repr(ros_message.decode(name, ros_message.encode(name, found))) == repr(found)


@pytest.mark.parametrize("name", ["diagnostic_msgs/msg/DiagnosticArray", "sensor_msgs/msg/PointCloud2"])
def test_truncated_messages_are_malformed(name: str) -> None:
    ours, _ = random_message(name, random.Random(3))
    data = ros_message.encode(name, ours)
    assert all(ros_message.decode(name, data[:end]) is None for end in range(len(data)))


def test_a_count_beyond_the_message_allocates_nothing() -> None:
    for name in ("tf2_msgs/msg/TFMessage", "sensor_msgs/msg/PointCloud2", "std_msgs/msg/String"):
        assert ros_message.decode(name, HEADER + b"\xff" * 64) is None


def test_messages_can_be_written_as_json_except_bytes() -> None:
    message = ros_message.empty("nav_msgs/msg/Odometry")
    again: Sequence[float] = json.loads(json.dumps(message))["pose"]["covariance"]
    assert again == [0.0] * 36


@given(st.text(max_size=30))
def test_random_text_raises_no_other_error(text: str) -> None:
    for noise in (text, f"{{{text}", f"{{a: {text}}}"):
        with suppress(ConfigError):
            assert isinstance(parse_values(noise), dict)

"""Messages of rosbridge: JSON and CBOR of every type, round trips, and any client input."""

import json
import math
from typing import Any

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common.errors import ConfigError
from hil.common.text import json_text
from hil.gateways.rosbridge.client import Subscription
from hil.gateways.rosbridge.rosapi import typedefs
from hil.gateways.values import arguments, from_json, to_cbor, to_json, whole_type
from hil.ros import message as ros_message
from hil.ros import types
from hil.ros.topics import TOPICS

TYPES = sorted({topic.type for topic in TOPICS.values()})
MESSAGES = [name for name in types.names() if "/msg/" in name]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
IMAGE: dict[str, Any] = {"header": {"frame_id": "camera"}, "height": 1, "width": 3, "step": 3, "data": b"\x00\x7f\xff"}


def test_a_message_survives_a_json_round_trip() -> None:
    for name in MESSAGES:
        message = ros_message.empty(name)
        back = from_json(name, json.loads(json_text(to_json(name, message))))
        assert ros_message.encode(name, back) == ros_message.encode(name, message), name


def test_every_message_type_is_encoded_as_cbor_with_all_fields() -> None:
    for name in TYPES:
        message = ros_message.empty(name)
        assert set(cbor2.loads(cbor2.dumps(to_cbor(name, message)))) == set(message), name


def test_bytes_are_base64_in_json_and_bytes_in_cbor() -> None:
    kind = "sensor_msgs/msg/Image"
    message = ros_message.decode(kind, ros_message.encode(kind, IMAGE))
    assert message is not None
    assert to_json(kind, message)["data"] == "AH//"
    assert to_cbor(kind, message)["data"] == IMAGE["data"]
    for given_data in ("AH//", [0, 127, 255]):
        assert from_json(kind, {"data": given_data})["data"] == IMAGE["data"]


def test_number_arrays_in_cbor_are_typed_arrays() -> None:
    """RFC 8746 says: 85 is float32, 86 float64, each little-endian."""
    scan = ros_message.decode(
        "sensor_msgs/msg/LaserScan", ros_message.encode("sensor_msgs/msg/LaserScan", {"ranges": (1.0, 2.5)})
    )
    assert scan is not None
    found = to_cbor("sensor_msgs/msg/LaserScan", scan)["ranges"]
    assert (found.tag, found.value.hex()) == (85, "0000803f00002040")
    imu = to_cbor("sensor_msgs/msg/Imu", ros_message.empty("sensor_msgs/msg/Imu"))["orientation_covariance"]
    assert (imu.tag, len(imu.value)) == (86, 72)


def test_non_finite_numbers_are_null_in_json() -> None:
    kind = "std_msgs/msg/Float64"
    assert json_text(to_json(kind, {"data": math.inf})) == '{"data": null}'
    assert math.isnan(from_json(kind, {"data": None})["data"])


def test_ros_1_names_are_accepted() -> None:
    header = from_json("std_msgs/msg/Header", {"seq": 4, "stamp": {"secs": 5, "nsecs": 6}, "frame_id": "a"})
    assert header == {"stamp": {"sec": 5, "nanosec": 6}, "frame_id": "a"}
    assert whole_type("geometry_msgs/Twist") == "geometry_msgs/msg/Twist"
    assert whole_type("std_srvs/SetBool", "srv") == "std_srvs/srv/SetBool"


@given(st.sampled_from(MESSAGES), st.data())
def test_any_values_are_encoded_or_refused(kind: str, data: st.DataObject) -> None:
    names = [field.name for field in types.definition(kind).fields]
    values = data.draw(st.dictionaries(st.sampled_from(names), JSON) | JSON if names else JSON)
    try:
        payload = ros_message.encode(kind, from_json(kind, values))
    except ConfigError:
        return
    assert ros_message.decode(kind, payload) is not None


def test_service_arguments_are_named_or_positional() -> None:
    kind = "std_srvs/srv/SetBool_Request"
    assert arguments(kind, [True]) == arguments(kind, {"data": True}) == {"data": True}
    assert arguments(kind, None) == {}
    with pytest.raises(ConfigError, match="2 values for 1"):
        arguments(kind, [True, False])


def test_typedefs_contain_all_nested_types() -> None:
    definitions = {each["type"]: each for each in typedefs("geometry_msgs/msg/PoseStamped")}
    assert set(definitions) == {
        "geometry_msgs/msg/PoseStamped", "std_msgs/msg/Header", "builtin_interfaces/msg/Time",
        "geometry_msgs/msg/Pose", "geometry_msgs/msg/Point", "geometry_msgs/msg/Quaternion",
    }  # fmt: skip
    assert definitions["std_msgs/msg/Header"]["fieldnames"] == ["stamp", "frame_id"]


# --- when messages are sent

MS = 1_000_000


def test_a_throttle_leaves_messages_out() -> None:
    subscription = Subscription()
    subscription.add("a", {"throttle_rate": 100, "queue_length": 5})
    assert [subscription.admits(number * 40 * MS) for number in range(6)] == [True, False, False, True, False, False]


def test_the_faster_of_two_subscriptions_applies_until_removed() -> None:
    subscription = Subscription()
    subscription.add("slow", {"throttle_rate": 1000})
    subscription.add("fast", {"compression": "cbor"})
    assert subscription.compression == "cbor"
    assert all(subscription.admits(now) for now in range(3))
    assert not subscription.remove("fast")
    assert subscription.compression == "none"
    assert [subscription.admits(10), subscription.admits(20)] == [True, False]
    assert subscription.remove("slow")


@given(st.dictionaries(st.sampled_from(["throttle_rate", "compression"]), JSON))
def test_invalid_subscription_options_are_bounded_or_refused(message: dict[str, Any]) -> None:
    subscription = Subscription()
    try:
        subscription.add("a", message)
    except ConfigError:
        return
    assert subscription.admits(0)
    assert subscription.admits(3600 * 10**9)

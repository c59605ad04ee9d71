"""Liveliness tokens of the ROS graph, compared with the rules of rmw_zenoh and with tokens of another library."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.ros import dialect, graph
from hil.ros.gid import gid_of
from hil.ros.graph import Entity, read_token, token
from hil.ros.topics import TOPICS, TYPE_HASHES, Qos, hash_of

TWIST = TYPE_HASHES["geometry_msgs/msg/Twist"]
SETBOOL = "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a"
# What zenoh-ros2-sdk 0.1.8 (ROBOTIS) declares, and what it means.
FOREIGN_TOKENS = {
    "@ros2_lv/0/5dc6c55f2a9a8ba2ac0f2ef3ba7bc0e3/3/3/NN/%/%/talker": Entity(
        "NN", "/talker", "5dc6c55f2a9a8ba2ac0f2ef3ba7bc0e3", 3, 3
    ),
    f"@ros2_lv/0/5dc6/1/2/MP/%/%/talker/%uuv1%cmd_vel/geometry_msgs::msg::dds_::Twist_/{TWIST}/::,10:,:,:,,": Entity(
        "MP", "/talker", "5dc6", 1, 2, "/uuv1/cmd_vel", "geometry_msgs/msg/Twist", TWIST, Qos()
    ),
    f"@ros2_lv/0/5dc6/4/5/MS/%/%a%b/rviz/%map/nav_msgs::msg::dds_::OccupancyGrid_/{TWIST}/:1:,1:,:,:,,": Entity(
        "MS", "/a/b/rviz", "5dc6", 4, 5, "/map", "nav_msgs/msg/OccupancyGrid", TWIST, Qos(latched=True, depth=1)
    ),
    f"@ros2_lv/0/5dc6/6/7/MS/%/%/view/%i/sensor_msgs::msg::dds_::Image_/{TWIST}/2::,5:,:,:,,": Entity(
        "MS", "/view", "5dc6", 6, 7, "/i", "sensor_msgs/msg/Image", TWIST, Qos(reliable=False, depth=5)
    ),
    f"@ros2_lv/0/5dc6/6/7/MS/%/%/log/%i/sensor_msgs::msg::dds_::Image_/{TWIST}/::2,:,:,:,,": Entity(
        "MS", "/log", "5dc6", 6, 7, "/i", "sensor_msgs/msg/Image", TWIST, Qos(depth=0)
    ),
    f"@ros2_lv/0/5dc6/8/9/SC/%/%/cli/%uuv1%arm/std_srvs::srv::dds_::SetBool_/{SETBOOL}/::,10:,:,:,,": Entity(
        "SC", "/cli", "5dc6", 8, 9, "/uuv1/arm", "std_srvs/srv/SetBool", SETBOOL, Qos()
    ),
}
MAP = (
    "@ros2_lv/0/5dc6c55f2a9a8ba2ac0f2ef3ba7bc0e3/4/15/MP/%/%/uuv1/%uuv1%map/nav_msgs::msg::dds_::OccupancyGrid_/"
    "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7"
)
NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)


def read_by_the_rules(key: str) -> dict[str, Any]:
    """Decode a token as rmw_zenoh_cpp does, in its order of parts and with its numbers (rmw/types.h)."""
    order = (
        "admin", "domain", "zid", "nid", "id", "kind", "enclave", "namespace", "name", "topic", "type", "hash", "qos",
    )  # fmt: skip
    fields = key.split("/")
    assert all(fields), "an empty part is refused"
    assert len(fields) in (9, 13)
    values: dict[str, Any] = dict(zip(order, fields, strict=False))
    for name in ("enclave", "namespace", "name", "topic", "type"):
        if name in values:
            values[name] = values[name].replace("%", "/")
    if "qos" in values:
        reliability, durability, history, deadline, lifespan, liveliness = values["qos"].split(":")
        policy, depth = history.split(",")
        values["reliability"] = {"": "reliable", "1": "reliable", "2": "best effort"}[reliability]
        values["durability"] = {"": "volatile", "1": "transient local", "2": "volatile"}[durability]
        values["history"] = {"": "keep last", "1": "keep last", "2": "keep all"}[policy]
        values["depth"] = int(depth or 42)
        assert [deadline, lifespan, liveliness] == [",", ",", ",,"]
    return values


@pytest.mark.parametrize(
    ("key", "entity"), FOREIGN_TOKENS.items(), ids=[entity.node for entity in FOREIGN_TOKENS.values()]
)
def test_tokens_of_another_library_are_decoded_and_encoded(key: str, entity: Entity) -> None:
    assert read_token(key) == entity
    assert token(entity) == key


def check_topic(topic: Any) -> None:
    type_hash = hash_of(topic.type)
    full = topic.full_name("uuv1")
    entity = Entity("MP", "/uuv1", "abc123", 0, 4, full, topic.type, type_hash, topic.qos)
    decoded = read_by_the_rules(token(entity))
    package, _, name = topic.type.split("/")
    assert decoded["topic"] == (topic.name if topic.name.startswith("/") else f"/uuv1/{topic.name}")
    assert decoded["type"] == f"{package}::msg::dds_::{name}_"
    assert (decoded["hash"], decoded["name"], decoded["namespace"], decoded["enclave"]) == (type_hash, "uuv1", "/", "/")
    assert decoded["reliability"] == ("reliable" if topic.qos.reliable else "best effort")
    assert decoded["durability"] == ("transient local" if topic.qos.latched else "volatile")
    assert (decoded["history"], decoded["depth"]) == ("keep last", topic.qos.depth)
    assert read_token(token(entity)) == entity


def test_tokens_of_each_topic_follow_the_rules_of_rmw_zenoh() -> None:
    for topic in TOPICS.values():
        check_topic(topic)


def test_qos_of_common_topics_is_that_of_ros() -> None:
    assert graph.qos_text(TOPICS["/tf_static"].qos) == ":1:,1:,:,:,,"
    assert graph.qos_text(TOPICS["/tf"].qos) == "::,100:,:,:,,"
    assert graph.qos_text(TOPICS["/clock"].qos) == "2::,1:,:,:,,"
    assert graph.qos_text(TOPICS["imu"].qos) == "::,10:,:,:,,"


@given(
    st.sampled_from(["MP", "MS", "SS", "SC"]), st.lists(NAMES, min_size=1, max_size=3), st.lists(NAMES, min_size=1),
    st.integers(0, 999), st.builds(Qos, st.booleans(), st.booleans(), st.integers(0, 1000)),
)  # fmt: skip
def test_tokens_round_trip(kind: Any, node: list[str], topic: list[str], ident: int, qos: Qos) -> None:
    entity = Entity(kind, "/" + "/".join(node), "a1", 0, ident, "/" + "/".join(topic), "a_b/msg/C", "RIHS01_0", qos)
    assert read_token(token(entity)) == entity
    read_by_the_rules(token(entity))


@given(st.text(max_size=60), st.sampled_from(list(FOREIGN_TOKENS)), st.integers(0, 12))
def test_malformed_tokens_raise_no_error(noise: str, key: str, index: int) -> None:
    """A decoded token is an entity, whose own token is the same."""
    parts = key.split("/")
    parts[min(index, len(parts) - 1)] = noise
    for text in (noise, "/".join(parts)):
        entity = read_token(text)
        assert entity is None or read_token(token(entity)) == entity


@pytest.mark.parametrize(
    ("key", "gid"),
    [  # of three lengths, by python-xxhash 3.6 (XXH3, 128 bits, the low half first)
        (f"@ros2_lv/0/5dc6/1/2/MP/%/%/talker/%a/std_msgs::msg::dds_::Bool_/{dialect.NO_HASH}/::,10:,:,:,,",
         "eb5baac5cc55316d190fd7edb4b08244"),
        (f"{MAP}/:1:,1:,:,:,,", "fd0562375e1c490c24fcf01fe7aaeff9"),
        (f"{MAP}/:1:,1:,:,:,,".replace("%map", "%a_name_that_is_long_enough_for_a_token_of_more_than_240_bytes"),
         "033f7811e5f6d73481bb5cfc45a90ca6"),
    ],
)  # fmt: skip
def test_the_gid_of_an_endpoint_is_the_hash_of_its_token(key: str, gid: str) -> None:
    assert gid_of(key).hex() == gid


def test_additional_parts_of_a_newer_rmw_zenoh_are_ignored() -> None:
    entity = Entity("MP", "/n", "ab", 1, 2, "/chat", "std_msgs/msg/String", "RIHS01_1", Qos(latched=True, depth=1))
    newer = token(entity)
    for more in ("/cuda:shm", "/a/b", ":9,", ":/a"):
        assert read_token(newer + more) == entity, more
    node = entity._replace(kind="NN", topic="", type="", type_hash="", qos=Qos())
    assert read_token(token(node) + "/more") == node


@pytest.mark.parametrize(
    "key",
    ["", "@ros2_lv", "0/uuv1/imu/a/b", "@ros2_lv/0/a/0/0/XX/%/%/n", "@ros2_lv/0/a/x/0/NN/%/%/n",
     "@ros2_lv/0/a/0/0/MP/%/%/n", "@ros2_lv/0/a/0/0/MP/%/%/n/%t/a::msg::dds_::B_/h/::,x:,:,:,,",
     "@ros2_lv/0/a/0/0/MP/%/%/n/%t/a::msg::B/h/::,1:,:,:,,", "@ros2_lv/0/a/0/0/MP/%/%/n/%t/a::msg::dds_::B_/h/"],
)  # fmt: skip
def test_an_invalid_token_is_none(key: str) -> None:
    assert read_token(key) is None

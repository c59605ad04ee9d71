"""TCPROS byte by byte, messages that wait for a subscriber, and which publisher commands."""

import asyncio
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common.errors import ConfigError
from hil.gateways.ros1 import bridge, subscription
from hil.gateways.ros1.messages import kind_of
from hil.gateways.ros1.parameters import leaves
from hil.gateways.ros1.publication import MAX_BYTES, MAX_WAITING, Publication, Subscriber
from hil.gateways.ros1.subscription import Caller, Subscription
from hil.gateways.ros1.tcpros import PeerError, decode_header, encode_header, read_frame, require_type
from hil.recording.mcap_file import Message
from hil.ros import message as ros_message

# The beginning of the example in http://wiki.ros.org/ROS/Connection Header: message_definition=string data, and so on.
WIKI = bytes.fromhex(
    "20000000" + b"message_definition=string data\n\n".hex()
    + "25000000" + b"callerid=/rostopic_4767_1316912741557".hex()
    + "0a000000" + b"latching=1".hex()
    + "27000000" + b"md5sum=992ce8a1687cec8c8bd883ec73ca41d1".hex()
    + "0e000000" + b"topic=/chatter".hex()
    + "14000000" + b"type=std_msgs/String".hex()
)  # fmt: skip


def test_a_header_has_the_bytes_of_the_ros_wiki() -> None:
    fields = decode_header(WIKI)
    assert (fields["topic"], fields["latching"], fields["type"]) == ("/chatter", "1", "std_msgs/String")
    assert encode_header(fields) == b"\xb0\x00\x00\x00" + WIKI  # the 176 bytes that the page shows


@given(st.binary(max_size=200))
def test_any_bytes_are_decoded_as_a_header_or_refused(data: bytes) -> None:
    try:
        fields = decode_header(data)
    except PeerError:
        return
    assert bool(fields) == bool(data)


def test_types_must_match_unless_a_wildcard_is_given() -> None:
    require_type({"md5sum": "*", "type": "*"}, "/x", "a/B", "1")
    require_type({"md5sum": "1"}, "/x", "a/B", "1")
    for fields in ({"md5sum": "2"}, {"md5sum": "1", "type": "a/C"}, {"type": "a/B"}):
        with pytest.raises(PeerError):
            require_type(fields, "/x", "a/B", "1")


def test_a_frame_that_is_too_large_is_refused_by_its_length() -> None:
    async def run() -> None:
        reader = asyncio.StreamReader()
        reader.feed_data(b"\xff\xff\xff\x7f")
        with pytest.raises(PeerError, match="at most 100"):
            await read_frame(reader, 100, "a command")

    asyncio.run(run())


def test_a_slow_subscriber_loses_the_oldest_messages() -> None:
    async def run() -> None:
        subscriber = Subscriber("/slow")
        for number in range(MAX_WAITING + 20):
            subscriber.put(b"%d" % number)
        assert subscriber.dropped == 20
        subscriber.put(bytes(MAX_BYTES + 1))
        assert subscriber.dropped == 20 + MAX_WAITING, "a single message is queued at any size"

    asyncio.run(run())


def test_unreadable_messages_are_dropped_and_latched_ones_stored() -> None:
    publication = Publication("/tf", kind_of("std_msgs/msg/String"), 2, lambda _topic: None)
    subscriber = Subscriber("/slow")
    publication.subscribers.add(subscriber)

    def publish(data: bytes) -> None:
        publication.publish(Message("/tf", "std_msgs/msg/String", 1, 0, 0, data))

    publish(b"no CDR")
    assert not subscriber._waiting
    publication.subscribers.clear()
    for text in ("a", "b", "b", "c"):
        publish(ros_message.encode("std_msgs/msg/String", {"data": text}))
    assert [each.data[8:9] for each in publication._last] == [b"b", b"c"]


def test_only_one_publisher_commands_and_stale_commands_are_not_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    now, sent, lines = [0], list[bytes](), list[str]()
    monkeypatch.setattr(subscription, "now_ns", lambda: now[0])

    twist = kind_of("geometry_msgs/msg/Twist")

    async def run() -> None:
        commands = Subscription(
            "/uuv1/cmd_vel", twist, Caller("/us", cast(Any, None)), lambda _topic, data: sent.append(data),
            lambda _key, line: lines.append(line),
        )  # fmt: skip
        for number in range(3):  # before the first is sent
            commands._accept_command("/first", bytes([number]) * 48)
        commands._accept_command("/first", b"short")
        commands._accept_command("/second", bytes(48))
        assert (commands.received, commands.malformed, commands.refused, commands.superseded) == (3, 1, 1, 2)
        assert lines == ["/uuv1/cmd_vel: /first commands; what /second sends is dropped"]
        while not sent:
            await asyncio.sleep(0)
        now[0] = subscription.HELD_NS
        commands._accept_command("/second", bytes(48))
        assert commands.received == 4, "the first has been silent for a second"
        await commands.close()

    asyncio.run(run())
    assert sent[0][4:] == b"\x02" * 48


def test_addresses_of_master_and_node_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_MASTER_URI", raising=False)
    assert bridge.master_uri() == "http://localhost:11311"
    for uri in ("localhost:11311", "http://host", "http://host:port", "tcp/1:2"):
        monkeypatch.setenv("ROS_MASTER_URI", uri)
        with pytest.raises(ConfigError, match="ROS_MASTER_URI"):
            bridge.master_uri()
    monkeypatch.setenv("ROS_IP", "192.0.2.7")
    assert bridge.own_host("127.0.0.1", "http://localhost:11311") == "127.0.0.1"
    assert bridge.own_host("0.0.0.0", "http://localhost:11311") == "192.0.2.7"
    monkeypatch.setenv("ROS_HOSTNAME", "vehicle")
    assert bridge.own_host("0.0.0.0", "http://localhost:11311") == "vehicle"
    monkeypatch.delenv("ROS_HOSTNAME")
    monkeypatch.delenv("ROS_IP")
    assert bridge.own_host("0.0.0.0", "http://127.0.0.1:11311") == "127.0.0.1"


def test_a_parameter_tree_is_flattened_to_leaves() -> None:
    assert list(leaves("/a", {"b": {"c": 1, "d": ""}, "e": 2.0})) == [("/a/b/c", 1), ("/a/b/d", ""), ("/a/e", 2.0)]

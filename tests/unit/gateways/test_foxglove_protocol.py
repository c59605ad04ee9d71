"""Foxglove's websocket protocol: bytes as its specification has them, and whatever comes off the wire."""

from struct import pack
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from hil.gateways.foxglove.layout import MESSAGES_OF_PLOTS, layout, topics_of
from hil.gateways.foxglove.protocol import (
    ClientMessage,
    ServiceRequest,
    decode_binary,
    decode_text,
    encode_message,
    encode_response,
)
from hil.ros import message as ros_message
from hil.ros.topics import TOPICS


def test_binary_messages_are_those_of_the_specification() -> None:
    assert encode_message(7, 1_000, b"data") == b"\x01\x07\0\0\0\xe8\x03\0\0\0\0\0\0data"
    assert decode_binary(b"\x01\x09\0\0\0payload") == ClientMessage(9, b"payload")
    request = ServiceRequest(3, 5, "cdr", b"body")
    assert decode_binary(b"\x02" + pack("<III", 3, 5, 3) + b"cdrbody") == request
    assert encode_response(request, b"answer") == b"\x03" + pack("<III", 3, 5, 3) + b"cdranswer"


@given(st.binary(max_size=64))
def test_any_bytes_are_a_message_or_none(data: bytes) -> None:
    message = decode_binary(data)
    assert message is None or data.endswith(message.data)


@given(st.text(max_size=64))
def test_any_text_is_an_object_with_an_op_or_none(text: str) -> None:
    message = decode_text(text)
    assert message is None or isinstance(message["op"], str)


def test_a_length_beyond_the_end_is_no_message() -> None:
    assert decode_binary(b"\x02" + pack("<III", 1, 2, 100) + b"cdr") is None
    assert decode_text("[" * 100_000) is None


def test_the_layout_names_the_topics_of_its_vehicle() -> None:
    text = layout("uuv7")
    assert all(topic in text for topic in topics_of("uuv7"))
    assert "/uuv1/" not in text


def test_the_layout_plots_fields_that_messages_have() -> None:
    for curves in MESSAGES_OF_PLOTS.values():
        for path, _ in curves:
            name, *fields = path.partition("[")[0].split(".")
            message: Any = ros_message.empty(TOPICS[name].type)
            for field in fields:
                message = message[field]
    assert topics_of("uuv1") - {topic.full_name("uuv1") for topic in TOPICS.values()} == {"/uuv1/forward_sonar/fan"}

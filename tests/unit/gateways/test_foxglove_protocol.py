"""Foxglove's websocket protocol: bytes as its specification has them, and any bytes off the network."""

import json
import re
from struct import pack

from hypothesis import given
from hypothesis import strategies as st

from hil.gateways.foxglove.layout import layout
from hil.gateways.foxglove.protocol import (
    ClientMessage,
    ServiceRequest,
    decode_binary,
    decode_text,
    encode_message,
    encode_response,
)
from hil.scenario.config import load_scenario
from hil.scenario.records import Ros
from sim.sensors.sensor_set import load_sensor, select_sensors

SENSORS = {name: load_sensor(name).Model() for name in ("camera", "forward_sonar", "laser", "battery")}


def test_binary_messages_have_the_bytes_of_the_specification() -> None:
    assert encode_message(7, 1_000, b"data") == b"\x01\x07\0\0\0\xe8\x03\0\0\0\0\0\0data"
    assert decode_binary(b"\x01\x09\0\0\0payload") == ClientMessage(9, b"payload")
    request = ServiceRequest(3, 5, "cdr", b"body")
    assert decode_binary(b"\x02" + pack("<III", 3, 5, 3) + b"cdrbody") == request
    assert encode_response(request, b"answer") == b"\x03" + pack("<III", 3, 5, 3) + b"cdranswer"


@given(st.binary(max_size=64))
def test_any_bytes_are_decoded_as_a_message_or_refused(data: bytes) -> None:
    message = decode_binary(data)
    assert message is None or data.endswith(message.data)


@given(st.text(max_size=64))
def test_any_text_is_parsed_as_an_operation_or_refused(text: str) -> None:
    message = decode_text(text)
    assert message is None or isinstance(message["op"], str)


def test_a_length_beyond_the_end_is_refused() -> None:
    assert decode_binary(b"\x02" + pack("<III", 1, 2, 100) + b"cdr") is None
    assert decode_text("[" * 100_000) is None


def test_the_layout_has_panels_for_the_vehicles_sensors_only() -> None:
    """A vehicle without a camera, sonar or battery has no panel for it."""
    usual = json.loads(layout("uuv1"))["configById"]
    assert not any(panel.startswith("Image!") for panel in usual)
    assert "Plot!turn" in usual
    assert "/uuv1/laser" not in usual["3D!scene"]["topics"]
    scenario = load_scenario("paper_field")._replace(
        sensors=select_sensors(**SENSORS), ros=Ros(frame_prefix="a/", images="raw")
    )
    fitted = json.loads(layout("uuv1", scenario))["configById"]
    images = [panel["imageMode"]["imageTopic"] for name, panel in fitted.items() if name.startswith("Image!")]
    assert images == ["/uuv1/camera/image_raw", "/uuv1/forward_sonar/fan/image_raw"]
    assert "Plot!battery" in fitted
    assert "Plot!turn" not in fitted
    scene = fitted["3D!scene"]
    assert scene["followTf"] == "a/base_link"
    assert scene["topics"]["/uuv1/laser"]["colorField"], "without it Foxglove uses its own colours"


def test_all_panels_of_the_layout_are_placed_once() -> None:
    made = json.loads(layout("uuv1", load_scenario("paper_field")._replace(sensors=select_sensors(**SENSORS))))
    placed = re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(made))
    assert sorted(placed) == sorted(made["configById"])

"""MAVLink messages as JSON in the form of mavlink2rest: round trips, and invalid input."""

import json
import math
import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.endpoints.json_messages import decode_message, encode_message, plain_fields

MESSAGES = (
    dialect.MAVLink_heartbeat_message(12, 3, 209, 19, 4, 3),
    dialect.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0),
    dialect.MAVLink_param_value_message(b"SYSID_THISMAV", 1.0, 4, 23, 7),
    dialect.MAVLink_statustext_message(6, b"Armed"),
    dialect.MAVLink_servo_output_raw_message(1234, 0, *range(1100, 1900, 50)),
    dialect.MAVLink_file_transfer_protocol_message(0, 255, 190, list(range(251))),
)


@pytest.mark.parametrize("message", MESSAGES, ids=[message.get_type() for message in MESSAGES])
def test_a_message_survives_a_round_trip(message: dialect.MAVLink_message) -> None:
    sender = dialect.MAVLink(None, 9, 7)
    sender.seq = 5
    packet = message.pack(sender)
    assert decode_message(encode_message((9, 7, 5), plain_fields(message), message)) == packet


def test_non_finite_numbers_are_null() -> None:
    message = dialect.MAVLink_attitude_message(1, math.nan, math.inf, 0.5, 0.0, 0.0, 0.0)
    fields = plain_fields(message)
    assert (fields["roll"], fields["pitch"], fields["yaw"]) == (None, None, 0.5)


def test_texts_may_be_lists_of_characters() -> None:
    name = [*"SYSID_THISMAV", "\0", "\0", "\0"]
    text = json.dumps(
        {
            "header": {"system_id": 255, "component_id": 190},
            "message": {"type": "PARAM_REQUEST_READ", "target_system": 1, "param_id": name, "param_index": -1},
        }
    )
    packet = decode_message(text.encode())
    assert packet is not None
    requested = dialect.MAVLink(None).decode(bytearray(packet))
    assert (requested.param_id, requested.param_index, requested.target_component) == ("SYSID_THISMAV", -1, 0)


def test_invalid_input_gives_no_packet_and_no_exception() -> None:
    valid = encode_message((1, 1, 0), plain_fields(MESSAGES[0]), MESSAGES[0])
    for bad in (b"", b"[]", b"null", b"{}", b"[" * 100_000, b'{"header":{},"message":{"type":"HEARTBEAT"}}'):
        assert decode_message(bad) is None
    numbers = random.Random(1)
    for _ in range(5000):
        cut = bytearray(valid)
        for _ in range(numbers.randrange(1, 4)):
            cut[numbers.randrange(len(cut))] = numbers.randrange(256)
        packet = decode_message(bytes(cut))
        assert packet is None or packet[0] == 0xFD

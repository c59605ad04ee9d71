"""ArduPilot's JSON interface byte by byte: servo packets in, states out, and what a parser like ArduPilot's reads."""

import json
from math import nan
from random import Random

import pytest

from hil.autopilots.json_packets import ServoPacket, decode_servos, encode_state
from tests.support.autopilots.ardupilot_peer import MAGICS, encode_servos
from tests.support.autopilots.captured import needs_captures, rows

AT_REST = 1.5, (0.1, -0.2, 0.3), (0.0, 0.0, -9.80665), (1.0, 2.0, 3.0), (0.0, 0.0, 0.1), (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("channels", MAGICS)
def test_servo_packets_are_decoded(channels: int) -> None:
    pulses = tuple(range(1100, 1100 + channels))
    packet = encode_servos(ServoPacket(400, 70_000, pulses))
    assert decode_servos(packet) == ServoPacket(400, 70_000, pulses)
    assert decode_servos(packet[:-1]) is None
    assert decode_servos(b"\0" + packet[1:]) is None


def scan(text: str, section: str, key: str) -> str:
    """Return what ArduPilot's parser finds: the section anywhere, the key anywhere behind it, the value two characters
    on.
    """
    start = text.index(section) + len(section) + 1
    start = text.index(key, start)
    return text[start + len(key) + 2 :]


def test_a_state_is_read_by_a_parser_like_ardupilots() -> None:
    text = encode_state(*AT_REST, ranges=(4.25,), battery=(16.1, 2.5)).decode()
    assert text[0] == text[-1] == "\n"
    assert " " not in text
    assert json.loads(text)["imu"]["gyro"] == [0.1, -0.2, 0.3]
    expected = {
        ("", "timestamp"): "1.5", ("imu", "gyro"): "[0.1", ("imu", "accel_body"): "[0.0", ("", "position"): "[1.0",
        ("", "velocity"): "[0.0", ("", "quaternion"): "[1.0", ("", "rng_1"): "4.25",
        ("battery", "voltage"): "16.1", ("battery", "current"): "2.5",
    }  # fmt: skip
    for (section, key), value in expected.items():
        assert scan(text, section, key).startswith(value), key
    assert "attitude" not in text  # a quaternion is sent, and the parser would find this name inside others


def test_sensors_that_are_not_fitted_are_omitted() -> None:
    assert set(json.loads(encode_state(*AT_REST))) == {"timestamp", "imu", "position", "velocity", "quaternion"}


def test_a_range_without_an_echo_is_no_number() -> None:
    """ArduPilot keeps the last value of a name that is left out, and reads this with atof as no data."""
    assert scan(encode_state(*AT_REST, ranges=(nan,)).decode(), "", "rng_1").startswith("NaN")


def test_damaged_packets_never_raise() -> None:
    random = Random(1)
    sound = bytearray(encode_servos(ServoPacket(400, 9, (1500,) * 16)))
    for _ in range(20_000):
        damaged = bytearray(sound)
        for _ in range(random.randrange(1, 4)):
            damaged[random.randrange(len(damaged))] = random.randrange(256)
        found = decode_servos(bytes(damaged[: random.choice((len(damaged), random.randrange(len(damaged))))]))
        assert found is None or len(found.pwm_us) == 16


@needs_captures
@pytest.mark.parametrize("frame", ["vectored", "vectored_6dof"])
def test_recorded_packets_are_decoded(frame: str) -> None:
    """Every servo packet of a recorded flight decodes, and every recorded reply has our field names."""
    packets = [decode_servos(row.data) for row in rows(f"ardusub_{frame}_physics") if row.direction == "ap>sim"]
    assert len(packets) > 8000
    assert all(packets)
    first = packets[0]
    assert first == ServoPacket(1200, 0, (1500,) * 8 + (1000,) * 8)
    pulses = {packet.pwm_us[0] for packet in packets if packet}
    assert 0 in pulses  # no output while it boots
    assert {1400, 1600} <= pulses
    names = [set(json.loads(row.data)) for row in rows(f"ardusub_{frame}_physics") if row.direction == "sim>ap"]
    assert all(found <= set(json.loads(encode_state(*AT_REST))) for found in names)

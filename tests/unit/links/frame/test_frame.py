"""The binary frame: golden bytes, round trips, and noise on the line."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common.errors import ConfigError
from hil.common.schema import find_preset
from hil.links.contract import Counters, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.frame.protocol import FrameProtocol, open_frame
from tests.support.links.link_contract import command

GOLDEN: dict[str, Any] = json.loads((Path(__file__).parents[3] / "vectors" / "uuv_hil_frames.json").read_text())
SYNC = b"\xa5\x5a"


def uuv_hil() -> FrameProtocol:
    return FrameProtocol(find_preset("firmware_stub/frames", "uuv_hil"))


u16 = st.integers(0, 65535)
pulses = st.lists(u16, min_size=1, max_size=16).map(tuple)
commands = st.builds(ThrusterCommand, u16, st.booleans(), pulses)
reports = st.builds(
    ThrusterTelemetry, u16, st.booleans(), st.booleans(), pulses, st.integers(0, 2**32 - 1), u16, u16, u16
)
messages = st.one_of(commands, reports)
# Noise made for the frame: it contains beginnings of frames far more often than random bytes do.
noise = st.lists(
    st.one_of(st.binary(max_size=20), st.sampled_from([SYNC, SYNC[:1], SYNC + b"\x10\x01", SYNC + b"\xff\x07"])),
    max_size=8,
).map(b"".join)


def message_of(vector: dict[str, Any]) -> Message:
    fields = {**vector["fields"], "pwm_us": tuple(vector["fields"]["pwm_us"])}
    return ThrusterCommand(**fields) if vector["message"] == "command" else ThrusterTelemetry(**fields)


def crc_bit_by_bit(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE from its definition."""
    register = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            out = register >> 15 ^ byte >> bit & 1
            register = register << 1 & 0xFFFF ^ (0x1021 if out else 0)
    return register


def counts(counters: Counters) -> dict[str, int]:
    return {name: getattr(counters, name) for name in ("checksum_errors", "malformed", "dropped_bytes")}


@pytest.mark.parametrize("vector", GOLDEN["sound"], ids=lambda vector: vector["name"])
def test_frames_have_the_golden_bytes(vector: dict[str, Any]) -> None:
    protocol, data = uuv_hil(), bytes.fromhex(vector["hex"])
    assert protocol.encode(message_of(vector)).hex(" ") == vector["hex"]
    assert protocol.feed(data) == [message_of(vector)]
    assert not any(counts(protocol.counters).values())
    assert crc_bit_by_bit(data[2:-2]) == int(vector["crc"], 16) == int.from_bytes(data[-2:], "little")


@pytest.mark.parametrize("vector", GOLDEN["refused"], ids=lambda vector: vector["name"])
def test_invalid_bytes_are_refused_and_counted(vector: dict[str, Any]) -> None:
    protocol = uuv_hil()
    assert protocol.feed(bytes.fromhex(vector["hex"])) == []
    assert getattr(protocol.counters, vector["counter"]) == 1
    assert protocol.counters.checksum_errors + protocol.counters.malformed == 1
    assert protocol.feed(protocol.encode(command(1))) == [command(1)]


@given(messages)
def test_any_message_survives_a_round_trip(message: Message) -> None:
    sender, receiver = uuv_hil(), uuv_hil()
    data = sender.encode(message)
    assert receiver.feed(data) == [message]
    assert int.from_bytes(data[-2:], "little") == crc_bit_by_bit(data[2:-2])


def test_numbers_too_large_for_their_field_wrap_or_saturate() -> None:
    """Counters wrap; pulse widths and ages stop at the limit."""
    protocol = uuv_hil()
    report = ThrusterTelemetry(65536, True, True, (-5, 70_000), 2**32 + 9, 65_537, -1, 2**20 + 3)
    (received,) = protocol.feed(protocol.encode(report))
    assert received == ThrusterTelemetry(0, True, True, (0, 65535), 2**32 - 1, 1, 65535, 3)


@pytest.mark.parametrize("channels", [0, 17])
def test_a_number_of_channels_out_of_range_is_refused(channels: int) -> None:
    with pytest.raises(ValueError, match=f"not {channels}"):
        uuv_hil().encode(ThrusterCommand(0, True, (1500,) * channels))


def test_a_frame_is_opened_for_a_number_of_thrusters_that_it_carries() -> None:
    for channels in (1, 16):
        assert channels in open_frame("host", channels).channels
    with pytest.raises(ConfigError, match="1 to 16 thrusters, not 17"):
        open_frame("host", 17)


def test_a_truncated_frame_loses_only_itself() -> None:
    protocol = uuv_hil()
    data = protocol.encode(command(1))
    for size in range(1, len(data)):
        assert protocol.feed(data[:size]) == []
        assert protocol.feed(data) == [command(1)]
    # From the fourth byte on the beginning gives the length, so the frame is recognised as damaged and not as noise.
    wanted = {"checksum_errors": len(data) - 3, "malformed": 0, "dropped_bytes": sum(range(1, len(data)))}
    assert counts(protocol.counters) == wanted


def test_the_frame_after_a_duplicated_or_lost_byte_is_decoded() -> None:
    protocol = uuv_hil()
    data = protocol.encode(command(1))
    for index in range(len(data)):
        lost, doubled = data[:index] + data[index + 1 :], data[: index + 1] + data[index:]
        assert protocol.feed(lost + data) == [command(1)], index
        assert command(1) in protocol.feed(doubled + data), index


def test_a_frame_that_lies_inside_a_damaged_one_is_found() -> None:
    protocol = uuv_hil()
    inner = protocol.encode(command(5, 1))
    outer = SYNC + bytes([len(inner), 0x09]) + inner + b"\0\0"
    assert protocol.feed(outer) == [command(5, 1)]
    assert protocol.counters.checksum_errors == 1
    assert protocol.counters.dropped_bytes == 6


def test_two_protocol_objects_share_no_state() -> None:
    one, other = uuv_hil(), uuv_hil()
    one.feed(SYNC)
    assert other.feed(b"\x10\x01") == []
    assert one.counters is not other.counters
    assert (one.counters.dropped_bytes, other.counters.dropped_bytes) == (0, 2)

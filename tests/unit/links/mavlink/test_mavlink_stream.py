"""MAVLink packets in a stream: found in noise, checked, signed. No input raises or fills memory."""

import struct
from functools import partial
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import Counters, ThrusterCommand
from hil.links.mavlink.stream import TIMESTAMP_NS, TIMESTAMP_START_NS, MavlinkStream, signing_secret
from tests.support.calls import count_calls
from tests.support.links.mavlink_peer import KEY, Board, Clock, Peer, device_end, host_end

LONGEST = 280  # bytes of a packet
EVERY_BYTE = bytes(range(256))
MINUTE_NS = 60 * 10**9
NOW_NS = 1_800_000_000 * 10**9
NOW = (NOW_NS - TIMESTAMP_START_NS) // TIMESTAMP_NS  # as a signature has it


def stream() -> tuple[MavlinkStream, Counters]:
    counters = Counters()
    return MavlinkStream(1, 1, counters), counters


def packets(count: int = 8) -> list[bytes]:
    """Return different messages of one sender."""
    peer = Peer(1, 191)
    return [peer.servos([1500 + i] * 16) if i % 2 else peer.long(400, float(i)) for i in range(count)]


def numbers(messages: list[Any]) -> list[int]:
    return [message.get_seq() for message in messages]


@given(st.data())
def test_the_result_does_not_depend_on_how_reads_are_split(data: st.DataObject) -> None:
    joined = EVERY_BYTE.join(packets())
    cuts = sorted(data.draw(st.lists(st.integers(0, len(joined)), max_size=12)))
    parser, counters = stream()
    received = []
    for start, end in zip([0, *cuts], [*cuts, len(joined)], strict=True):
        received += parser.unpack(joined[start:end])
    assert numbers(received) == list(range(8))
    assert (counters.dropped_bytes, counters.checksum_errors, counters.malformed) == (7 * 256, 0, 0)


@pytest.mark.parametrize("noise", [EVERY_BYTE, EVERY_BYTE[::-1], b"\xfd", b"\xfd" * 300, b"\xfd\xff\x00", b"\0" * 40])
def test_a_packet_after_noise_is_decoded_with_its_last_byte(noise: bytes) -> None:
    (packet,) = packets(1)
    parser, counters = stream()
    assert parser.unpack(noise + packet[:-1]) == []
    assert len(parser.unpack(packet[-1:])) == 1
    assert counters.dropped_bytes == len(noise)


def test_a_truncated_packet_does_not_delay_the_next() -> None:
    """pymavlink's own parser waits for the rest of the first and swallows the second."""
    first, second = packets(2)
    for cut in range(1, len(first)):
        parser, counters = stream()
        assert numbers(parser.unpack(first[:cut] + second)) == [1]
        assert counters.dropped_bytes == cut
    swallowed = Peer().parse(first[:-1] + second)
    assert [message.get_type() for message in swallowed if message.get_type() != "BAD_DATA"] == []


def test_a_false_length_delays_no_packet() -> None:
    header = b"\xfd\xff\x01\x00\x00\x01\xbf" + (36).to_bytes(3, "little")  # 255 bytes and a signature to come
    parser, counters = stream()
    assert parser.unpack(header) == []
    assert numbers(parser.unpack(b"".join(packets(3)))) == [0, 1, 2]
    assert counters.dropped_bytes == len(header)


def test_a_damaged_packet_is_counted_and_the_next_one_received() -> None:
    joined = b"".join(packets(3))
    second = len(packets(1)[0])
    for position in range(second + 10, second + 20):
        parser, counters = stream()
        damaged = bytearray(joined)
        damaged[position] ^= 0x10
        assert numbers(parser.unpack(bytes(damaged))) == [0, 2]
        assert (counters.checksum_errors, counters.dropped_bytes) == (1, len(packets(2)[1]))


def test_unknown_messages_and_mavlink_1_count_as_noise() -> None:
    unknown = b"\xfd\x04\x00\x00\x00\x01\xbf" + (16_000_000).to_bytes(3, "little") + b"abcdef"
    old = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(dialect.MAVLink(None, 1, 1), force_mavlink1=True)
    parser, counters = stream()
    assert len(parser.unpack(unknown + packets(1)[0] + old + packets(1)[0])) == 2
    assert counters.dropped_bytes == len(unknown) + len(old)
    assert (counters.checksum_errors, counters.malformed) == (0, 0)


def test_a_longer_message_of_a_later_version_is_decoded() -> None:
    """Fields added at the end are ignored, as MAVLink specifies."""
    packet = bytearray(Peer(1, 191).servos([1500] * 16))
    body = packet[:-2] + b"later"
    body[1] += 5
    crc = dialect.x25crc(bytes(body[1:]) + bytes([222])).crc
    parser, counters = stream()
    (message,) = parser.unpack(bytes(body) + struct.pack("<H", crc))
    assert message.pulses == (1500,) * 16
    assert counters.dropped_bytes == 0


@given(st.binary(max_size=600), st.binary(max_size=600))
def test_noise_never_raises_and_every_byte_is_counted(first: bytes, second: bytes) -> None:
    parser, counters = stream()
    parser.unpack(first)
    parser.unpack(second)
    kept = len(parser._incomplete)
    assert kept < LONGEST
    assert counters.dropped_bytes + kept == len(first) + len(second)


def test_the_cost_of_the_worst_noise_is_linear_in_its_length() -> None:
    """A read full of headers that all promise 255 bytes is the worst: 4096 bytes are 44 ms of a line at 921600 baud."""
    header = b"\xfd\xff\x00\x00\x00\x01\xbf" + (36).to_bytes(3, "little")
    calls = {}
    for headers in (205, 410):
        parser, _ = stream()
        calls[headers] = count_calls(partial(parser.unpack, header * headers))
    assert calls[410] < 20 * 410, "a header costs a few calls"
    assert calls[410] < 2.5 * calls[205]


# signatures


def signed_peer(secret: bytes = KEY, timestamp: int = NOW, system: int = 1, component: int = 191) -> Peer:
    """Return a peer that signs as plain pymavlink does."""
    peer = Peer(system, component)
    peer.mavlink.signing.secret_key = secret
    peer.mavlink.signing.timestamp = timestamp
    peer.mavlink.signing.sign_outgoing = True
    return peer


def signed_board() -> Board:
    return Board(signing_key=KEY.hex(), wall_clock=Clock(NOW_NS))


def test_signed_ends_work_with_each_other_and_with_pymavlink() -> None:
    board, host = signed_board(), host_end(signing_key=KEY.hex(), wall_clock=Clock(NOW_NS))
    for i in range(20):
        output = board.take(host.encode(ThrusterCommand(i, True, (1500 + i,) * 4)))
        assert len(host.feed(output)) >= 1
    assert board.pwm_us == [1519] * 4
    assert board.end.counters.malformed == host.counters.malformed == 0
    peer = signed_peer(component=192)
    messages = peer.parse(board.take(peer.servos([1700] * 4)))
    assert [message.get_type() for message in messages] == ["SERVO_OUTPUT_RAW"]
    assert messages[0].get_signed()
    assert messages[0].servo1_raw == 1700


def test_unsigned_and_wrongly_signed_are_refused_and_counted() -> None:
    board = signed_board()
    others = [Peer(1, 191), signed_peer(b"x" * 32), signed_peer(signing_secret("other"))]
    for i, other_sender in enumerate(others, 1):
        assert board.take(other_sender.arm()) == b"", "not even a reply"
        assert board.end.counters.malformed == i
    tampered = bytearray(signed_peer().arm())
    tampered[-1] ^= 1
    assert board.take(bytes(tampered)) == b""
    assert board.end.counters.malformed == 4
    assert not board.stm32.armed
    board.take(signed_peer().arm())
    assert board.stm32.armed


def test_radio_status_is_never_signed() -> None:
    board = signed_board()
    for peer in (Peer(51, 68), signed_peer(b"x" * 32)):
        board.take(peer.pack(dialect.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7)))
    assert board.end.counters.malformed == board.end.counters.dropped_bytes == 0


def test_a_replayed_packet_is_refused() -> None:
    board, peer = signed_board(), signed_peer()
    packet = peer.arm()
    board.take(packet)
    for _ in range(3):
        assert board.take(packet) == b""
    assert board.end.counters.malformed == 3


@pytest.mark.parametrize(("behind_ns", "received"), [(MINUTE_NS - 10**9, True), (MINUTE_NS + TIMESTAMP_NS, False)])
def test_a_new_sender_may_be_a_minute_behind(behind_ns: int, received: bool) -> None:
    board = signed_board()
    board.take(signed_peer(timestamp=NOW - behind_ns // TIMESTAMP_NS).arm())
    assert board.stm32.armed is received


def test_the_minute_for_new_senders_is_counted_from_the_current_time() -> None:
    wall = Clock(NOW_NS)
    device = device_end(signing_key=KEY.hex(), wall_clock=wall)
    wall.now += 2 * MINUTE_NS
    assert device.feed(signed_peer().arm()) == []
    assert device.feed(signed_peer(timestamp=NOW + MINUTE_NS // TIMESTAMP_NS).arm()) != []


def test_our_timestamps_increase_with_every_packet() -> None:
    wall = Clock(NOW_NS)
    host = host_end(signing_key=KEY.hex(), wall_clock=wall)
    received: list[int] = []
    for step_ns in (0, 0, 10**9, -(10**15), 0, 5 * 10**9, TIMESTAMP_NS):
        wall.now += step_ns
        packet = host.tick(0)
        received.append(int.from_bytes(packet[-12:-6], "little"))
    assert received[0] == NOW
    assert received == sorted(set(received))
    assert received[2] == NOW + 100_000
    ahead = signed_peer(timestamp=NOW + 10**7, component=1)
    host.feed(ahead.pack(dialect.MAVLink_heartbeat_message(12, 0, 0, 0, 3, 3)))
    assert int.from_bytes(host.tick(0)[-12:-6], "little") >= NOW + 10**7, "ours follow the newest received"


def test_our_check_is_not_blocked_by_a_forged_timestamp() -> None:
    board, signer = signed_board(), signed_peer()
    board.take(signer.arm())
    for attempt in (2**47, 2**48 - 1):
        assert board.take(signed_peer(b"x" * 32, timestamp=attempt).arm(False)) == b""
    board.take(signer.servos([1600] * 4))
    assert board.pwm_us == [1600] * 4
    restarted = signed_board()
    restarted.take(signed_peer(b"x" * 32, timestamp=2**47).arm())
    restarted.take(signed_peer().arm())
    assert restarted.stm32.armed, "a sender not received before cannot be blocked either"


def test_a_key_is_digits_or_a_passphrase() -> None:
    assert signing_secret(KEY.hex()) == KEY
    assert signing_secret("correct horse").hex() == "4104d36f8da2c254349f85836793ebe029e0c957063a34c91c2e9203187b5631"
    assert len(signing_secret("z" * 64)) == 32

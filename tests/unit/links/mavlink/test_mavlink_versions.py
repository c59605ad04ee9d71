"""MAVLink 1 beside MAVLink 2, links of signed packets, and the readings of motor controllers."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import Counters
from hil.links.mavlink import end
from hil.links.mavlink.reports import encode_esc_telemetry
from hil.links.mavlink.settings import EscReading
from hil.links.mavlink.stream import MavlinkStream, Stamps
from tests.support.links.mavlink_peer import KEY, Clock, Peer, device_end, host_end

BEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
SERVOS = dialect.MAVLink_servo_output_raw_message(7, 0, *range(1500, 1516))
READING = EscReading(-2 * math.pi, 12.345, 1.239, 40.6, 36.0)
NOISE = (b"", b"\xfe", b"\xfd\xfe", b"\xfe\x09\x00\x01\x01\xfa", b"\xfd" * 9, bytes(range(256)))


def old(message: Any, number: int = 0) -> bytes:
    packer = dialect.MAVLink(None, 9, 8)
    packer.seq = number
    packet: bytes = message.pack(packer, force_mavlink1=True)
    return packet


def stream() -> tuple[MavlinkStream, Counters]:
    counters = Counters()
    return MavlinkStream(1, 2, counters, takes_version_1=True), counters


@pytest.mark.parametrize("noise", NOISE)
@pytest.mark.parametrize("step", [1, 5, 999])
def test_packets_of_both_versions_are_found_in_noise(noise: bytes, step: int) -> None:
    parser, counters = stream()
    new = Peer(9, 8)
    parts = [old(BEAT, 1), old(SERVOS, 2), new.pack(BEAT), old(BEAT, 3), new.pack(SERVOS)]
    joined = b"".join(noise + part for part in parts)
    received = [m for start in range(0, len(joined), step) for m in parser.unpack(joined[start : start + step])]
    assert [(m.get_msgId(), m.get_srcSystem(), m.get_srcComponent()) for m in received] == [
        (number, 9, 8) for number in (0, 36, 0, 0, 36)
    ]
    assert [m.get_seq() for m in received] == [1, 2, 0, 3, 1]
    assert counters.dropped_bytes == 5 * len(noise)
    assert received[1].servo8_raw == 1507
    assert received[4].pulses == tuple(range(1500, 1516))


def test_an_old_packet_of_an_unknown_message_or_with_a_damaged_byte_is_dropped() -> None:
    parser, counters = stream()
    unknown = bytes((0xFE, 0, 0, 9, 8, 3, 0, 0))
    assert (parser.unpack(unknown[:6]), counters.dropped_bytes, parser.unpack(unknown[6:])) == ([], 6, [])
    assert (counters.dropped_bytes, counters.checksum_errors) == (8, 0)
    damaged = bytearray(old(BEAT))
    damaged[7] ^= 1
    assert parser.unpack(bytes(damaged)) == []
    assert (counters.dropped_bytes, counters.checksum_errors) == (8 + len(damaged), 1)
    assert (parser.unpack(b"\xfd\x00\x02"), counters.dropped_bytes) == ([], 8 + len(damaged) + 3), "unknown flags"


def test_a_partner_is_answered_in_the_version_that_it_speaks() -> None:
    parser, _ = stream()
    (newer,) = encode_esc_telemetry([READING], 0)
    newest_old = dialect.MAVLink_setup_signing_message(1, 1, bytes(32), 0)  # number 256
    versions = []
    for packet in (Peer().pack(BEAT), old(BEAT), Peer().pack(BEAT)):
        (_,) = parser.unpack(packet)
        versions.append((parser.is_version_1, parser.pack(BEAT)[:1], parser.pack(newer)[:1]))
        assert parser.is_version_1 == (parser.pack(newest_old) == b"")
    assert versions == [(False, b"\xfd", b"\xfd"), (True, b"\xfe", b""), (False, b"\xfd", b"\xfd")]
    assert parser.pack(BEAT)[4] == 7, "what was not packed has no number"


def test_packets_are_numbered_and_the_number_wraps() -> None:
    parser, _ = stream()
    numbers = []
    for count in range(300):
        servos = count % 2
        packet = parser.pack_servos(1, 0, [1500] * 16) if servos else parser.pack(BEAT)
        numbers.append(packet[4])
    assert numbers == [count % 256 for count in range(300)]


def test_a_signed_packet_has_its_link_and_is_accepted_once_by_all_links_of_a_key() -> None:
    stamps, clock = Stamps(), Clock(1_800_000_000 * 10**9)
    links = [stream()[0] for _ in range(2)]
    for number, one in enumerate(links):
        one.sign(KEY, clock, stamps, 0x105 + number)
    packets = [links[0].pack(BEAT), links[1].pack(BEAT), links[1].pack_servos(1, 0, [1500] * 16)]
    assert [packet[-13] for packet in packets] == [5, 6, 6]
    first, second = stream()[0], stream()[0]
    for one in (first, second):
        one.sign(KEY, clock, stamps)
    assert len(first.unpack(packets[0])) == 1
    assert second.unpack(packets[0]) == [], "the other one has had it"
    assert len(second.unpack(packets[1])) == 1, "another link of the same sender"
    own = stream()[0]
    own.sign(KEY, clock)
    assert len(own.unpack(packets[0])) == 1
    assert own.unpack(old(BEAT)) == [], "an old one has no signature"
    own.sign(b"", clock)
    assert len(own.unpack(old(BEAT) + Peer().pack(BEAT))) == 2
    assert own.pack(BEAT)[2] == 0


@pytest.mark.parametrize("count", range(1, 17))
def test_readings_of_motor_controllers_are_in_groups_of_four(count: int) -> None:
    messages = encode_esc_telemetry([READING._replace(voltage=float(i)) for i in range(count)], 65_536 + 9)
    assert [m.get_type() for m in messages] == [
        f"ESC_TELEMETRY_{first}_TO_{first + 3}" for first in range(1, count + 1, 4)
    ]
    assert [volts for m in messages for volts in m.voltage][:count] == [100 * i for i in range(count)]
    last, filled = messages[-1], (count - 1) % 4 + 1
    for field, value in (("temperature", 41), ("current", 124), ("totalcurrent", 10), ("rpm", 60), ("count", 9)):
        assert getattr(last, field) == [value] * filled + [0] * (4 - filled), field


@pytest.mark.parametrize(("value", "rpm", "celsius"), [(math.nan, 0, 0), (1e9, 65_535, 255), (-1e9, 65_535, 0)])
def test_readings_stay_within_their_fields(value: float, rpm: int, celsius: int) -> None:
    (message,) = encode_esc_telemetry([EscReading(value, value, value, value, value)], 0)
    assert (message.rpm[0], message.temperature[0]) == (rpm, celsius)


def test_an_end_ignores_its_own_echo_and_answers_to_others() -> None:
    for one, beat in ((host_end(clock=Clock(5)), 0), (device_end(clock=Clock(5)), 1)):
        ids = (1, 191) if beat == 0 else (1, 1)
        asks = dialect.MAVLink_timesync_message
        one.feed(Peer(*ids).pack(asks(0, 3)) + Peer(1, 7).pack(asks(4, 3)))
        assert one.replies() == b""
        one.feed(Peer(1, 7).pack(asks(0, 3)))
        assert len(one.replies()) > 0
        assert one.replies() == b""


def test_a_heartbeat_is_due_by_its_schedule_or_a_second_after_a_pause() -> None:
    assert [end.next_due(100, 10, now) for now in (100, 109, 110, 111)] == [110, 110, 120, 121]
    device = device_end(clock=Clock((2**32 + 3) * 1000))
    (servos,) = Peer().parse(device.servo_output_raw([1500]))
    assert servos.time_usec == 3

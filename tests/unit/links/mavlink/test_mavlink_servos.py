"""Our SERVO_OUTPUT_RAW against pymavlink's, both ways."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.links.contract import Counters
from hil.links.mavlink import servos
from hil.links.mavlink.stream import MavlinkStream, signing_secret
from tests.support.links.mavlink_peer import Peer

BYTES = st.integers(0, 0xFF)
STAMPS = st.integers(0, 0xFFFF_FFFF)
# MAVLink truncates zeros at the end, so some of these end in zeros.
PULSES = st.lists(st.one_of(st.just(0), st.integers(0, 0xFFFF)), min_size=16, max_size=16)


def with_pymavlink(stamp: int, port: int, pulses: list[int], number: int, system: int, component: int) -> bytes:
    peer = Peer(system, component)
    peer.mavlink.seq = number
    return peer.pack(dialect.MAVLink_servo_output_raw_message(stamp, port, *pulses))


def fields(message: Any) -> tuple[Any, ...]:
    """Return the fields of a message of pymavlink."""
    pulses = tuple(getattr(message, f"servo{i}_raw") for i in range(1, 17))
    sender = message.get_srcSystem(), message.get_srcComponent()
    return message.time_usec, pulses, message.port, message.get_seq(), *sender


@given(STAMPS, BYTES, PULSES, BYTES, BYTES, BYTES)
def test_the_packet_equals_pymavlinks_byte_for_byte(
    stamp: int, port: int, pulses: list[int], number: int, system: int, component: int
) -> None:
    what = stamp, port, pulses, number, system, component
    assert servos.encode(*what) == with_pymavlink(*what)


@given(STAMPS, BYTES, PULSES, BYTES, BYTES, BYTES)
def test_the_decoded_fields_equal_pymavlinks(
    stamp: int, port: int, pulses: list[int], number: int, system: int, component: int
) -> None:
    packet = with_pymavlink(stamp, port, pulses, number, system, component)
    read = servos.decode(packet)
    (message,) = Peer().parse(packet)
    assert tuple(read) == fields(message)
    assert read.get_msgId() == message.get_msgId()
    assert (read.get_seq(), read.get_srcSystem(), read.get_srcComponent()) == (number, system, component)


def test_signed_packets_are_decoded_and_forged_ones_refused() -> None:
    secret = signing_secret("secret")
    sender, receiver = (MavlinkStream(1, component, Counters()) for component in (191, 1))
    for end in (sender, receiver):
        end.sign(secret, lambda: 1_800_000_000 * 10**9)
    packet = sender.pack_servos(7, 0, [1500 + i for i in range(16)])
    forged = packet[:-1] + bytes([packet[-1] ^ 1])
    assert receiver.unpack(forged) == []
    (message,) = receiver.unpack(packet)
    assert message == servos.ServoOutputRaw(7, tuple(range(1500, 1516)), 0, 0, 1, 191)

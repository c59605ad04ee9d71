"""The reader of instruments' wires finds the messages of the usual protocols, by examples of their documents."""

from binascii import crc_hqx

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.bench.instruments.framing import split
from hil.links.frame.checksums import CRCS, crc_checksum

CRC_MODBUS = crc_checksum(CRCS["crc16-modbus"])

EXAMPLES = {
    b"wru,0,0.070,1.10,-40,-95*9c\r\n": "wru",  # Water Linked's documentation
    b"$GPGLL,4916.45,N,12311.12,W,225444,A*31\r\n": "$GPGLL",
    b"$VNRRG,01*72\r\n": "$VNRRG",  # a request of VectorNav
    b'{"type":"velocity","vx":1.0}\r\n': "velocity",
    bytes.fromhex("4252 0200 0600 0000 0500 a100"): "ping 6",  # ping-protocol: general_request of message 5
    bytes.fromhex("b562 0a04 0000 0e34"): "UBX 0a 04",  # a poll of MON-VER
    b"HTTP/1.1 404 Not Found\r\nContent-Length: 2\r\n\r\n{}": "HTTP 404",
    bytes.fromhex("0183 02c0 f1"): "MODBUS refusal",  # the usual example of an illegal address
    bytes.fromhex("fa03 0401 0203 04"): "",  # begins as two protocols do, and is none
}


@pytest.mark.parametrize(("message", "kind"), [(data, kind) for data, kind in EXAMPLES.items() if kind])
def test_a_message_is_found_in_noise_and_its_checksum_counts(message: bytes, kind: str) -> None:
    [frame] = list(split(message))
    assert (frame.kind, frame.size) == (kind, len(message))
    assert frame.ok is not False
    found = [each for each in split(b"\x00\xff\x80" + message * 2) if each.ok is not False]
    assert [each.kind for each in found] == [kind] * 2
    if message[:1] not in b"{H":
        damaged = message[:4] + bytes((message[4] ^ 1,)) + message[5:]
        assert all(each.ok is False for each in split(damaged) if each.kind != "stray")


def test_a_message_of_250_is_told_from_an_output_of_a_vectornav_by_its_checksum() -> None:
    refusal = bytes((250, 0x83, 2))
    refusal += CRC_MODBUS.of(refusal).to_bytes(2, "little")
    output = bytes.fromhex("03 0100 0100") + bytes(16)  # groups 1 and 2 with a time each
    output = b"\xfa" + output + crc_hqx(output, 0).to_bytes(2, "big")
    found = [(each.kind, each.ok) for each in split(refusal + output + refusal)]
    assert found == [("MODBUS refusal", True), ("binary 03", True), ("MODBUS refusal", True)]


@given(st.binary(max_size=300), st.sampled_from(list(EXAMPLES)))
def test_any_bytes_end(noise: bytes, message: bytes) -> None:
    frames = list(split(noise + message))
    assert sum(frame.size for frame in frames) <= len(noise + message)

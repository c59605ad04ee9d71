"""Checksums: the catalogue's check values, and each compared with its definition bit by bit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.links.frame.checksums import CHECK_BYTES, CRCS, SUMS, Crc, crc_checksum
from tests.support.links.frame_peers import crc_bit_by_bit

# reveng.sourceforge.io/crc-catalogue: SMBUS, DVB-S2, MAXIM-DOW, SAE-J1850; ARC, IBM-3740, KERMIT, MCRF4XX, MODBUS,
# IBM-SDLC, XMODEM; ISO-HDLC, MPEG-2.
CHECK_VALUES = {
    "crc8": 0xF4, "crc8-dvb-s2": 0xBC, "crc8-maxim": 0xA1, "crc8-sae-j1850": 0x4B,
    "crc16-arc": 0xBB3D, "crc16-ccitt-false": 0x29B1, "crc16-kermit": 0x2189, "crc16-mcrf4xx": 0x6F91,
    "crc16-modbus": 0x4B37, "crc16-x25": 0x906E, "crc16-xmodem": 0x31C3,
    "crc32": 0xCBF43926, "crc32-mpeg2": 0x0376E6E7,
}  # fmt: skip
bytes_of = st.binary(max_size=64)


@pytest.mark.parametrize("name", CRCS)
def test_each_crc_has_its_check_value(name: str) -> None:
    assert crc_checksum(CRCS[name]).of(CHECK_BYTES) == CHECK_VALUES[name]


@given(st.sampled_from(sorted(CRCS)), bytes_of, bytes_of)
def test_a_crc_equals_its_definition_and_can_be_continued(name: str, first: bytes, second: bytes) -> None:
    crc = CRCS[name]
    checksum = crc_checksum(crc)
    wanted = crc_bit_by_bit(first + second, crc.width, crc.polynomial, crc.start_value, crc.reflected, crc.final_xor)
    assert checksum.of(first + second) == wanted == checksum.update(second, checksum.of(first))


@given(st.sampled_from([8, 16, 32]), st.data(), bytes_of)
def test_a_crc_of_any_parameters_equals_its_definition(width: int, data: st.DataObject, body: bytes) -> None:
    """Start values are drawn of those that read the same both ways, because the catalogue gives them unreflected."""
    polynomial, final_xor = (data.draw(st.integers(0, (1 << width) - 1)) for _ in range(2))
    start = data.draw(st.sampled_from([0, (1 << width) - 1]))
    crc = Crc(width, polynomial, start, data.draw(st.booleans()), final_xor)
    wanted = crc_bit_by_bit(body, width, polynomial, start, crc.reflected, final_xor)
    assert crc_checksum(crc).of(body) == wanted


@given(bytes_of)
def test_sums_equal_their_definitions(data: bytes) -> None:
    total, parity = sum(data), 0
    for byte in data:
        parity ^= byte
    assert SUMS["sum8"].of(data) == total % 256
    assert SUMS["sum16"].of(data) == total % 65536
    assert SUMS["xor8"].of(data) == parity
    assert SUMS["sum8-ones-complement"].of(data) == ~total & 0xFF
    assert (total + SUMS["sum8-twos-complement"].of(data)) % 256 == 0

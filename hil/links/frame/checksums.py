"""Checksums of serial frames: sums, exclusive or, and cyclic redundancy checks by their parameters.

Names, parameters and check values are those of the CRC catalogue (reveng.sourceforge.io/crc-catalogue); our default,
"crc16-ccitt-false", is CRC-16/IBM-3740 there. Checksums of the standard library, written in C, are used where they
exist; the others use a table of 256 entries, about 0.1 us a byte.
"""

from binascii import crc32, crc_hqx
from collections.abc import Callable
from typing import NamedTuple

CHECK_BYTES = b"123456789"


class Crc(NamedTuple):
    """The parameters of a cyclic redundancy check of `width` bits; `reflected` means lowest bit first."""

    width: int
    polynomial: int
    start_value: int
    reflected: bool
    final_xor: int


CRCS = {
    "crc8": Crc(8, 0x07, 0x00, False, 0x00),
    "crc8-dvb-s2": Crc(8, 0xD5, 0x00, False, 0x00),
    "crc8-maxim": Crc(8, 0x31, 0x00, True, 0x00),
    "crc8-sae-j1850": Crc(8, 0x1D, 0xFF, False, 0xFF),
    "crc16-arc": Crc(16, 0x8005, 0x0000, True, 0x0000),
    "crc16-ccitt-false": Crc(16, 0x1021, 0xFFFF, False, 0x0000),
    "crc16-kermit": Crc(16, 0x1021, 0x0000, True, 0x0000),
    "crc16-mcrf4xx": Crc(16, 0x1021, 0xFFFF, True, 0x0000),
    "crc16-modbus": Crc(16, 0x8005, 0xFFFF, True, 0x0000),
    "crc16-x25": Crc(16, 0x1021, 0xFFFF, True, 0xFFFF),
    "crc16-xmodem": Crc(16, 0x1021, 0x0000, False, 0x0000),
    "crc32": Crc(32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF),
    "crc32-mpeg2": Crc(32, 0x04C11DB7, 0xFFFFFFFF, False, 0x00000000),  # the CRC unit of an STM32, fed with bytes
}

# (data, checksum of the data before) -> checksum
Update = Callable[[bytes, int], int]


class Checksum(NamedTuple):
    """A checksum of `size` bytes. `empty` is the checksum of no data; `update` continues from one piece to the next."""

    size: int
    empty: int
    update: Update

    def of(self, data: bytes) -> int:
        """Return the checksum of `data`."""
        return self.update(data, self.empty)


def _xor(data: bytes, value: int) -> int:
    for byte in data:
        value ^= byte
    return value


SUMS = {
    "sum8": Checksum(1, 0, lambda data, value: value + sum(data) & 0xFF),
    "sum8-ones-complement": Checksum(1, 0xFF, lambda data, value: value - sum(data) & 0xFF),  # ~sum
    "sum8-twos-complement": Checksum(1, 0, lambda data, value: value - sum(data) & 0xFF),  # -sum
    "sum16": Checksum(2, 0, lambda data, value: value + sum(data) & 0xFFFF),
    "xor8": Checksum(1, 0, _xor),
}


def crc_checksum(crc: Crc) -> Checksum:
    """Return the checksum with these parameters, from the standard library if it has it."""
    size = crc.width // 8
    empty = crc.start_value ^ crc.final_xor
    if crc == CRCS["crc32"]:
        return Checksum(size, 0, crc32)
    if crc[:2] == (16, 0x1021) and not crc.reflected and not crc.final_xor:
        return Checksum(size, empty, crc_hqx)
    return Checksum(size, empty, (_reflected if crc.reflected else _straight)(crc))


def _reflected(crc: Crc) -> Update:
    """Return the update function of a reflected CRC: bytes enter at the low end, the polynomial is mirrored."""
    mirrored = int(f"{crc.polynomial:0{crc.width}b}"[::-1], 2)
    final_xor = crc.final_xor
    table = []
    for register in range(256):
        for _ in range(8):
            register = register >> 1 ^ (mirrored if register & 1 else 0)
        table.append(register)

    def update(data: bytes, value: int) -> int:
        value ^= final_xor
        for byte in data:
            value = value >> 8 ^ table[(value ^ byte) & 0xFF]
        return value ^ final_xor

    return update


def _straight(crc: Crc) -> Update:
    """Return the update function of a CRC whose bytes enter at the high end."""
    mask, shift, final_xor = (1 << crc.width) - 1, crc.width - 8, crc.final_xor
    table = []
    for byte in range(256):
        register = byte << shift
        for _ in range(8):
            register = (register << 1 ^ (crc.polynomial if register >> crc.width - 1 else 0)) & mask
        table.append(register)

    def update(data: bytes, value: int) -> int:
        value ^= final_xor
        for byte in data:
            value = (value << 8 & mask) ^ table[value >> shift ^ byte]
        return value ^ final_xor

    return update

"""Registers that are measured, and the fields of binary outputs, each as a list of formats and quantities.

Source: VectorNav VN-100 and VN-200 user manuals (UM001 v2.22, UM004 v2.23), chapters 4 and 6 to 8.
"""

from binascii import crc_hqx
from collections.abc import Sequence
from functools import reduce
from operator import xor
from struct import calcsize, pack
from typing import NamedTuple

from hil.instruments.vectornav.measurement import QUANTITIES, Measurement

_YPR, _MAG, _ACCEL, _RATE, _QUATERNION = (
    "+08.3f:ypr", "+08.4f:mag", "+07.3f:accel", "+010.6f:rate", "+09.6f:quaternion"
)  # fmt: skip
_WIDE_ACCEL, _VELOCITY = "+08.3f:accel", "+08.3f:vel_ned"
_GPS_TIME, _INS_TIME = "013.6f:tow_s 04d:week d:fix 02d:satellites", "013.6f:tow_s 04d:week 04X:ins_status"
_LLA, _ECEF = "+012.8f:lla", "+014.3f:ecef"
_INS_ERRORS = "04.1f:attitude_u 04.1f:largest_u 04.2f:speed_u"

# Number of a register -> what it returns. The first 100 exist in every unit but those with satellites.
MEASURED = {
    8: _YPR, 9: _QUATERNION, 15: f"{_QUATERNION} {_MAG} {_ACCEL} {_RATE}", 17: _MAG, 18: _ACCEL, 19: _RATE,
    20: f"{_MAG} {_ACCEL} {_RATE}", 27: f"{_YPR} {_MAG} {_ACCEL} {_RATE}",
    54: f"{_MAG} {_ACCEL} {_RATE} +05.1f:temperature +010.3f:pressure",
    58: f"{_GPS_TIME} {_LLA} {_VELOCITY} +08.3f:place_u +08.3f:speed_u .2E:time_u",
    59: f"{_GPS_TIME} {_ECEF} +08.3f:vel_ecef +08.3f:place_u +08.3f:speed_u .2E:time_u",
    63: f"{_INS_TIME} {_YPR} {_LLA} {_VELOCITY} {_INS_ERRORS}",
    64: f"{_INS_TIME} {_YPR} {_ECEF} +08.3f:vel_ecef {_INS_ERRORS}",
    72: f"{_YPR} {_LLA} {_VELOCITY} {_WIDE_ACCEL} +08.4f:rate", 73: f"{_YPR} {_ECEF} +08.3f:vel_ecef {_WIDE_ACCEL} "
    "+08.4f:rate", 80: "+09.6f:interval +08.3f:turned +08.3f:gained", 239: f"{_YPR} +07.3f:linear {_RATE}",
    240: f"{_YPR} +07.3f:linear_ned {_RATE}",
}  # fmt: skip
WITH_RECEIVER = {58, 59, 63, 64, 72, 73}
# Kind of asynchronous output -> its header and register.
ASYNCHRONOUS = {
    1: ("YPR", 8), 2: ("QTN", 9), 8: ("QMR", 15), 10: ("MAG", 17), 11: ("ACC", 18), 12: ("GYR", 19), 13: ("MAR", 20),
    14: ("YMR", 27), 16: ("YBA", 239), 17: ("YIA", 240), 19: ("IMU", 54), 20: ("GPS", 58), 21: ("GPE", 59),
    22: ("INS", 63), 23: ("INE", 64), 28: ("ISL", 72), 29: ("ISE", 73), 30: ("DTV", 80),
}  # fmt: skip

_RECEIVER = (
    "b5BH:utc Q:tow_ns H:week B:satellites B:fix 3d:lla 3d:ecef 3f:vel_ned 3f:vel_ecef 3f:place_u f:speed_u f:time_u "
    "Bb:time_info 7f:dilutions"
)
# Groups 1 to 7: common, time, inertial, first receiver, attitude, filter, second receiver; the fields in order of bits.
GROUPS = [
    [field.split("+") for field in group.split()]
    for group in (
        "Q:startup Q:gps_time Q:zero 3f:ypr 4f:quaternion 3f:rate 3d:lla 3f:vel_ned 3f:accel 3f:accel+3f:rate "
        "3f:mag+f:temperature+f:pressure f:interval+3f:turned+3f:gained H:ins_status I:zero Q:zero",
        "Q:startup Q:gps_time Q:tow_ns H:week Q:zero Q:zero b5BH:utc I:zero I:zero B:time_status",
        "H:zero 3f:mag 3f:accel 3f:rate f:temperature f:pressure f:interval+3f:turned 3f:gained 3f:mag 3f:accel "
        "3f:rate H:zero",
        _RECEIVER,
        "H:zero 3f:ypr 4f:quaternion 9f:cosines 3f:mag_ned 3f:accel_ned 3f:linear 3f:linear_ned 3f:ypr_u",
        "H:ins_status 3d:lla 3d:ecef 3f:vel_body 3f:vel_ned 3f:vel_ecef 3f:mag_ecef 3f:accel_ecef 3f:linear_ecef "
        "f:largest_u f:speed_u",
        _RECEIVER,
    )
]
_SECOND_RECEIVER = 6  # which no unit here has: its fields are zero


class BinaryOutput(NamedTuple):
    """A configured output: its ports and rate divisor, and the chosen bits of each chosen group, by its index."""

    ports: int
    divisor: int
    fields: tuple[tuple[int, int], ...]

    def encode(self, measurement: Measurement) -> bytes:
        """Return the message with its header and CRC."""
        header = bytes((sum(1 << group for group, _ in self.fields),))
        header += b"".join(pack("<H", bits) for _, bits in self.fields)
        payload = b""
        for group, bits in self.fields:
            for bit, parts in enumerate(GROUPS[group]):
                if bits >> bit & 1:
                    payload += b"".join(_packed(part, measurement, group) for part in parts)
        return b"\xfa" + header + payload + pack(">H", crc_hqx(header + payload, 0))


def _packed(part: str, measurement: Measurement, group: int) -> bytes:
    form, _, name = part.partition(":")
    if group == _SECOND_RECEIVER:
        return bytes(calcsize(f"<{form}"))
    return pack(f"<{form}", *QUANTITIES[name](measurement))


def parse_output(parameters: Sequence[str]) -> BinaryOutput | None:
    """Return the output of a register's parameters, such as 1,16,05,0001,000C; None if they are invalid."""
    try:
        ports, divisor = [int(text) for text in parameters[:2]]
        mask = int(parameters[2], 16) if len(parameters) > 2 else 0
        groups = [group for group in range(8) if mask >> group & 1]
        bits = [int(text, 16) for text in parameters[3:]]
    except ValueError:
        return None
    if len(bits) != len(groups) or mask > 0xFF or not 0 <= ports <= 3 or (ports and (divisor < 1 or not groups)):
        return None
    fields = tuple(zip(groups, bits, strict=True))
    is_known = all(group < len(GROUPS) and 0 <= b < 1 << len(GROUPS[group]) for group, b in fields)
    return BinaryOutput(ports, divisor, fields) if is_known else None


def text_of(register: int, measurement: Measurement) -> str:
    """Return a measured register's values, each with its comma before."""
    text = ""
    for part in MEASURED[register].split():
        form, _, name = part.partition(":")
        text += "".join(f",{value:{form}}" for value in QUANTITIES[name](measurement))
    return text


def line(body: str, with_crc: bool = False) -> bytes:
    """Return a line with its checksum: the exclusive or of the characters, or CRC-16 (CCITT from 0)."""
    data = body.encode("latin-1")
    return b"$%b*%b\r\n" % (data, checksum(data, with_crc))


def checksum(data: bytes, with_crc: bool = False) -> bytes:
    """Return the checksum in hexadecimal digits."""
    return b"%04X" % crc_hqx(data, 0) if with_crc else b"%02X" % reduce(xor, data, 0)

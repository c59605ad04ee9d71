"""Registers that are measured, and the fields of binary outputs, each as a list of formats and quantities.

Source: VectorNav VN-100 and VN-200 user manuals (UM001 v2.22, UM004 v2.23), chapters 4 and 6 to 8.
"""

from binascii import crc_hqx
from functools import lru_cache
from struct import pack
from typing import NamedTuple

from hil.instruments.layout import pack_layout
from hil.instruments.vectornav.measurement import QUANTITIES, Measurement
from hil.links.frame.checksums import SUMS

_YPR, _MAG, _ACCEL, _RATE, _QUATERNION = (
    "+08.3f:ypr", "+08.4f:mag", "+07.3f:accel", "+010.6f:rate", "+09.6f:quaternion"
)  # fmt: skip
_WIDE_ACCEL, _WIDE_RATE = "+08.3f:accel", "+08.4f:rate"
_GPS_TIME, _INS_TIME = "013.6f:tow_s 04d:week d:fix 02d:satellites", "013.6f:tow_s 04d:week 04X:ins_status"
_LLA, _ECEF = "+012.8f:lla +08.3f:vel_ned", "+014.3f:ecef +08.3f:vel_ecef"
_GPS_ERRORS, _INS_ERRORS = "+08.3f:place_u +08.3f:speed_u .2E:time_u", "04.1f:attitude_u 04.1f:largest_u 04.2f:speed_u"

# Number of a register -> what it returns. Some exist in units with satellites only.
MEASURED = {
    8: _YPR,
    9: _QUATERNION,
    15: f"{_QUATERNION} {_MAG} {_ACCEL} {_RATE}",
    17: _MAG,
    18: _ACCEL,
    19: _RATE,
    20: f"{_MAG} {_ACCEL} {_RATE}",
    27: f"{_YPR} {_MAG} {_ACCEL} {_RATE}",
    54: f"{_MAG} {_ACCEL} {_RATE} +05.1f:temperature +010.3f:pressure",
    58: f"{_GPS_TIME} {_LLA} {_GPS_ERRORS}",
    59: f"{_GPS_TIME} {_ECEF} {_GPS_ERRORS}",
    63: f"{_INS_TIME} {_YPR} {_LLA} {_INS_ERRORS}",
    64: f"{_INS_TIME} {_YPR} {_ECEF} {_INS_ERRORS}",
    72: f"{_YPR} {_LLA} {_WIDE_ACCEL} {_WIDE_RATE}",
    73: f"{_YPR} {_ECEF} {_WIDE_ACCEL} {_WIDE_RATE}",
    80: "+09.6f:interval +08.3f:turned +08.3f:gained",
    239: f"{_YPR} +07.3f:linear {_RATE}",
    240: f"{_YPR} +07.3f:linear_ned {_RATE}",
}
WITH_RECEIVER = {58, 59, 63, 64, 72, 73}
# Kind of asynchronous output -> its header and register.
ASYNCHRONOUS = {
    1: ("YPR", 8), 2: ("QTN", 9), 8: ("QMR", 15), 10: ("MAG", 17), 11: ("ACC", 18), 12: ("GYR", 19), 13: ("MAR", 20),
    14: ("YMR", 27), 16: ("YBA", 239), 17: ("YIA", 240), 19: ("IMU", 54), 20: ("GPS", 58), 21: ("GPE", 59),
    22: ("INS", 63), 23: ("INE", 64), 28: ("ISL", 72), 29: ("ISE", 73), 30: ("DTV", 80),
}  # fmt: skip

_RECEIVER = (
    "b5BH:utc Q:tow_ns H:week B:satellites B:fix 3d:lla 3d:ecef 3f:vel_ned 3f:vel_ecef 3f:place_u f:speed_u f:time_u "
    "B:time_status+b:leap 7f:dilutions"
)
# Groups 1 to 7: common, time, inertial, first receiver, attitude, filter, second receiver; the fields in order of bits.
GROUPS = [
    group.split()
    for group in (
        "Q:startup Q:gps_time Q:0 3f:ypr 4f:quaternion 3f:rate 3d:lla 3f:vel_ned 3f:accel 3f:accel+3f:rate "
        "3f:mag+f:temperature+f:pressure f:interval+3f:turned+3f:gained H:ins_status I:0 Q:0",
        "Q:startup Q:gps_time Q:tow_ns H:week Q:0 Q:0 b5BH:utc I:0 I:0 B:time_status",
        "H:0 3f:mag 3f:accel 3f:rate f:temperature f:pressure f:interval+3f:turned 3f:gained 3f:mag 3f:accel 3f:rate "
        "H:0",
        _RECEIVER,
        "H:0 3f:ypr 4f:quaternion 9f:cosines 3f:mag_ned 3f:accel_ned 3f:linear 3f:linear_ned 3f:ypr_u",
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
        data = bytes((sum(1 << group for group, _ in self.fields),))
        data += b"".join(pack("<H", bits) for _, bits in self.fields)
        for group, bits in self.fields:
            chosen = " ".join(field for bit, field in enumerate(GROUPS[group]) if bits >> bit & 1)
            payload = pack_layout(chosen.replace("+", " "), QUANTITIES, measurement)
            data += bytes(len(payload)) if group == _SECOND_RECEIVER else payload
        return b"\xfa" + data + pack(">H", crc_hqx(data, 0))


@lru_cache(64)
def parse_output(text: str) -> BinaryOutput | None:
    """Return the output of a register's text, such as 1,16,05,0001,000C; None if it is invalid."""
    parameters = text.split(",")
    try:
        ports, divisor = [int(word) for word in parameters[:2]]
        mask = int(parameters[2], 16) if len(parameters) > 2 else 0
        bits = [int(word, 16) for word in parameters[3:]]
    except ValueError:
        return None
    groups = [group for group in range(8) if mask >> group & 1]
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
    """Return a line with its checksum."""
    data = body.encode("latin-1")
    return b"$%b*%b\r\n" % (data, checksum(data, with_crc))


def checksum(data: bytes, with_crc: bool = False) -> bytes:
    """Return the exclusive or of the bytes, or their CRC-16 (CCITT from 0), in hexadecimal digits."""
    return b"%04X" % crc_hqx(data, 0) if with_crc else b"%02X" % SUMS["xor8"].of(data)

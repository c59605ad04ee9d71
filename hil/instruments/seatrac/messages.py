"""Lines and records of SeaTrac's serial protocol: little endian bytes as hexadecimal digits, with CRC-16.

Facts: Blueprint Subsea, SeaTrac Developer Guide, as public drivers read it. They leave something open: here the
time of a range is one way, and an elevation is positive above the beacon's plane.
"""

from enum import IntEnum
from math import asin, atan2, degrees, hypot, log10
from struct import Struct, pack
from typing import NamedTuple

from hil.common.vectors import Quaternion, Vector3
from hil.links.frame.checksums import CRCS, crc_checksum
from sim.rotations import rotate, rotate_inverse, to_euler

_CRC = crc_checksum(CRCS["crc16-arc"])
_RANGE, _USBL, _POSITION, _ENHANCED = 1, 2, 4, 8  # flags of a fix
_SOURCE_LEVEL = 176.0  # dB re 1 uPa at 1 m (X150, data sheet)
_COUNTER = 16_000.0  # Hz


class Cid(IntEnum):
    """Commands, and what a beacon reports."""

    SYS_ALIVE = 0x01
    SYS_INFO = 0x02
    SYS_REBOOT = 0x03
    STATUS = 0x10
    STATUS_CFG_GET = 0x11
    STATUS_CFG_SET = 0x12
    SETTINGS_GET = 0x15
    SETTINGS_SET = 0x16
    SETTINGS_LOAD = 0x17
    SETTINGS_SAVE = 0x18
    SETTINGS_RESET = 0x19
    XCVR_FIX = 0x39
    XCVR_STATUS = 0x3A
    PING_SEND = 0x40
    ECHO_SEND = 0x48
    NAV_QUERY_SEND = 0x50
    DAT_SEND = 0x60
    DAT_QUEUE_SET = 0x64
    DAT_QUEUE_CLR = 0x65
    DAT_QUEUE_STATUS = 0x66


class Cst(IntEnum):
    """Results of commands, and states of the transceiver."""

    OK = 0x00
    PARAM_MISSING = 0x04
    PARAM_INVALID = 0x05
    BUSY = 0x30
    TIMEOUT = 0x34
    IDLE = 0x3B
    REQUESTING = 0x3D


# Kinds of acoustic messages; a response has the number of its request plus 1.
ONE_WAY, ONE_WAY_USBL, REQUEST, REQUEST_USBL, REQUEST_DEPTH = 0, 1, 2, 4, 6
_WITH_ANGLES = (ONE_WAY_USBL, REQUEST_USBL + 1, REQUEST_DEPTH + 1)
SUPPLY_MV = 12_000


def encode_line(payload: bytes) -> bytes:
    """Return a beacon's line."""
    return b"$" + (payload + pack("<H", _CRC.of(payload))).hex().upper().encode() + b"\r\n"


def decode_line(line: bytes) -> bytes:
    """Return the bytes of a client's line, b"" of a malformed one."""
    try:
        data = bytes.fromhex(line[1:].decode("ascii"))
    except ValueError:
        return b""
    is_sound = line[:1] == b"#" and data[-2:] == pack("<H", _CRC.of(data[:-2]))
    return data[:-2] if is_sound else b""


class Settings(NamedTuple):
    """The record of settings, in its order on the wire. Angles in 0.1 degrees, speeds of sound in 0.1 m/s.

    `calibration` is that of the beacon's compass, which is kept but not simulated; `network` is reserved.
    """

    status_mode: int = 1
    status_output: int = 3
    baud: int = 0x0D
    network: bytes = pack("<BQ4IH", 0x0D, 0, 0xC0A801FA, 0xFFFF0000, 0xC0A80101, 0xC0A80101, 8100)
    environment: int = 3
    pressure_offset: int = 0
    salinity: int = 350
    sound_speed: int = 15_000
    compass_flags: int = 1
    calibration: bytes = pack("<6hB8f3h", *[-270] * 3, *[270] * 3, 1, 0, 0, 0, 1, 1, 1, 50.0, 0.0, 0, 0, 0)
    compass_offsets: bytes = bytes(6)
    flags: int = 3
    beacon: int = 1
    range_limit: int = 1000
    turnaround: int = 10
    yaw: int = 0
    pitch: int = 0
    roll: int = 0
    filter: bytes = bytes((3, 10, 60))

    def is_valid(self) -> bool:
        """True if all values are within the documented limits."""
        limits = (1, self.beacon, 15), (100, self.range_limit, 3000), (10, self.turnaround, 1000)
        modes = (0, self.status_mode, 5), (1000, self.sound_speed, 20_000), (0, self.salinity, 1000)
        return all(low <= value <= high for low, value, high in (*limits, *modes)) and not self.status_output & ~0x0F


SETTINGS = Struct("<3B27sBhHHB51s6sBB2HHhh3s")
AUTO_SOUND_SPEED, USE_ATTITUDE, REPORT_FIXES = 1, 1, 0x40  # bits of `environment` and of `flags`


class Place(NamedTuple):
    """Where a beacon is: position (NED, m), attitude, and the speed of sound (m/s) that it computes with."""

    position: Vector3
    attitude: Quaternion
    sound_speed: float

    @property
    def depth(self) -> float:
        """Depth in m."""
        return self.position[2]


def deci(value: float) -> int:
    """Return a value in tenths, within 16 bits."""
    return max(-32_768, min(32_767, round(10.0 * value)))


def attitude(of: Quaternion) -> bytes:
    """Return yaw, pitch and roll."""
    roll, pitch, yaw = to_euler(of)
    return pack("<3h", round(10.0 * degrees(yaw) % 3600.0), deci(degrees(pitch)), deci(degrees(roll)))


def encode_fix(
    ids: tuple[int, int], kind: int, here: Place, relative: Vector3, turnaround: float, assumed: Quaternion | None,
    remote_depth: float,
) -> bytes:  # fmt: skip
    """Return the record of an acoustic fix (ACOFIX).

    `ids` are receiver and sender; `relative` (NED, m) is the measured way to the sender, `turnaround` (s) the other's.
    A receiver with a USBL head computes the position with the `assumed` attitude, and of an enhanced response takes the
    `remote_depth` (m) that that carries; one without has None.
    """
    has_range, has_usbl = bool(kind & 1) and kind != ONE_WAY_USBL, assumed is not None and kind in _WITH_ANGLES
    has_position = has_range and has_usbl
    is_enhanced = has_position and kind == REQUEST_DEPTH + 1
    distance = hypot(*relative)
    flags = _RANGE * has_range | _USBL * has_usbl | _POSITION * has_position | _ENHANCED * is_enhanced
    strength = deci(_SOURCE_LEVEL - 20.0 * log10(max(1.0, distance)))
    data = pack("<4B", *ids, flags, kind) + attitude(here.attitude)
    data += pack("<HHh", max(0, deci(here.depth)), round(10.0 * here.sound_speed), strength)
    if has_range:
        seconds = distance / here.sound_speed
        counts = round((2.0 * seconds + turnaround) * _COUNTER)
        data += pack("<IiH", counts, round(1e7 * seconds), min(65_535, round(10.0 * distance)))
    x, y, z = rotate_inverse(here.attitude, relative)
    if has_usbl:
        azimuth = round(10.0 * degrees(atan2(y, x)) % 3600.0)
        elevation = deci(degrees(asin(max(-1.0, min(1.0, -z / distance)))) if distance else 0.0)
        data += pack("<B4hhh2x", 4, *[strength] * 4, azimuth, elevation)
    if has_position and assumed:
        north, east, down = rotate(assumed, (x, y, z))
        data += pack("<3h", deci(east), deci(north), deci(remote_depth if is_enhanced else here.depth + down))
    return data

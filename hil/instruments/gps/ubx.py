"""Frames and messages of u-blox's binary protocol, UBX.

Little endian; times of week in ms, places in 1e-7 degrees and mm, speeds in mm/s.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from math import hypot, sqrt
from struct import pack
from typing import Any

from hil.instruments.contract import Frames
from hil.instruments.gps.configuration import DEVICE, by_message
from hil.instruments.gps.sky import LEAP_SECONDS, SPEED_ACCURACY, Epoch
from hil.instruments.layout import pack_layout

_SYNC = b"\xb5\x62"
_SENTENCE, _CORRECTIONS = b"$\xd3"  # with which these begin
_MOST, _LONGEST = 1024, 256  # bytes of a payload that a receiver takes, and of a sentence
_UNKNOWN = 0xFFFFFFFF
NAV, ACK, CFG, MON, PUBX = 0x01, 0x05, 0x06, 0x0A, 0xF1
VERSION = 0x04  # of MON
_SATELLITES = (NAV, 0x35)
# of a satellite: quality, used, healthy, orbit by ephemeris; almanac too
_SATELLITE_FLAGS = 7 | 1 << 3 | 1 << 4 | 1 << 8 | 3 << 11


def frame(group: int, number: int, payload: bytes = b"") -> bytes:
    """Return a message with its header and the 8-bit Fletcher checksum."""
    body = pack("<BBH", group, number, len(payload)) + payload
    first = second = 0
    for byte in body:
        first = first + byte & 0xFF
        second = second + first & 0xFF
    return _SYNC + body + bytes((first, second))


class Reader(Frames):
    """Takes messages out of a stream in which sentences of NMEA and corrections (RTCM 3) may stand too."""

    begin = re.compile(rb"\xb5(\x62|\Z)|\xd3([\0-\3]|\Z)|[$]")

    def read(self, data: bytes, now_ns: int = 0) -> Iterator[tuple[int, int, bytes]]:
        """Yield class, number and payload of each complete message; of a PUBX sentence its number and its fields."""
        for piece in super().read(data):
            if piece[:2] == _SYNC:
                yield piece[2], piece[3], piece[6:-2]
            elif piece[:6] == b"$PUBX," and piece[6:8].isdigit():
                yield PUBX, int(piece[6:8]), piece[9:].partition(b"*")[0]

    def size_at(self, buffer: bytes, start: int) -> int:
        """Return the size of a message, of a sentence, or of corrections; 0 for one that is too long."""
        mark, rest = buffer[start], buffer[start : start + _LONGEST]
        if mark == _SENTENCE:
            return rest.find(b"\n") + 1 or (_LONGEST if len(rest) < _LONGEST else 0)
        size = 6 + int.from_bytes(rest[1:3], "big") if mark == _CORRECTIONS else 8 + int.from_bytes(rest[4:6], "little")
        return size if size <= 8 + _MOST else 0

    def is_sound(self, buffer: bytes, start: int, size: int) -> bool:
        """Return whether the checksum of a message is right; others are only read over."""
        piece = buffer[start : start + size]
        return piece[:2] != _SYNC or frame(piece[2], piece[3], piece[6:-2]) == piece


def _mm(metres: float) -> int:
    return max(-(1 << 31), min((1 << 31) - 1, round(metres * 1e3)))


def _place(epoch: Epoch) -> tuple[int, ...]:
    """Return longitude, latitude, heights above ellipsoid and sea, and accuracies."""
    fix = epoch.fix
    if not fix.fix:
        return 0, 0, 0, 0, _UNKNOWN, _UNKNOWN
    level, vertical = [min(_UNKNOWN, round(1e3 * sqrt(max(0.0, value)))) for value in fix.variances]
    heights = _mm(fix.altitude), _mm(fix.altitude - epoch.separation)
    return round(fix.longitude * 1e7), round(fix.latitude * 1e7), *heights, round(level * sqrt(2.0)), vertical


QUANTITIES: dict[str, Callable[[Epoch], Sequence[Any]]] = {
    "itow": lambda e: [e.week_and_ms[1]],
    "week": lambda e: [e.week_and_ms[0]],
    "date": lambda e: e.time.timetuple()[:6],
    "nano": lambda e: [e.time_ns % 1_000_000_000],
    "sub_ms": lambda e: [e.time_ns % 1_000_000],
    "time_valid": lambda e: [7 if e.fix.fix else 3],  # date and time, fully resolved
    "time_accuracy": lambda e: [50 if e.fix.fix else 1_000_000],  # ns; the clock goes on by a crystal
    "leap": lambda _: [LEAP_SECONDS],
    "fix_type": lambda e: [3 * e.fix.fix],
    "fix_ok": lambda e: [e.fix.fix],
    "fix_status": lambda e: [0x0C | e.fix.fix],
    "no_fix": lambda e: [not e.fix.fix],
    "used": lambda e: [len(e.satellites)],
    "place": _place,
    "velocity": lambda e: [_mm(value) for value in e.velocity],
    "velocity_cm": lambda e: [round(100.0 * value) for value in e.velocity],
    "speed": lambda e: [_mm(e.speed)],
    "speeds_cm": lambda e: [round(100.0 * hypot(*e.velocity)), round(100.0 * e.speed)],
    "course": lambda e: [round(e.course * 1e5)],
    "speed_accuracy": lambda _: [_mm(SPEED_ACCURACY)],
    "speed_accuracy_cm": lambda _: [round(100.0 * SPEED_ACCURACY)],
    # by the speed's error across it
    "course_accuracy": lambda e: [round(1e5 * min(180.0, 57.3 * SPEED_ACCURACY / e.speed)) if e.speed else 18_000_000],
    "pdop": lambda e: [round(e.dilutions.position * 100)],
    "dilutions": lambda e: [min(9999, round(value * 100)) for value in e.dilutions],
}
MESSAGES: dict[tuple[int, int], str] = by_message(DEVICE["messages"])


def encode(group: int, number: int, epoch: Epoch) -> bytes:
    """Return one of the messages; all satellites in it are used, and tracked by code and carrier."""
    payload = pack_layout(MESSAGES[group, number], QUANTITIES, epoch)
    for each in epoch.satellites if (group, number) == _SATELLITES else ():
        values = each.number, round(each.strength), round(each.elevation), round(each.azimuth)
        payload += pack("<x2Bbh2xI", *values, _SATELLITE_FLAGS)
    return frame(group, number, payload)


def version() -> bytes:
    """Return MON-VER of a NEO-M9N."""
    extensions = ("ROM BASE 0x118B2060", "FWVER=SPG 4.04", "PROTVER=32.01", "MOD=NEO-M9N", "GPS", "SBAS;QZSS")
    texts = [pack("30s", each.encode()) for each in extensions]
    return frame(MON, VERSION, pack("30s10s", b"EXT CORE 4.04 (7f89f7)", b"00190000") + b"".join(texts))

"""Frames and messages of u-blox's binary protocol, UBX.

Source: u-blox M9 SPG 4.04 interface description (UBX-21022436), chapter 3. Little endian; times of week in ms, places
in 1e-7 degrees and mm, speeds in mm/s.
"""

from collections.abc import Callable, Iterator
from math import hypot, sqrt
from struct import pack

from hil.instruments.gps.epoch import LEAP_SECONDS, SPEED_ACCURACY, Epoch

_SYNC = b"\xb5\x62"
_MOST = 1024  # bytes of a payload that a receiver takes
_UNKNOWN = 0xFFFFFFFF
_DATE_AND_TIME, _RESOLVED = 3, 4
_CONFIRMED = 0xE0  # flags2: date and time are confirmed
_TIME_ACCURACY_NS = 50

NAV, ACK, CFG, MON, PUBX = 0x01, 0x05, 0x06, 0x0A, 0xF1
VERSION = 0x04  # of MON


def frame(group: int, number: int, payload: bytes = b"") -> bytes:
    """Return a message with its header and the 8-bit Fletcher checksum."""
    body = pack("<BBH", group, number, len(payload)) + payload
    first = second = 0
    for byte in body:
        first = first + byte & 0xFF
        second = second + first & 0xFF
    return _SYNC + body + bytes((first, second))


def acknowledge(group: int, number: int, accepted: bool) -> bytes:
    """Return ACK-ACK or ACK-NAK to a configuration message."""
    return frame(ACK, int(accepted), bytes((group, number)))


class Reader:
    """Takes messages out of a stream in which sentences of NMEA and corrections (RTCM 3) may stand too."""

    def __init__(self) -> None:
        self._buffer = b""
        self.malformed = 0

    def read(self, data: bytes) -> Iterator[tuple[int, int, bytes]]:
        """Yield class, number and payload of each complete message; of a PUBX sentence its number and its fields."""
        self._buffer += data
        while len(self._buffer) >= 3:
            size = self._size()
            if size > len(self._buffer):
                return
            piece, self._buffer = self._buffer[:size], self._buffer[size:]
            if piece[:2] == _SYNC and size >= 8:
                if frame(piece[2], piece[3], piece[6:-2]) == piece:
                    yield piece[2], piece[3], piece[6:-2]
                else:
                    self.malformed += 1
            elif piece[:6] == b"$PUBX," and piece[6:8].isdigit():
                yield PUBX, int(piece[6:8]), piece[9:].partition(b"*")[0]

    def _size(self) -> int:
        """Return the size of what the buffer begins with: a message, a sentence, corrections, or bytes to skip."""
        buffer = self._buffer
        if buffer[:2] == _SYNC:
            if len(buffer) < 6:
                return 6
            size = int.from_bytes(buffer[4:6], "little")
            return 8 + size if size <= _MOST else self._skip()
        if buffer[0] == 0xD3 and buffer[1] < 4:
            return 6 + int.from_bytes(buffer[1:3], "big")
        if buffer[0] in b"$":
            end = buffer.find(b"\n", 0, 256)
            return end + 1 if end >= 0 else 256 if len(buffer) < 256 else self._skip()
        return self._skip()

    def _skip(self) -> int:
        """Return the number of bytes up to the next that may begin something."""
        self.malformed += 1
        starts = [at for at in (self._buffer.find(mark, 1) for mark in (_SYNC[:1], b"\xd3", b"$")) if at > 0]
        return min(starts, default=len(self._buffer))


def _mm(metres: float) -> int:
    return max(-(1 << 31), min((1 << 31) - 1, round(metres * 1e3)))


def _place(epoch: Epoch) -> bytes:
    """Return longitude, latitude, heights and accuracies, as NAV-PVT has them."""
    fix = epoch.fix
    if not fix.fix:
        return pack("<4i2I", 0, 0, 0, 0, _UNKNOWN, _UNKNOWN)
    level, vertical = [min(_UNKNOWN, round(1e3 * sqrt(max(0.0, value)))) for value in fix.variances]
    heights = _mm(fix.altitude), _mm(fix.altitude - epoch.separation)
    accuracies = round(level * sqrt(2.0)), vertical
    return pack("<4i2I", round(fix.longitude * 1e7), round(fix.latitude * 1e7), *heights, *accuracies)


def _itow(epoch: Epoch) -> bytes:
    return pack("<I", epoch.week_and_ms[1])


def _date(epoch: Epoch) -> bytes:
    time = epoch.time
    return pack("<H5B", time.year, time.month, time.day, time.hour, time.minute, time.second)


def _time_accuracy(epoch: Epoch) -> int:
    """Return the accuracy of the time (ns); without a fix it is that of the clock, which goes on by a crystal."""
    return _TIME_ACCURACY_NS if epoch.fix.fix else 1_000_000


def pvt(epoch: Epoch) -> bytes:
    """NAV-PVT: position, velocity and time."""
    has_fix = epoch.fix.fix
    valid = _DATE_AND_TIME | (_RESOLVED if has_fix else 0)
    nano = epoch.time_ns % 1_000_000_000
    head = pack("<BIi4B", valid, _time_accuracy(epoch), nano, 3 * has_fix, has_fix, _CONFIRMED, len(epoch.satellites))
    velocity = [_mm(each) for each in epoch.velocity] if has_fix else [0, 0, 0]
    motion = pack(
        "<4iiIIHH4xihH", *velocity, _mm(epoch.speed) if has_fix else 0, round(epoch.course * 1e5) if has_fix else 0,
        _mm(SPEED_ACCURACY), round(_course_accuracy(epoch) * 1e5), round(epoch.dilutions.position * 100),
        not has_fix, 0, 0, 0,
    )  # fmt: skip
    return _itow(epoch) + _date(epoch) + head + _place(epoch) + motion


def _course_accuracy(epoch: Epoch) -> float:
    """Return the accuracy of the course in degrees: by the speed's error across it."""
    return min(180.0, 57.3 * SPEED_ACCURACY / epoch.speed) if epoch.speed and epoch.fix.fix else 180.0


def posllh(epoch: Epoch) -> bytes:
    """NAV-POSLLH: longitude, latitude, heights."""
    return _itow(epoch) + _place(epoch)


def status(epoch: Epoch) -> bytes:
    """NAV-STATUS: kind of fix; times since power on are not kept."""
    has_fix = epoch.fix.fix
    return _itow(epoch) + pack("<4BII", 3 * has_fix, 0x0C | has_fix, 0, 0, 0, 0)


def velned(epoch: Epoch) -> bytes:
    """NAV-VELNED: velocity in cm/s."""
    values = [round(100.0 * value) for value in (*epoch.velocity, hypot(*epoch.velocity), epoch.speed)]
    accuracies = round(100.0 * SPEED_ACCURACY), round(_course_accuracy(epoch) * 1e5)
    return _itow(epoch) + pack("<3i2IiII", *values, round(epoch.course * 1e5), *accuracies)


def dop(epoch: Epoch) -> bytes:
    """NAV-DOP: dilutions of precision in hundredths."""
    return _itow(epoch) + pack("<7H", *[min(9999, round(value * 100)) for value in epoch.dilutions])


def timegps(epoch: Epoch) -> bytes:
    """NAV-TIMEGPS: GPS's time, with its distance from UTC."""
    rest_ns = epoch.time_ns % 1_000_000
    return _itow(epoch) + pack("<ihbBI", rest_ns, epoch.week_and_ms[0], LEAP_SECONDS, 7, _time_accuracy(epoch))


def sat(epoch: Epoch) -> bytes:
    """NAV-SAT: the satellites; all are healthy, used, and tracked by code and carrier."""
    flags = 7 | 1 << 3 | 1 << 4 | 1 << 8 | 3 << 11  # quality, used, healthy, orbit by ephemeris; almanac too
    blocks = [
        pack("<3BbhhI", 0, each.number, round(each.strength), round(each.elevation), round(each.azimuth), 0, flags)
        for each in epoch.satellites
    ]
    return _itow(epoch) + pack("<BB2x", 1, len(blocks)) + b"".join(blocks)


def end(epoch: Epoch) -> bytes:
    """NAV-EOE: end of the epoch."""
    return _itow(epoch)


def hardware(_: Epoch) -> bytes:
    """MON-HW: an antenna that is well, without jamming; pins are 0."""
    return bytes(16) + pack("<HHBB", 90, 4000, 2, 1) + bytes(23) + b"\x0a" + bytes(14)


def front_end(_: Epoch) -> bytes:
    """MON-HW2: gains and offsets of the two paths."""
    return pack("<bBbB", 0, 128, 0, 128) + bytes(24)


# Class and number of a message -> its payload; in the order in which they are sent.
MESSAGES: dict[tuple[int, int], Callable[[Epoch], bytes]] = {
    (NAV, 0x02): posllh, (NAV, 0x03): status, (NAV, 0x04): dop, (NAV, 0x07): pvt, (NAV, 0x12): velned,
    (NAV, 0x20): timegps, (NAV, 0x35): sat, (NAV, 0x61): end, (MON, 0x09): hardware, (MON, 0x0B): front_end,
}  # fmt: skip


def version() -> bytes:
    """Return MON-VER of a NEO-M9N."""
    extensions = ("ROM BASE 0x118B2060", "FWVER=SPG 4.04", "PROTVER=32.01", "MOD=NEO-M9N", "GPS", "SBAS;QZSS")
    texts = [pack("30s", each.encode()) for each in extensions]
    return frame(MON, VERSION, pack("30s10s", b"EXT CORE 4.04 (7f89f7)", b"00190000") + b"".join(texts))

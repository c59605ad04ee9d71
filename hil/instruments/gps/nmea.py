"""Sentences of NMEA 0183, version 4.11, with the fields and decimals of a u-blox M9.

Source: u-blox M9 SPG 4.04 interface description (UBX-21022436), chapter 2. Fields without a value are empty.
"""

from collections.abc import Callable
from functools import reduce
from math import sqrt
from operator import xor

from hil.instruments.gps.epoch import SPEED_ACCURACY, Epoch

_KNOT = 1852.0 / 3600.0  # m/s
_GPS, _L1 = "1", "1"  # system and signal
_A_SENTENCE = 4  # satellites in one GSV


def sentence(name: str, *fields: str) -> bytes:
    """Return a sentence with its checksum, the exclusive or of all characters between $ and *."""
    body = ",".join((name, *fields)).encode("ascii")
    return b"$%b*%02X\r\n" % (body, reduce(xor, body))


def _clock(epoch: Epoch) -> str:
    time = epoch.time
    return f"{time:%H%M%S}.{time.microsecond // 10_000:02d}"


def _angle(value: float, signs: str, width: int) -> tuple[str, str]:
    """Return degrees and minutes in one number, and the hemisphere."""
    degrees, rest = divmod(round(abs(value) * 60e5), 6_000_000)
    return f"{degrees:0{width}d}{rest / 1e5:08.5f}", signs[value < 0.0]


def _place(epoch: Epoch) -> tuple[str, str, str, str]:
    if not epoch.fix.fix:
        return "", "", "", ""
    return *_angle(epoch.fix.latitude, "NS", 2), *_angle(epoch.fix.longitude, "EW", 3)


def _course(epoch: Epoch) -> str:
    """Return the course; none while the receiver stands, as its noise would turn it."""
    return f"{epoch.course:.2f}" if epoch.fix.fix and epoch.speed > 2.0 * SPEED_ACCURACY else ""


def _mode(epoch: Epoch) -> str:
    return "A" if epoch.fix.fix else "N"


def gga(epoch: Epoch) -> bytes:
    """Fix: place, quality, satellites, altitude above the sea."""
    used = f"{len(epoch.satellites):02d}"
    height = ("", "M", "", "M")
    if epoch.fix.fix:
        height = (f"{epoch.fix.altitude - epoch.separation:.1f}", "M", f"{epoch.separation:.1f}", "M")
    dilution = f"{epoch.dilutions.horizontal:.2f}"
    return sentence("GNGGA", _clock(epoch), *_place(epoch), str(int(epoch.fix.fix)), used, dilution, *height, "", "")


def gll(epoch: Epoch) -> bytes:
    """Latitude and longitude."""
    return sentence("GNGLL", *_place(epoch), _clock(epoch), "A" if epoch.fix.fix else "V", _mode(epoch))


def gsa(epoch: Epoch) -> bytes:
    """Kind of fix, the satellites used, and dilutions."""
    used = [f"{each.number:02d}" for each in epoch.satellites[:12]]
    of = epoch.dilutions
    values = [f"{value:.2f}" for value in (of.position, of.horizontal, of.vertical)]
    return sentence("GNGSA", "A", "3" if epoch.fix.fix else "1", *used, *[""] * (12 - len(used)), *values, _GPS)


def gsv(epoch: Epoch) -> bytes:
    """Satellites in view, four a sentence."""
    view = epoch.satellites
    count = max(1, -(-len(view) // _A_SENTENCE))
    lines = b""
    for index in range(count):
        fields = []
        for each in view[index * _A_SENTENCE : (index + 1) * _A_SENTENCE]:
            azimuth = f"{round(each.azimuth) % 360:03d}"
            fields += [f"{each.number:02d}", f"{each.elevation:02.0f}", azimuth, f"{each.strength:02.0f}"]
        lines += sentence("GPGSV", str(count), str(index + 1), f"{len(view):02d}", *fields, _L1)
    return lines


def gst(epoch: Epoch) -> bytes:
    """Standard deviations of latitude, longitude and altitude in m."""
    level, vertical = [f"{sqrt(max(0.0, value)):.1f}" for value in epoch.fix.variances]
    errors = (level, level, vertical) if epoch.fix.fix else ("", "", "")
    return sentence("GNGST", _clock(epoch), "", "", "", "", *errors)


def rmc(epoch: Epoch) -> bytes:
    """The minimum: time, place, speed in knots, course, date."""
    speed = f"{epoch.speed / _KNOT:.3f}" if epoch.fix.fix else ""
    status = "A" if epoch.fix.fix else "V"
    date = f"{epoch.time:%d%m%y}"
    return sentence(
        "GNRMC", _clock(epoch), status, *_place(epoch), speed, _course(epoch), date, "", "", _mode(epoch), "V"
    )


def vtg(epoch: Epoch) -> bytes:
    """Course and speed over ground."""
    knots, kilometres = ("", "")
    if epoch.fix.fix:
        knots, kilometres = f"{epoch.speed / _KNOT:.3f}", f"{epoch.speed * 3.6:.3f}"
    return sentence("GNVTG", _course(epoch), "T", "", "M", knots, "N", kilometres, "K", _mode(epoch))


def zda(epoch: Epoch) -> bytes:
    """Time and date, UTC."""
    return sentence("GNZDA", _clock(epoch), f"{epoch.time:%d}", f"{epoch.time:%m}", f"{epoch.time:%Y}", "00", "00")


def greeting() -> bytes:
    """Return the line by which a receiver names itself after power on."""
    return sentence("GNTXT", "01", "01", "02", "u-blox AG - www.u-blox.com")


# The number of a sentence among UBX's messages of the class 0xF0 -> its writer.
SENTENCES: dict[int, Callable[[Epoch], bytes]] = {
    0x00: gga, 0x01: gll, 0x02: gsa, 0x03: gsv, 0x04: rmc, 0x05: vtg, 0x07: gst, 0x08: zda,
}  # fmt: skip

"""Sentences of NMEA 0183, version 4.11. Fields without a value are empty."""

from math import sqrt

from hil.instruments.gps.configuration import DEVICE
from hil.instruments.gps.sky import SPEED_ACCURACY, Epoch
from hil.instruments.layout import sentence

_KNOT = 1852.0 / 3600.0  # m/s
_IN_SENTENCE = 4  # satellites of one GSV
_GSV = 0x03
SENTENCES: dict[int, str] = {int(number, 16): text for number, text in DEVICE["sentences"].items()}
GREETING = "GNTXT,01,01,02,u-blox AG - www.u-blox.com"  # by which a receiver names itself after power on


def encode(number: int, epoch: Epoch) -> bytes:
    """Return one of the sentences, GSV with all that belong to it."""
    if number == _GSV:
        return _satellites_in_view(epoch)
    return sentence(SENTENCES[number].format_map(_fields(epoch)))


def _fields(epoch: Epoch) -> dict[str, str]:
    time, used = epoch.time, [f"{each.number:02d}" for each in epoch.satellites]
    fields = {
        "clock": f"{time:%H%M%S}.{time.microsecond // 10_000:02d}",
        "date": f"{time:%d%m%y}",
        "day": f"{time:%d,%m,%Y}",
        "used": f"{len(used):02d}",
        "numbers": ",".join((used + [""] * 12)[:12]),
        **{name: f"{value:.2f}" for name, value in epoch.dilutions._asdict().items()},
    }
    return fields | (_with_fix(epoch) if epoch.fix.fix else DEVICE["without_fix"])


def _with_fix(epoch: Epoch) -> dict[str, str]:
    fix, is_moving = epoch.fix, epoch.speed > 2.0 * SPEED_ACCURACY
    level, vertical = [f"{sqrt(max(0.0, value)):.1f}" for value in fix.variances]
    return {
        "place": f"{_angle(fix.latitude, 'NS', 2)},{_angle(fix.longitude, 'EW', 3)}",
        "heights": f"{fix.altitude - epoch.separation:.1f},M,{epoch.separation:.1f},M",
        "quality": "1",
        "kind": "3",
        "status": "A",
        "mode": "A",
        "knots": f"{epoch.speed / _KNOT:.3f}",
        "kilometres": f"{epoch.speed * 3.6:.3f}",
        "course": f"{epoch.course:.2f}" if is_moving else "",  # noise would turn that of one that stands
        "errors": f"{level},{level},{vertical}",
    }


def _angle(value: float, signs: str, width: int) -> str:
    """Return degrees and minutes in one number, and the hemisphere."""
    degrees, rest = divmod(round(abs(value) * 60e5), 6_000_000)
    return f"{degrees:0{width}d}{rest / 1e5:08.5f},{signs[value < 0.0]}"


def _satellites_in_view(epoch: Epoch) -> bytes:
    view = epoch.satellites
    count = max(1, -(-len(view) // _IN_SENTENCE))
    lines = b""
    for index in range(count):
        body = f"{SENTENCES[_GSV]},{count},{index + 1},{len(view):02d}"
        for each in view[index * _IN_SENTENCE : (index + 1) * _IN_SENTENCE]:
            azimuth = round(each.azimuth) % 360
            body += f",{each.number:02d},{each.elevation:02.0f},{azimuth:03d},{each.strength:02.0f}"
        lines += sentence(f"{body},1")  # the signal L1
    return lines

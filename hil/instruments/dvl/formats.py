"""What a DVL A50 or A125 sends: JSON over TCP, lines with a CRC-8 on serial, and Teledyne's PD4 and PD6 on either."""

import json
import time
from collections.abc import Callable
from struct import pack
from typing import Any

from hil.common.clock import NS_PER_S, NS_PER_US, to_wall_ns
from hil.instruments.dvl.report import DeadReckoning, DvlSettings, Report
from hil.links.frame.checksums import CRCS, SUMS, crc_checksum

JSON_VERSION = "json_v3.2"  # of software 2.7.1
_SYSTEM = 0b10100011  # of PD4: ship coordinates, tilts used, 600 kHz
_NO_VELOCITY = -32_768  # mm/s
_BEAM_OF = (2, 0, 3, 1)  # BM1 to BM4 -> transducer
_PD4_SIZE = 47
crc8 = crc_checksum(CRCS["crc8"]).of


def line(*words: object) -> bytes:
    """Return a line of these words with its checksum."""
    text = ",".join(map(str, words)).encode()
    return b"%b*%02x\r\n" % (text, crc8(text))


def word(value: float | bool | str) -> str:
    """Return an option as a word of a line."""
    return value if isinstance(value, str) else "ny"[value] if isinstance(value, bool) else f"{value:.2f}"


def json_line(kind: str, fields: dict[str, Any]) -> bytes:
    """Return an object of JSON with the version of the format, and its type."""
    message = {**fields, "format": JSON_VERSION, "type": kind}
    return json.dumps(message, separators=(",", ":")).encode() + b"\r\n"


def json_report(report: Report, config: DvlSettings, now_ns: int) -> bytes:
    """Return a ping's velocities and transducers."""
    vx, vy, vz = report.velocity
    fields = {
        "time": report.milliseconds, "vx": vx, "vy": vy, "vz": vz, "fom": report.fom,
        "covariance": report.covariance, "altitude": report.altitude,
        "transducers": [{"id": number, **one._asdict()} for number, one in enumerate(report.transducers)],
        "velocity_valid": report.is_valid, "status": 0,
        "time_of_validity": report.validity_us, "time_of_transmission": to_wall_ns(now_ns) // NS_PER_US,
    }  # fmt: skip
    return json_line("velocity_water" if report.is_water else "velocity", fields)


def json_position(reckoning: DeadReckoning, now_ns: int) -> bytes:
    """Return a dead reckoning report."""
    values = to_wall_ns(now_ns) / NS_PER_S, *reckoning.position, reckoning.std, *reckoning.angles, 0
    names = "ts", "x", "y", "z", "std", "roll", "pitch", "yaw", "status"
    return json_line("position_local", dict(zip(names, values, strict=True)))


def lines_report(report: Report, config: DvlSettings, now_ns: int) -> bytes:
    """Return the lines of a ping."""
    velocity = [f"{speed:.3f}" for speed in report.velocity]
    covariance = ";".join(f"{x:.6g}" for row in report.covariance for x in row)
    to_bottom = [] if report.is_water else [f"{report.altitude:.2f}"]
    times = report.validity_us, to_wall_ns(now_ns) // NS_PER_US, f"{report.milliseconds:.2f}", 0
    quality = *to_bottom, f"{report.fom:.3f}", covariance
    data = line("wrs" if report.is_water else "wrz", *velocity, word(report.is_valid), *quality, *times)
    for number, one in enumerate(report.transducers):
        data += line("wru", number, f"{one.velocity:.3f}", f"{one.distance:.2f}", f"{one.rssi:.0f}", f"{one.nsd:.0f}")
    return data


def all_lines_report(report: Report, config: DvlSettings, now_ns: int) -> bytes:
    """Return the lines of a ping, and those of the deprecated format."""
    data = lines_report(report, config, now_ns)
    if not report.is_water:
        velocity = [f"{speed:.3f}" for speed in report.velocity]
        fom, altitude, valid = f"{report.fom:.3f}", f"{report.altitude:.2f}", word(report.is_valid)
        data += line("wrx", f"{report.milliseconds:.2f}", *velocity, fom, altitude, valid, 0)
        data += line("wrt", *[f"{one.distance:.2f}" for one in report.transducers])
    return data


def line_position(reckoning: DeadReckoning, now_ns: int) -> bytes:
    """Return a dead reckoning report."""
    numbers = [f"{value:.2f}" for value in (*reckoning.position, reckoning.std)]
    angles = [f"{value:.1f}" for value in reckoning.angles]
    return line("wrp", f"{to_wall_ns(now_ns) / NS_PER_S:.3f}", *numbers, *angles, 0)


def encode_pd6(report: Report, config: DvlSettings, now_ns: int = 0) -> bytes:
    """Return the ten sentences of one ping: velocity in mm/s, altitude in m."""
    wall = time.gmtime(report.validity_us // 1_000_000)
    stamp = time.strftime("%y%m%d%H%M%S", wall) + f"{report.validity_us // 10_000 % 100:02d}"
    x, y, z = [millimetres(speed) for speed in report.velocity]
    status, altitude = "A" if report.is_valid else "V", max(0.0, report.altitude)
    still, far = f"{'+0':>6},{'+0':>6},{'+0':>6}", f"{'+0.00':>12},{'+0.00':>12},{'+0.00':>12}"
    sentences = (
        ":SA, +0.00, +0.00,  0.00",
        f":TS,{stamp}, 0.0, +0.0,   0.0,{config.speed_of_sound:6.1f},  0",
        f":WI,{still},{'+0':>6},V",
        f":WS,{still},V",
        f":WE,{still},V",
        f":WD,{far},   0.00,  0.00",
        f":BI,{x:+6d},{y:+6d},{z:+6d},{'+0':>6},{status}",
        f":BS,{y:+6d},{x:+6d},{z:+6d},{status}",
        f":BE,{still},V",
        f":BD,{far},{altitude:7.2f},  0.00",
    )
    return "".join(f"{sentence}\r\n" for sentence in sentences).encode()


def encode_pd4(report: Report, config: DvlSettings, now_ns: int = 0) -> bytes:
    """Return the structure of one ping: velocity in mm/s, ranges in cm; -32768 is no velocity."""
    wall, none = time.gmtime(report.validity_us // 1_000_000), [_NO_VELOCITY] * 4
    speeds = [*[millimetres(speed) for speed in report.velocity], 0] if report.is_valid else none
    ranges = [max(0, min(0xFFFF, round(100.0 * report.transducers[beam].distance))) for beam in _BEAM_OF]
    clock = wall.tm_hour, wall.tm_min, wall.tm_sec, report.validity_us // 10_000 % 100
    body = pack(
        "<BBHB4h4HB4h2HB4BHHh", 0x7D, 0, _PD4_SIZE - 2, _SYSTEM, *speeds, *ranges, int(not report.is_valid), *none,
        0, 0, 0, *clock, 0, round(config.speed_of_sound), 0,
    )  # fmt: skip
    return body + pack("<H", SUMS["sum16"].of(body))


def millimetres(speed: float) -> int:
    """Return a speed in mm/s within 16 bits, of which the least is none."""
    return max(-32_767, min(32_767, round(1000.0 * speed)))


# Name of a format -> what it makes of a ping and, if anything, of the dead reckoning.
Encode = Callable[[Report, DvlSettings, int], bytes]
FORMATS: dict[str, tuple[Encode, Callable[[DeadReckoning, int], bytes] | None]] = {
    "json": (json_report, json_position),
    "lines": (lines_report, line_position),
    "all lines": (all_lines_report, line_position),
    "pd4": (encode_pd4, None),
    "pd6": (encode_pd6, None),
}

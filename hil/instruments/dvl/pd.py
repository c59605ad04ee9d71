"""The DVL's output in Teledyne's formats PD4 (binary) and PD6 (lines), on TCP ports of their own or on serial."""

import time
from struct import pack

from hil.instruments.dvl.device import DvlWire
from hil.instruments.dvl.report import Config, Report
from hil.links.frame.checksums import SUMS

SYSTEM = 0b10100011  # ship coordinates, tilts used, 600 kHz
NO_VELOCITY = -32_768  # mm/s
BEAM_OF = (2, 0, 3, 1)  # BM1 to BM4 -> transducer
PD4_SIZE = 47


def encode_pd6(report: Report, config: Config) -> bytes:
    """Return the ten sentences of one ping: velocity in mm/s, altitude in m."""
    wall = time.gmtime(report.validity_us // 1_000_000)
    stamp = time.strftime("%y%m%d%H%M%S", wall) + f"{report.validity_us // 10_000 % 100:02d}"
    x, y, z = [_millimetres(speed) for speed in report.velocity]
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


def encode_pd4(report: Report, config: Config) -> bytes:
    """Return the structure of one ping: velocity in mm/s, ranges in cm; -32768 is no velocity."""
    wall = time.gmtime(report.validity_us // 1_000_000)
    speeds = [_millimetres(speed) for speed in report.velocity] if report.is_valid else [NO_VELOCITY] * 3
    ranges = [max(0, min(0xFFFF, round(100.0 * report.transducers[beam].distance))) for beam in BEAM_OF]
    body = pack(
        "<BBHB4h4HB4h2HB4BHHh",
        0x7D, 0, PD4_SIZE - 2, SYSTEM, *speeds, 0 if report.is_valid else NO_VELOCITY, *ranges,
        0 if report.is_valid else 1, *[NO_VELOCITY] * 4, 0, 0, 0,
        wall.tm_hour, wall.tm_min, wall.tm_sec, report.validity_us // 10_000 % 100,
        0, round(config.speed_of_sound), 0,
    )  # fmt: skip
    return body + pack("<H", SUMS["sum16"].of(body))


def _millimetres(speed: float) -> int:
    return max(-32_767, min(32_767, round(1000.0 * speed)))


class Pd6Wire(DvlWire):
    """A client of the PD6 port of a DVL."""

    def report(self, report: Report, now_ns: int) -> bytes:
        """Return a ping's sentences."""
        return encode_pd6(report, self._dvl.kept.config)


class Pd4Wire(DvlWire):
    """A client of the PD4 port of a DVL."""

    def report(self, report: Report, now_ns: int) -> bytes:
        """Return a ping's structure."""
        return encode_pd4(report, self._dvl.kept.config)

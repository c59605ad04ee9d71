"""Optical modems: high rate, short range, and only along a line of sight."""

from math import acos, cos, exp, log, pi, sqrt
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3


class OpticalModem(NamedTuple):
    """A lamp and a detector on the same axis.

    `bit_rate` is in bit/s; `half_angle` (rad) is the angle at which the lamp has half its intensity, `view` (rad) the
    half angle of the detector's field of view. `attenuation` (1/m) is the beam attenuation of the water: 0.15 clear
    ocean, 0.4 coast, 2.2 harbour are Petzold's stations AUTEC 8, HAOCE 11 and NUC 2040 (SIO Ref. 72-78, 1972, read in
    github.com/tishibashi-cpu/jerlov); 0.056 for pure sea water is commonly given, but was not read in a source.
    `reach` (m) is the distance in clear ocean water, with both aligned, at which half of the packets of 128 bytes
    arrive. Rates and angles are in the middle of what manufacturers offer.
    """

    bit_rate: Annotated[float, Range(1.0, 1e9, "bit/s")] = 1e6
    half_angle: Annotated[float, Range(0.01, 0.5 * pi, "rad")] = 0.6
    view: Annotated[float, Range(0.01, pi, "rad")] = 1.0
    attenuation: Annotated[float, Range(0.0, 20.0)] = 0.15
    reach: Annotated[float, Range(0.1, 500.0, "m")] = 20.0

    def airtime_ns(self, size: int) -> int:
        """Return the transmission time (ns) of a message of `size` bytes; the propagation time is neglected."""
        return round(8e9 * size / self.bit_rate)


_CLEAR = 0.15  # 1/m: attenuation of the water for which `reach` is given
_REFERENCE_BITS = 8 * 128


def bit_error(modem: OpticalModem, source: Vector3, ahead: Vector3, position: Vector3, axis: Vector3) -> float:
    """Return the bit error rate from `source` to `position` (NED, m); 0.5 without any light.

    The lamp points along `ahead`, the detector along `axis` (unit vectors, NED). The lamp is Lambertian, with Beer's
    law and the inverse square law (Kaushal & Kaddoum, IEEE Access 4, 2016). On-off keying in constant noise has the
    error rate ½ exp(-½ q²), q proportional to the light. Not modelled: scattering, sunlight, obstacles.
    """
    offset = tuple(b - a for a, b in zip(source, position, strict=True))
    distance = max(sqrt(sum(x * x for x in offset)), 1e-3)
    out = sum(a * b for a, b in zip(ahead, offset, strict=True)) / distance
    cos_incidence = -sum(a * b for a, b in zip(axis, offset, strict=True)) / distance
    if out <= 0.0 or cos_incidence <= 0.0 or acos(min(cos_incidence, 1.0)) > modem.view:
        return 0.5
    order = -log(2.0) / log(cos(modem.half_angle)) if modem.half_angle < 0.5 * pi else 1.0
    light = _light(distance, modem.attenuation) * out**order * cos_incidence
    q = _quality_at_reach() * light / _light(modem.reach, _CLEAR)
    return 0.5 * exp(-0.5 * min(q * q, 1400.0))


def packet_arrives(errors: float, size: int, draw: float) -> bool:
    """Return True if a message of `size` bytes has no error at this bit error rate; `draw` is uniform in [0, 1)."""
    return draw < float((1.0 - errors) ** (8 * size))


def quality(errors: float) -> float:
    """Return q, the amplitude ratio of signal to noise, of a bit error rate: the inverse of ½ exp(-½ q²)."""
    return sqrt(-2.0 * log(2.0 * max(errors, 1e-300))) if errors < 0.5 else 0.0


def _light(distance: float, attenuation: float) -> float:
    return exp(-attenuation * distance) / (distance * distance)


def _quality_at_reach() -> float:
    """Return the q at which half of the packets of 128 bytes arrive without error."""
    return quality(1.0 - 0.5 ** (1.0 / _REFERENCE_BITS))

"""What a unit knows at one instant, and its messages: measured registers as text, and binary outputs.

Their forms and quantities are in devices/vectornav.toml.
"""

from binascii import crc_hqx
from collections.abc import Callable, Sequence
from functools import lru_cache
from math import degrees, sqrt
from struct import pack
from typing import Any, NamedTuple

from hil.common.clock import NS_PER_S
from hil.common.vectors import Quaternion, Vector3
from hil.instruments.gps.sky import GPS_EPOCH, LEAP_SECONDS, SPEED_ACCURACY, Epoch, make_epoch
from hil.instruments.layout import pack_layout, read_device
from sim.geodesy import TangentPlane, earth_centred
from sim.rotations import matrix, rotate, rotate_inverse, to_euler
from sim.sensors.extra_samples import FixSample

DEVICE = read_device("vectornav")
MEASURED: dict[int, str] = {int(number): text for number, text in DEVICE["measured"].items()}
_GROUPS: list[list[str]] = [text.split() for text in DEVICE["groups"].values()]
_SECOND_RECEIVER = 6  # which no unit here has: its fields are zero
_GRAVITY = 9.80665  # m/s²
_UNKNOWN = 9999.0  # standard deviation (m, m/s) of what is not known
_WEEK_NS = 604_800 * NS_PER_S
NO_EPOCH = make_epoch(FixSample(0, 0.0, 0.0, 0.0, (0.0, 0.0), False), 0.0, (0.0, 0.0, 0.0))


class Measurement(NamedTuple):
    """One measurement. `startup_ns` since power on, `time_ns` since 1970; axes are FRD.

    `field` in gauss, `temperature` (°C) and `pressure` (kPa) in the housing; `interval` (s) is that since the last one.
    `epoch` is that of the unit's satellite receiver, if it has one; `place` the last one found (degrees, m).
    """

    startup_ns: int
    time_ns: int
    attitude: Quaternion
    rate: Vector3
    acceleration: Vector3
    field: Vector3
    temperature: float
    pressure: float
    interval: float
    epoch: Epoch = NO_EPOCH
    place: Vector3 = (0.0, 0.0, 0.0)

    @property
    def has_fix(self) -> bool:
        """True if the receiver has a fix."""
        return self.epoch.fix.fix

    @property
    def gps_ns(self) -> int:
        """Time since GPS's epoch; 0 for a unit without a receiver."""
        return 0 if self.epoch is NO_EPOCH else self.time_ns - (GPS_EPOCH - LEAP_SECONDS) * NS_PER_S

    @property
    def linear_ned(self) -> Vector3:
        """Acceleration without gravity, in NED (m/s²)."""
        north, east, down = rotate(self.attitude, self.acceleration)
        return north, east, down + _GRAVITY

    @property
    def accuracies(self) -> Vector3:
        """Standard deviations of the place, north, east and down (m)."""
        level, down = [sqrt(value) if self.has_fix else _UNKNOWN for value in self.epoch.fix.variances]
        return level, level, down

    def to_ecef(self, vector: Vector3) -> Vector3:
        """Return a vector in NED along the axes of the earth."""
        x, y, z = earth_centred(*TangentPlane(*self.place).geodetic(vector))
        start = earth_centred(*self.place)
        return x - start[0], y - start[1], z - start[2]


def _utc(of: Measurement) -> tuple[int, ...]:
    if not of.gps_ns:
        return (0,) * 7
    time = of.epoch._replace(time_ns=of.time_ns).time
    return time.year - 2000, *time.timetuple()[1:6], time.microsecond // 1000


def _cosines(of: Measurement) -> tuple[float, ...]:
    to_ned = matrix(of.attitude)
    return to_ned[0::3] + to_ned[1::3] + to_ned[2::3]


# Name of a quantity -> its values. Angles are in degrees, but turn rates in rad/s; vectors are along the body's axes if
# not named otherwise; a unit's quaternion has its scalar last, its matrix turns NED into the body's axes.
QUANTITIES: dict[str, Callable[[Measurement], Sequence[Any]]] = {
    "startup": lambda m: (m.startup_ns,),
    "gps_time": lambda m: (m.gps_ns,),
    "tow_ns": lambda m: (m.gps_ns % _WEEK_NS,),
    "tow_s": lambda m: (m.gps_ns % _WEEK_NS / NS_PER_S,),
    "week": lambda m: (m.gps_ns // _WEEK_NS,),
    "utc": _utc,
    "time_status": lambda m: (7 * m.has_fix,),  # time of week, date and UTC are valid
    "leap": lambda _: (LEAP_SECONDS,),
    "ypr": lambda m: [degrees(angle) for angle in to_euler(m.attitude)[::-1]],
    "ypr_u": lambda _: (2.0, 0.5, 0.5),  # VN-100, data sheet
    "attitude_u": lambda _: (2.0,),
    "quaternion": lambda m: (*m.attitude[1:], m.attitude[0]),
    "cosines": _cosines,
    "rate": lambda m: m.rate,
    "accel": lambda m: m.acceleration,
    "mag": lambda m: m.field,
    "temperature": lambda m: (m.temperature,),
    "pressure": lambda m: (m.pressure,),
    "interval": lambda m: (m.interval,),
    "turned": lambda m: [degrees(value * m.interval) for value in m.rate],
    "gained": lambda m: [value * m.interval for value in m.acceleration],
    "mag_ned": lambda m: rotate(m.attitude, m.field),
    "accel_ned": lambda m: rotate(m.attitude, m.acceleration),
    "linear_ned": lambda m: m.linear_ned,
    "linear": lambda m: rotate_inverse(m.attitude, m.linear_ned),
    "mag_ecef": lambda m: m.to_ecef(rotate(m.attitude, m.field)),
    "accel_ecef": lambda m: m.to_ecef(rotate(m.attitude, m.acceleration)),
    "linear_ecef": lambda m: m.to_ecef(m.linear_ned),
    "fix": lambda m: (3 * m.has_fix,),
    "satellites": lambda m: (len(m.epoch.satellites),),
    "dilutions": lambda m: m.epoch.dilutions,
    "lla": lambda m: m.place,
    "ecef": lambda m: earth_centred(*m.place),
    "vel_ned": lambda m: m.epoch.velocity,
    "vel_body": lambda m: rotate_inverse(m.attitude, m.epoch.velocity),
    "vel_ecef": lambda m: m.to_ecef(m.epoch.velocity),
    "place_u": lambda m: m.accuracies,
    "largest_u": lambda m: (max(m.accuracies),),
    "speed_u": lambda m: (SPEED_ACCURACY if m.has_fix else _UNKNOWN,),
    "time_u": lambda m: (5e-8 if m.has_fix else 1.0,),
    "ins_status": lambda m: (6 * m.has_fix,),  # tracking, with a fix
}


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
            chosen = " ".join(field for bit, field in enumerate(_GROUPS[group]) if bits >> bit & 1)
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
    is_known = all(group < len(_GROUPS) and 0 <= b < 1 << len(_GROUPS[group]) for group, b in fields)
    return BinaryOutput(ports, divisor, fields) if is_known else None


def text_of(register: int, measurement: Measurement) -> str:
    """Return a measured register's values, each with its comma before."""
    text = ""
    for part in MEASURED[register].split():
        form, _, name = part.partition(":")
        text += "".join(f",{value:{form}}" for value in QUANTITIES[name](measurement))
    return text

"""Messages of a Doppler velocity log: marine_acoustic_msgs, and those that ROS filters and displays use."""

from math import atan2, hypot, inf, isfinite, nan
from struct import Struct
from typing import NamedTuple

from hil.ros.cdr import Layout, diagonal, tolerant
from hil.ros.encoders import (
    NO_DATA,
    RANGE_HUMBLE,
    Decoder,
    Encoded,
    Encoder,
    pack_range,
    pack_stamped,
    swap_body,
    unpack_stamped,
)
from hil.ros.topics import sample_topics
from sim.sensors.samples import Covariance, DvlSample

# Constants of marine_acoustic_msgs/Dvl.
BOTTOM, WATER = 1, 2
_PISTON = 0

_TWIST_COVARIANCE = Layout("i I string 6d 288s")
_DVL = Layout("i I string B B 3d 72s 3d B f B B 16d 16f")
_BEAMS = 4
_NO_BEAMS = (0.0,) * 32  # their vectors, ranges, variances, qualities, speeds and variances: flagged as not valid
_FLOAT64 = Struct("<d")
_NINE, _THIRTY_SIX = Struct("<9d"), Struct("<36d")


class AltitudeSample(NamedTuple):
    """Distance to the seabed in m, inf if there is none within reach."""

    time_ns: int
    distance: float


def encode_dvl(
    sample: DvlSample, frame: str = "dvl_transducer_link", variance: float = 0.0, mode: int = BOTTOM
) -> bytes:
    """Return marine_acoustic_msgs/Dvl. `mode`: bottom or water.

    `variance`: of the velocity, (m/s)², where the sample has no covariance itself; 0 is sent as -1, "not known".

    By its definition z is the way the log looks: its vector is along FRD, ours, in a frame of its own. Without
    lock there are no good beams, and velocity and altitude are NaN. Single beams and the speed of sound are left out.
    """
    forward, starboard, down = sample.velocity if sample.locked else (nan, nan, nan)
    known = sample.locked and sample.covariance
    covariance = _NINE.pack(*known) if known else diagonal(3, variance or NO_DATA, 0.0)
    return pack_stamped(
        _DVL, sample.time_ns, (frame,), mode, _PISTON, forward, starboard, down,
        covariance, sample.altitude if sample.locked else nan,
        atan2(starboard, forward), hypot(forward, starboard), _BEAMS if sample.locked else 0, 0.0, 0, 0, *_NO_BEAMS,
    )  # fmt: skip


@tolerant
def decode_dvl(data: bytes) -> DvlSample:
    """Return velocity along FRD, altitude, and whether at least one beam is locked."""
    time_ns, (_, _, u, v, w, _, altitude, _, _, beams, *_) = unpack_stamped(_DVL, data)
    return DvlSample(time_ns, (u, v, w), altitude, beams > 0 and isfinite(u + v + w))


def encode_dvl_twist(sample: DvlSample, frame: str = "dvl_link", variance: float = 0.0) -> bytes:
    """geometry_msgs/TwistWithCovarianceStamped of a velocity log.

    `variance`: of the velocity, (m/s)², where the sample has no covariance itself. Without bottom lock the velocity is
    NaN and the first covariance -1. The angular part is always empty, and its variances -1 where the others are known.
    """
    velocity = swap_body(sample.velocity) if sample.locked else (nan, nan, nan)
    known = sample.locked and sample.covariance
    covariance = _linear(known) if known else diagonal(6, variance if sample.locked else NO_DATA, 0.0)
    return pack_stamped(_TWIST_COVARIANCE, sample.time_ns, (frame,), *velocity, 0.0, 0.0, 0.0, covariance)


def _linear(of: Covariance) -> bytes:
    """Return the covariance of a twist whose linear part has this one along FRD, along FLU."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = of
    values = [0.0] * 36
    values[0:3], values[6:9], values[12:15] = (xx, -xy, -xz), (-yx, yy, yz), (-zx, zy, zz)
    values[21] = values[28] = values[35] = NO_DATA
    return _THIRTY_SIX.pack(*values)


@tolerant
def decode_dvl_twist(data: bytes) -> DvlSample:
    """Return the velocity along FRD and whether it is locked. The altitude is NaN: it travels as a Range."""
    time_ns, (u, v, w, _, _, _, covariance) = unpack_stamped(_TWIST_COVARIANCE, data)
    locked = isfinite(u + v + w) and _FLOAT64.unpack_from(covariance)[0] >= 0.0
    return DvlSample(time_ns, swap_body((u, v, w)), nan, locked)


def altitude_of(sample: DvlSample) -> AltitudeSample:
    """Return the distance to the seabed that a DVL reports; inf without bottom lock."""
    return AltitudeSample(sample.time_ns, sample.altitude if sample.locked else inf)


def encode_range(
    sample: DvlSample, frame: str = "dvl_link", limits: tuple[float, float] = (0.2, 75.0), variance: float = 0.0
) -> bytes:
    """sensor_msgs/Range of the altitude, `limits` m of the device; +inf (REP 117) without bottom lock.

    `variance` in m², where the sample has none itself. The field of view is sent as 0: the mean of narrow beams.
    """
    distance = altitude_of(sample).distance
    return pack_range(sample.time_ns, (frame,), 0, 0.0, *limits, distance, sample.altitude_variance or variance)


@tolerant
def decode_range(data: bytes) -> AltitudeSample:
    """Return the distance to the seabed; reads the message of Jazzy and the shorter one of Humble."""
    time_ns, (_, _, _, _, distance) = unpack_stamped(RANGE_HUMBLE, data)
    return AltitudeSample(time_ns, distance)


def _encode_all(sample: DvlSample, prefix: str, name: str = "dvl") -> Encoded:
    own, twist, altitude = sample_topics(name)
    return [
        (own, encode_dvl(sample, f"{prefix}{name}_transducer_link")),
        (twist, encode_dvl_twist(sample, f"{prefix}{name}_link")),
        (altitude, encode_range(sample, f"{prefix}{name}_link")),
    ]


def _encode_water(sample: DvlSample, prefix: str, variance: float = 0.0, name: str = "dvl_water") -> Encoded:
    return [(name, encode_dvl(sample, f"{prefix}{name}_transducer_link", variance, WATER))]


ENCODERS: dict[str, Encoder] = {"dvl": _encode_all, "dvl_water": _encode_water}
DECODERS: dict[str, Decoder] = {
    "altitude": decode_range,
    "dvl": decode_dvl,
    "dvl_twist": decode_dvl_twist,
    "dvl_water": decode_dvl,
}

"""Messages of a Doppler velocity log (DVL): marine_acoustic_msgs, and those for ROS filters and displays."""

from math import atan2, hypot, inf, isfinite, nan
from struct import Struct
from typing import NamedTuple

from hil.ros import encoders as ros
from hil.ros.cdr import Layout, diagonal, tolerant
from hil.ros.topics import sample_topics
from sim.sensors.samples import Covariance, DvlSample

# Constants of marine_acoustic_msgs/Dvl.
BOTTOM, WATER = 1, 2
_PISTON = 0

_TWIST_COVARIANCE = Layout("i I string 6d 288s")
_DVL = Layout("i I string B B 3d 72s 3d B f B B 16d 16f")
_BEAMS = 4
_NO_BEAMS = (0.0,) * 32  # vectors, ranges, variances, qualities, speeds and their variances; flagged as invalid
_FLOAT64 = Struct("<d")
_NINE, _THIRTY_SIX = Struct("<9d"), Struct("<36d")


class AltitudeSample(NamedTuple):
    """Distance to the seabed in m; inf if there is none within range."""

    time_ns: int
    distance: float


def encode_dvl(
    sample: DvlSample, frame: str = "dvl_transducer_link", variance: float = 0.0, mode: int = BOTTOM
) -> bytes:
    """Return marine_acoustic_msgs/Dvl. `mode`: BOTTOM or WATER.

    `variance`: of the velocity, (m/s)², if the sample has no covariance; 0 is sent as -1, "unknown".

    By its definition, z is the direction in which the DVL looks. So the velocity is along FRD as ours, in a frame of
    its own. Without lock there are no good beams, and velocity and altitude are NaN. Single beams and the speed of
    sound are not sent.
    """
    forward, starboard, down = sample.velocity if sample.locked else (nan, nan, nan)
    known = sample.locked and sample.covariance
    covariance = _NINE.pack(*known) if known else diagonal(3, variance or ros.NO_DATA, 0.0)
    return ros.pack_stamped(
        _DVL, sample.time_ns, (frame,), mode, _PISTON, forward, starboard, down,
        covariance, sample.altitude if sample.locked else nan,
        atan2(starboard, forward), hypot(forward, starboard), _BEAMS if sample.locked else 0, 0.0, 0, 0, *_NO_BEAMS,
    )  # fmt: skip


@tolerant
def decode_dvl(data: bytes) -> DvlSample:
    """Return velocity along FRD, altitude, and whether at least one beam has lock."""
    time_ns, (_, _, u, v, w, _, altitude, _, _, beams, *_) = ros.unpack_stamped(_DVL, data)
    return DvlSample(time_ns, (u, v, w), altitude, beams > 0 and isfinite(u + v + w))


def encode_dvl_twist(sample: DvlSample, frame: str = "dvl_link", variance: float = 0.0) -> bytes:
    """Return geometry_msgs/TwistWithCovarianceStamped.

    `variance`: of the velocity, (m/s)², if the sample has no covariance. Without bottom lock the velocity is NaN and
    the first covariance -1. The angular part is always 0, with variances -1 if the sample has a covariance.
    """
    velocity = ros.swap_body(sample.velocity) if sample.locked else (nan, nan, nan)
    known = sample.locked and sample.covariance
    covariance = _linear(known) if known else diagonal(6, variance if sample.locked else ros.NO_DATA, 0.0)
    return ros.pack_stamped(_TWIST_COVARIANCE, sample.time_ns, (frame,), *velocity, 0.0, 0.0, 0.0, covariance)


def _linear(of: Covariance) -> bytes:
    """Return the 6x6 covariance of a twist along FLU, from the velocity's covariance along FRD."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = of
    values = [0.0] * 36
    values[0:3], values[6:9], values[12:15] = (xx, -xy, -xz), (-yx, yy, yz), (-zx, zy, zz)
    values[21] = values[28] = values[35] = ros.NO_DATA
    return _THIRTY_SIX.pack(*values)


@tolerant
def decode_dvl_twist(data: bytes) -> DvlSample:
    """Return the velocity along FRD and whether it has lock. The altitude is NaN: it is sent as a Range."""
    time_ns, (u, v, w, _, _, _, covariance) = ros.unpack_stamped(_TWIST_COVARIANCE, data)
    locked = isfinite(u + v + w) and _FLOAT64.unpack_from(covariance)[0] >= 0.0
    return DvlSample(time_ns, ros.swap_body((u, v, w)), nan, locked)


def altitude_of(sample: DvlSample) -> AltitudeSample:
    """Return the distance to the seabed that a DVL reports; inf without bottom lock."""
    return AltitudeSample(sample.time_ns, sample.altitude if sample.locked else inf)


def encode_range(
    sample: DvlSample, frame: str = "dvl_link", limits: tuple[float, float] = (0.2, 75.0), variance: float = 0.0
) -> bytes:
    """Encode sensor_msgs/Range of the altitude, with the device's `limits` (m); +inf (REP 117) without bottom lock.

    `variance` in m², if the sample has none. The field of view is sent as 0, as the altitude is a mean of narrow beams.
    """
    distance = altitude_of(sample).distance
    return ros.pack_range(sample.time_ns, (frame,), 0, 0.0, *limits, distance, sample.altitude_variance or variance)


@tolerant
def decode_range(data: bytes) -> AltitudeSample:
    """Return the distance to the seabed; reads the message of Jazzy and the shorter one of Humble."""
    time_ns, (_, _, _, _, distance) = ros.unpack_stamped(ros.RANGE_HUMBLE, data)
    return AltitudeSample(time_ns, distance)


def _encode_all(sample: DvlSample, prefix: str, name: str = "dvl") -> ros.Encoded:
    own, twist, altitude = sample_topics(name)
    return [
        (own, encode_dvl(sample, f"{prefix}{name}_transducer_link")),
        (twist, encode_dvl_twist(sample, f"{prefix}{name}_link")),
        (altitude, encode_range(sample, f"{prefix}{name}_link")),
    ]


def _encode_water(sample: DvlSample, prefix: str, variance: float = 0.0, name: str = "dvl_water") -> ros.Encoded:
    return [(name, encode_dvl(sample, f"{prefix}{name}_transducer_link", variance, WATER))]


ENCODERS: dict[str, ros.Encoder] = {"dvl": _encode_all, "dvl_water": _encode_water}
DECODERS: dict[str, ros.Decoder] = {
    "altitude": decode_range,
    "dvl": decode_dvl,
    "dvl_twist": decode_dvl_twist,
    "dvl_water": decode_dvl,
}

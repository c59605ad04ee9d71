"""ROS 2 messages of scanning sensors: sensor_msgs/LaserScan and more; frames and rules are those of hil.ros.encoders.

The angles of a scan are about the z axis of its frame. A laser's or scanning sonar's frame is the sensor's FLU frame,
in which angles increase to port, so the last beam is sent first. A profiler's frame is "profiler_scan": x down, y to
starboard, z astern of the sensor; the points of a profile are in it, too. A ping of a scanning sonar with intensities
is a sonar picture of one beam (hil.ros.images) in "scanning_sonar_fan": x up, y to starboard, z ahead.
"""

from math import cos, isfinite, sin

from hil.ros import encoders as ros
from hil.ros.cdr import tolerant
from hil.ros.clouds import decode_points, encode_points
from hil.ros.message import encode, header, read, time_of
from hil.ros.sensors import decode_distance, encode_distance
from sim.sensors.extra_samples import LaserSample
from sim.sensors.imaging.samples import EchoSample

_TYPE = "sensor_msgs/msg/LaserScan"


def encode_scan(sample: LaserSample, frame: str = "laser_link") -> bytes:
    """Return the message of a scan about the sensor's z axis."""
    last = sample.angle_min + (len(sample.ranges) - 1) * sample.angle_increment
    turned = sample._replace(angle_min=-last, ranges=sample.ranges[::-1], intensities=sample.intensities[::-1])
    return encode_profile(turned, frame)


@tolerant
def decode_scan(data: bytes) -> LaserSample:
    """Return the scan in the sensor's order of beams; times inside the scan are ignored."""
    scan = _decode(data)
    last = scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment
    return scan._replace(angle_min=-last, ranges=scan.ranges[::-1], intensities=scan.intensities[::-1])


def encode_profile(sample: LaserSample, frame: str = "profiler_scan") -> bytes:
    """Return the message of a scan about the sensor's x axis."""
    first, increment, (near, far) = sample.angle_min, sample.angle_increment, sample.limits
    last = first + (len(sample.ranges) - 1) * increment
    angles = {"angle_min": first, "angle_max": last, "angle_increment": increment}
    distances = {"range_min": near, "range_max": far, "ranges": sample.ranges, "intensities": sample.intensities}
    return encode(_TYPE, {"header": header(sample.time_ns, frame), **angles, **distances})


@tolerant
def decode_profile(data: bytes) -> LaserSample:
    """Return the scan in the sensor's order of beams."""
    return _decode(data)


def _decode(data: bytes) -> LaserSample:
    scan = read(_TYPE, data)
    limits = scan["range_min"], scan["range_max"]
    return LaserSample(
        time_of(scan), scan["angle_min"], scan["angle_increment"], scan["ranges"], limits, scan["intensities"]
    )


def profile_points(sample: LaserSample) -> list[tuple[float, float, float, float]]:
    """Return the points of a profile in "profiler_scan" (x down, y to starboard, m) with their echo strengths (dB)."""
    strengths = sample.intensities or (0.0,) * len(sample.ranges)
    beams = enumerate(zip(sample.ranges, strengths, strict=True))
    angles = [(sample.angle_min + i * sample.angle_increment, r, s) for i, (r, s) in beams if isfinite(r)]
    return [(r * cos(angle), r * sin(angle), 0.0, s) for angle, r, s in angles]


def _profile_messages(sample: LaserSample, prefix: str, name: str = "profiler") -> ros.Encoded:
    frame = f"{prefix}{name}_scan"
    yield name, encode_profile(sample, frame)
    yield f"{name}/points", encode_points(sample.time_ns, profile_points(sample), frame)


def _scan_messages(sample: LaserSample | EchoSample, prefix: str, name: str = "scanning_sonar") -> ros.Encoded:
    if isinstance(sample, LaserSample):
        yield name, encode_scan(sample, f"{prefix}{name}_link")
        return
    from hil.ros.images import encode_sonar

    time_ns, scan, echoes = sample
    yield name, encode_scan(scan._replace(time_ns=time_ns), f"{prefix}{name}_link")
    yield f"{name}/image", encode_sonar(echoes._replace(time_ns=time_ns), f"{prefix}{name}_fan")


ENCODERS: dict[str, ros.Encoder] = {
    "laser": lambda sample, prefix, name="laser": [(name, encode_scan(sample, f"{prefix}{name}_link"))],
    "profiler": _profile_messages,
    "scanning_sonar": _scan_messages,
    "echosounder": lambda sample, prefix, *variance, name="echosounder": [
        (name, encode_distance(sample, f"{prefix}{name}_link", *variance)),
    ],
}
DECODERS: dict[str, ros.Decoder] = {
    "laser": decode_scan,
    "profiler": decode_profile,
    "profiler/points": decode_points,
    "scanning_sonar": decode_scan,
    "echosounder": decode_distance,
}

"""ROS 2 messages of scanning sensors: sensor_msgs/LaserScan; frames and rules are those of hil.ros.encoders.

A scan is counted about the z axis of its frame. That of a laser or scanning sonar is the sensor's FLU frame, in which
angles grow to port: they go out with the last one first. A profiler's is called "profiler_scan": x down, y to
starboard, z astern of the sensor.
"""

from hil.ros import encoders as ros
from hil.ros.cdr import tolerant
from hil.ros.message import encode, header, read, time_of
from hil.ros.sensors import decode_distance, encode_distance
from sim.sensors.extra_samples import LaserSample

_TYPE = "sensor_msgs/msg/LaserScan"


def encode_scan(sample: LaserSample, frame: str = "laser_link") -> bytes:
    """Return a fan about the sensor's z axis."""
    last = sample.angle_min + (len(sample.ranges) - 1) * sample.angle_increment
    turned = sample._replace(angle_min=-last, ranges=sample.ranges[::-1])
    return encode_profile(turned, frame)


@tolerant
def decode_scan(data: bytes) -> LaserSample:
    """Return the fan as the sensor gave it; times within it and intensities are left."""
    scan = _decode(data)
    last = scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment
    return scan._replace(angle_min=-last, ranges=scan.ranges[::-1])


def encode_profile(sample: LaserSample, frame: str = "profiler_scan") -> bytes:
    """Return a fan about the sensor's x axis."""
    first, increment, (near, far) = sample.angle_min, sample.angle_increment, sample.limits
    last = first + (len(sample.ranges) - 1) * increment
    angles = {"angle_min": first, "angle_max": last, "angle_increment": increment}
    distances = {"range_min": near, "range_max": far, "ranges": sample.ranges}
    return encode(_TYPE, {"header": header(sample.time_ns, frame), **angles, **distances})


@tolerant
def decode_profile(data: bytes) -> LaserSample:
    """Return the fan as the sensor gave it."""
    return _decode(data)


def _decode(data: bytes) -> LaserSample:
    scan = read(_TYPE, data)
    limits = scan["range_min"], scan["range_max"]
    return LaserSample(time_of(scan), scan["angle_min"], scan["angle_increment"], scan["ranges"], limits)


ENCODERS: dict[str, ros.Encoder] = {
    "laser": lambda sample, prefix, name="laser": [(name, encode_scan(sample, f"{prefix}{name}_link"))],
    "profiler": lambda sample, prefix, name="profiler": [(name, encode_profile(sample, f"{prefix}{name}_scan"))],
    "scanning_sonar": lambda sample, prefix, name="scanning_sonar": [
        (name, encode_scan(sample, f"{prefix}{name}_link")),
    ],
    "echosounder": lambda sample, prefix, *variance, name="echosounder": [
        (name, encode_distance(sample, f"{prefix}{name}_link", *variance)),
    ],
}
DECODERS: dict[str, ros.Decoder] = {
    "laser": decode_scan,
    "profiler": decode_profile,
    "scanning_sonar": decode_scan,
    "echosounder": decode_distance,
}

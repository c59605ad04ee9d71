"""ROS 2 messages of scanning sensors: sensor_msgs/LaserScan; frames and rules are those of hil.ros.encoders.

A scan is counted about the z axis of its frame. That of a laser or scanning sonar is the sensor's FLU frame, in which
angles grow to port: they go out with the last one first. A profiler's is called "profiler_scan": x down, y to
starboard, z astern of the sensor.
"""

from hil.ros import encoders as ros
from hil.ros.cdr import Reader, Writer, tolerant
from hil.ros.sensors import decode_distance, encode_distance
from sim.sensors.extra_samples import LaserSample

_NS_PER_S = 1_000_000_000


def encode_scan(sample: LaserSample, frame: str = "laser_link") -> bytes:
    """Return a fan about the sensor's z axis."""
    last = sample.angle_min + (len(sample.ranges) - 1) * sample.angle_increment
    turned = sample._replace(angle_min=-last, ranges=sample.ranges[::-1])
    return _encode(turned, frame)


@tolerant
def decode_scan(data: bytes) -> LaserSample:
    """Return the fan as the sensor gave it; times within it and intensities are left."""
    found = _decode(data)
    last = found.angle_min + (len(found.ranges) - 1) * found.angle_increment
    return found._replace(angle_min=-last, ranges=found.ranges[::-1])


def encode_profile(sample: LaserSample, frame: str = "profiler_scan") -> bytes:
    """Return a fan about the sensor's x axis."""
    return _encode(sample, frame)


@tolerant
def decode_profile(data: bytes) -> LaserSample:
    """Return the fan as the sensor gave it."""
    return _decode(data)


def _encode(sample: LaserSample, frame: str) -> bytes:
    seconds, ns = divmod(sample.time_ns, _NS_PER_S)
    last = sample.angle_min + (len(sample.ranges) - 1) * sample.angle_increment
    writer = Writer()
    writer.numbers("i", seconds)
    writer.numbers("I", ns)
    writer.string(frame)
    writer.numbers("f", sample.angle_min, last, sample.angle_increment, 0.0, 0.0, *sample.limits)
    writer.numbers("I", len(sample.ranges))
    writer.numbers("f", *sample.ranges)
    writer.numbers("I", 0)  # no intensities
    return bytes(writer.data)


def _decode(data: bytes) -> LaserSample:
    reader = Reader(data)
    (seconds,), (ns,) = reader.numbers("i"), reader.numbers("I")
    reader.string()
    first, _, increment, _, _, near, far = reader.numbers("f", 7)
    ranges = reader.numbers("f", reader.count())
    reader.numbers("f", reader.count())  # intensities
    return LaserSample(seconds * _NS_PER_S + ns, first, increment, ranges, (near, far))


ENCODERS: dict[str, ros.Encoder] = {
    "laser": lambda sample, prefix: [("laser", encode_scan(sample, f"{prefix}laser_link"))],
    "profiler": lambda sample, prefix: [("profiler", encode_profile(sample, f"{prefix}profiler_scan"))],
    "scanning_sonar": lambda sample, prefix: [
        ("scanning_sonar", encode_scan(sample, f"{prefix}scanning_sonar_link")),
    ],
    "echosounder": lambda sample, prefix, *variance: [
        ("echosounder", encode_distance(sample, f"{prefix}echosounder_link", *variance)),
    ],
}
DECODERS: dict[str, ros.Decoder] = {
    "laser": decode_scan,
    "profiler": decode_profile,
    "scanning_sonar": decode_scan,
    "echosounder": decode_distance,
}

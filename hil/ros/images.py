"""ROS 2 messages of imaging sensors: sensor_msgs Image, CompressedImage, CameraInfo; marine_acoustic_msgs sonars.

Pictures are as ROS has them, from the upper left. The frames of REP 103 and of marine_acoustic_msgs (its 2.0.2, the
comments in its .msg files) are not those of the devices, so each has one of its own, fixed to that of the sensor:
"camera_optical_frame" is z ahead, x right, y down; "forward_sonar_fan" is z ahead, x up, y to starboard, in which the
beams of a fan lie in the y-z plane. In a sonar's image a row is a range, a column a beam.
"""

from array import array
from math import atan2, cos, inf, pi, sin
from typing import Any, NamedTuple

from hil.common.errors import MissingExtraError
from hil.ros import encoders as ros
from hil.ros.cdr import MalformedError, Reader, Writer, tolerant
from hil.ros.clouds import Cloud, coloured, decode_cloud, encode_cloud
from sim.sensors.imaging.samples import (
    CameraSample,
    Distortion,
    Encoding,
    Intrinsics,
    SideScanSample,
    SonarImageSample,
)

_NS_PER_S = 1_000_000_000
_UPRIGHT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_TYPE_CODES: dict[Encoding, int] = {"uint8": 0, "float32": 8}  # of SonarImageData
_ENCODINGS: dict[int, Encoding] = {code: encoding for encoding, code in _TYPE_CODES.items()}
_PIXEL = {"rgb8": 3, "mono8": 1, "32FC1": 4, "32SC1": 4}  # bytes


class Picture(NamedTuple):
    """An Image or CompressedImage; `encoding` is ROS's ("rgb8", "32FC1") or "jpeg", which has its size inside."""

    time_ns: int
    width: int
    height: int
    encoding: str
    data: bytes


class Pinhole(NamedTuple):
    """Intrinsics in a CameraInfo: the pinhole, and the distortion of the lens."""

    time_ns: int
    width: int
    height: int
    intrinsics: Intrinsics
    distortion: Distortion


def encode_image(picture: Picture, frame: str = "camera_optical_frame") -> bytes:
    """sensor_msgs/Image of a picture with no gaps between its rows."""
    writer = _stamped(picture.time_ns, frame)
    writer.numbers("I", picture.height, picture.width)
    writer.string(picture.encoding)
    writer.numbers("B", 0)  # little-endian
    writer.numbers("I", picture.width * _PIXEL[picture.encoding])
    _bytes(writer, picture.data)
    return bytes(writer.data)


@tolerant
def decode_image(data: bytes) -> Picture:
    """Return a picture of one of the encodings that are sent here, without gaps between its rows."""
    reader, time_ns = _begin(data)
    height, width = reader.numbers("I", 2)
    encoding = reader.string()
    (_big_endian,), (step,) = reader.numbers("B"), reader.numbers("I")
    pixels = reader.raw(reader.count())
    if step != width * _PIXEL.get(encoding, 0) or len(pixels) != step * height:
        raise MalformedError("not a picture of its size")
    return Picture(time_ns, width, height, encoding, pixels)


def encode_compressed(time_ns: int, jpeg: bytes, frame: str = "camera_optical_frame") -> bytes:
    """sensor_msgs/CompressedImage."""
    writer = _stamped(time_ns, frame)
    writer.string("jpeg")
    _bytes(writer, jpeg)
    return bytes(writer.data)


@tolerant
def decode_compressed(data: bytes) -> Picture:
    """Return the compressed picture as it is, of width and height 0."""
    reader, time_ns = _begin(data)
    return Picture(time_ns, 0, 0, reader.string(), reader.raw(reader.count()))


def jpeg(sample: CameraSample, quality: int) -> bytes:
    """Return the picture as JPEG of a `quality` from 1 to 95. Raises MissingExtraError."""
    try:
        from PIL import Image
    except ImportError:
        raise MissingExtraError(
            "pictures as JPEG need Pillow: pip install 'uuv-hil[imaging]', or [ros] images = \"raw\""
        ) from None
    import io

    out = io.BytesIO()
    Image.frombytes("RGB", (sample.width, sample.height), sample.rgb).save(out, "JPEG", quality=quality)
    return out.getvalue()


def encode_camera_info(pinhole: Pinhole, frame: str = "camera_optical_frame") -> bytes:
    """sensor_msgs/CameraInfo; a picture that is put right has the same pinhole."""
    time_ns, width, height, (fx, fy, cx, cy), distortion = pinhole
    writer = _stamped(time_ns, frame)
    writer.numbers("I", height, width)
    writer.string("plumb_bob")
    writer.numbers("I", len(distortion))
    writer.numbers("d", *distortion, fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0, *_UPRIGHT)
    writer.numbers("d", fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
    writer.numbers("I", 0, 0, 0, 0, 0, 0)  # no binning, and all of the picture
    writer.numbers("B", 0)
    return bytes(writer.data)


@tolerant
def decode_camera_info(data: bytes) -> Pinhole:
    """Return the pinhole and a distortion of five numbers; rectification and region are left."""
    reader, time_ns = _begin(data)
    height, width = reader.numbers("I", 2)
    reader.string()
    if reader.count() != 5:
        raise MalformedError("another distortion")
    k1, k2, p1, p2, k3 = reader.numbers("d", 5)
    fx, _, cx, _, fy, cy, _, _, _ = reader.numbers("d", 9)
    reader.numbers("d", 9 + 12)
    reader.numbers("I", 6)
    reader.numbers("B")
    return Pinhole(time_ns, width, height, Intrinsics(fx, fy, cx, cy), (k1, k2, p1, p2, k3))


def camera_messages(sample: CameraSample, prefix: str, images: str = "raw", quality: int = 80) -> ros.Encoded:
    """Return all messages of one picture: `images` is "raw", "jpeg" or "both". Raises MissingExtraError."""
    frame, shape = f"{prefix}camera_optical_frame", (sample.time_ns, sample.width, sample.height)
    info = encode_camera_info(Pinhole(*shape, sample.intrinsics, sample.distortion), frame)
    found = [("camera/camera_info", info)]
    if images != "jpeg":
        found.append(("camera/image_raw", encode_image(Picture(*shape, "rgb8", sample.rgb), frame)))
    if images != "raw":
        found.append(("camera/image_raw/compressed", encode_compressed(sample.time_ns, jpeg(sample, quality), frame)))
    if sample.depth is not None:
        found.append(("camera/depth/camera_info", info))
        found.append(("camera/depth/image_raw", encode_image(Picture(*shape, "32FC1", sample.depth), frame)))
    if sample.points is not None:
        cloud = Cloud(*shape, coloured(sample.points, sample.rgb))
        found.append(("camera/depth/points", encode_cloud(cloud, frame)))
    if sample.labels is not None:
        found.append(("camera/labels", encode_image(Picture(*shape, "32SC1", sample.labels), frame)))
    return found


def encode_sonar(sample: SonarImageSample, frame: str = "forward_sonar_fan") -> bytes:
    """marine_acoustic_msgs/ProjectedSonarImage."""
    writer = _stamped(sample.time_ns, frame)
    _ping(writer, sample, len(sample.beams))
    writer.numbers("I", len(sample.beams))
    writer.numbers("d", *[x for angle in sample.beams for x in (0.0, sin(angle), cos(angle))])
    writer.numbers("I", sample.bins)
    writer.numbers("f", *[sample.first_range + (i + 0.5) * sample.range_step for i in range(sample.bins)])
    _echoes(writer, sample.encoding, len(sample.beams), sample.intensities)
    return bytes(writer.data)


@tolerant
def decode_sonar(data: bytes) -> SonarImageSample:
    """Return the picture, of a device with evenly spaced ranges."""
    reader, time_ns = _begin(data)
    frequency, speed, height, width = _read_ping(reader)
    directions = reader.numbers("d", 3 * reader.count())
    ranges = reader.numbers("f", reader.count())
    step = (ranges[-1] - ranges[0]) / (len(ranges) - 1) if len(ranges) > 1 else 0.0
    beams = tuple([atan2(y, z) for y, z in zip(directions[1::3], directions[2::3], strict=True)])
    encoding, count, echoes = _read_echoes(reader)
    if count != len(beams) or len(echoes) != count * len(ranges) * (4 if encoding == "float32" else 1):
        raise MalformedError("not a picture of its size")
    first = ranges[0] - 0.5 * step if ranges else 0.0
    return SonarImageSample(
        time_ns, beams, len(ranges), first, step, frequency, speed, width, height, encoding, echoes
    )  # fmt: skip


def encode_side_scan(sample: SideScanSample, frame: str = "side_scan_link") -> bytes:
    """marine_acoustic_msgs/RawSonarImage of two beams, port and starboard; the altitude does not travel.

    Their angles are about the sensor's x axis from down to starboard.
    """
    code = "B" if sample.encoding == "uint8" else "f"
    both = array(code, bytes(len(sample.port) + len(sample.starboard)))
    both[0::2], both[1::2] = array(code, sample.port), array(code, sample.starboard)
    writer = _stamped(sample.time_ns, frame)
    _ping(writer, sample, 2)
    writer.numbers("f", 0.5 * sample.sound_speed / sample.range_step)  # samples a second
    writer.numbers("I", sample.bins, 0)
    for angles in ((0.0, 0.0), (0.0, 0.0), (-0.5 * pi, 0.5 * pi)):  # delays, and where it sends and listens
        writer.numbers("I", 2)
        writer.numbers("f", *angles)
    _echoes(writer, sample.encoding, 2, both.tobytes())
    return bytes(writer.data)


@tolerant
def decode_side_scan(data: bytes) -> SideScanSample:
    """Return the ping; its altitude is inf, as it does not travel."""
    reader, time_ns = _begin(data)
    frequency, speed, height, width = _read_ping(reader)
    (rate,), (bins, _) = reader.numbers("f"), reader.numbers("I", 2)
    for _ in range(3):
        reader.numbers("f", reader.count())
    encoding, count, echoes = _read_echoes(reader)
    both = array("B" if encoding == "uint8" else "f")
    if count != 2 or len(echoes) != 2 * bins * both.itemsize or rate <= 0.0:
        raise MalformedError("not two sides of as many samples")
    both.frombytes(echoes)
    sides = both[0::2].tobytes(), both[1::2].tobytes()
    step = 0.5 * speed / rate
    return SideScanSample(time_ns, bins, step, frequency, speed, width, height, inf, encoding, *sides)


def _stamped(time_ns: int, frame: str) -> Writer:
    """Return a message with its std_msgs/Header."""
    writer = Writer()
    writer.numbers("i", time_ns // _NS_PER_S)
    writer.numbers("I", time_ns % _NS_PER_S)
    writer.string(frame)
    return writer


def _begin(data: bytes) -> tuple[Reader, int]:
    """Return a reader behind the header, and the time of that."""
    reader = Reader(data)
    (seconds,), (ns,) = reader.numbers("i"), reader.numbers("I")
    reader.string()
    return reader, seconds * _NS_PER_S + ns


def _bytes(writer: Writer, data: bytes) -> None:
    writer.numbers("I", len(data))
    writer.raw(data)


def _ping(writer: Writer, sample: SonarImageSample | SideScanSample, beams: int) -> None:
    """Write a PingInfo: the transmit beam has the height of a beam, the receive beam its width."""
    writer.numbers("f", sample.frequency, sample.sound_speed)
    for width in (sample.beam_height, sample.beam_width):
        writer.numbers("I", beams)
        writer.numbers("f", *[width] * beams)


def _read_ping(reader: Reader) -> tuple[float, float, float, float]:
    """Return frequency, speed of sound, height and width of the first beam."""
    frequency, speed = reader.numbers("f", 2)
    heights = reader.numbers("f", reader.count())
    widths = reader.numbers("f", reader.count())
    return frequency, speed, heights[0] if heights else 0.0, widths[0] if widths else 0.0


def _echoes(writer: Writer, encoding: Encoding, beams: int, data: bytes) -> None:
    writer.numbers("B", 0)  # little-endian
    writer.numbers("I", _TYPE_CODES[encoding], beams)
    _bytes(writer, data)


def _read_echoes(reader: Reader) -> tuple[Encoding, int, bytes]:
    (big_endian,), (code, beams) = reader.numbers("B"), reader.numbers("I", 2)
    if big_endian or code not in _ENCODINGS:
        raise MalformedError("no numbers that are sent here")
    return _ENCODINGS[code], beams, reader.raw(reader.count())


ENCODERS: dict[str, ros.Encoder] = {
    "camera": camera_messages,
    "forward_sonar": lambda sample, prefix: [
        ("forward_sonar/image", encode_sonar(sample, f"{prefix}forward_sonar_fan"))
    ],
    "side_scan": lambda sample, prefix: [("side_scan/image", encode_side_scan(sample, f"{prefix}side_scan_link"))],
}
DECODERS: dict[str, Any] = {
    "camera/image_raw": decode_image,
    "camera/image_raw/compressed": decode_compressed,
    "camera/camera_info": decode_camera_info,
    "camera/depth/image_raw": decode_image,
    "camera/depth/camera_info": decode_camera_info,
    "camera/depth/points": decode_cloud,
    "camera/labels": decode_image,
    "forward_sonar/image": decode_sonar,
    "side_scan/image": decode_side_scan,
}

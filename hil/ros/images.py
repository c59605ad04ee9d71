"""ROS 2 messages of imaging sensors: sensor_msgs Image, CompressedImage, CameraInfo; marine_acoustic_msgs sonars.

Pictures begin at the upper left, as in ROS. The axes of REP 103 and of marine_acoustic_msgs (2.0.2, comments in its
.msg files) differ from the devices' axes, so each sensor has a second frame, fixed to its own: "camera_optical_frame"
has z ahead, x right, y down; "forward_sonar_fan" has z ahead, x up, y to starboard, with the beams of the fan in its
y-z plane. In a sonar's image a row is a range, a column a beam.
"""

from array import array
from math import atan2, cos, inf, pi, sin
from typing import Any, NamedTuple

from hil.common.errors import MissingExtraError
from hil.ros import encoders as ros
from hil.ros.cdr import MalformedError, tolerant
from hil.ros.clouds import Cloud, coloured, decode_cloud, encode_cloud
from hil.ros.message import Message, encode, header, read, time_of
from sim.sensors.imaging.samples import (
    CameraSample,
    Distortion,
    Encoding,
    Intrinsics,
    SideScanSample,
    SonarImageSample,
)

_IMAGE, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_SONAR, _SIDE_SCAN = "marine_acoustic_msgs/msg/ProjectedSonarImage", "marine_acoustic_msgs/msg/RawSonarImage"
_UPRIGHT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_TYPE_CODES: dict[Encoding, int] = {"uint8": 0, "float32": 8}  # constants of SonarImageData
_ENCODINGS: dict[int, Encoding] = {code: encoding for encoding, code in _TYPE_CODES.items()}
_PIXEL = {"rgb8": 3, "mono8": 1, "32FC1": 4, "32SC1": 4}  # bytes of a pixel


class Picture(NamedTuple):
    """An Image or CompressedImage; `encoding` is that of ROS ("rgb8", "32FC1") or "jpeg", with the size in its data."""

    time_ns: int
    width: int
    height: int
    encoding: str
    data: bytes


class Pinhole(NamedTuple):
    """Intrinsics in a CameraInfo: the pinhole model, and the distortion of the lens."""

    time_ns: int
    width: int
    height: int
    intrinsics: Intrinsics
    distortion: Distortion


def encode_image(picture: Picture, frame: str = "camera_optical_frame") -> bytes:
    """Encode sensor_msgs/Image of a picture without gaps between its rows."""
    size = {"height": picture.height, "width": picture.width, "step": picture.width * _PIXEL[picture.encoding]}
    head = header(picture.time_ns, frame)
    return encode(_IMAGE, {"header": head, **size, "encoding": picture.encoding, "data": picture.data})


@tolerant
def decode_image(data: bytes) -> Picture:
    """Return a picture in one of the encodings used here, without gaps between its rows."""
    message = read(_IMAGE, data)
    height, width, encoding, pixels = [message[key] for key in ("height", "width", "encoding", "data")]
    if message["step"] != width * _PIXEL.get(encoding, 0) or len(pixels) != message["step"] * height:
        raise MalformedError("not a picture of its size")
    return Picture(time_of(message), width, height, encoding, pixels)


def encode_compressed(time_ns: int, jpeg: bytes, frame: str = "camera_optical_frame") -> bytes:
    """Encode sensor_msgs/CompressedImage."""
    return encode(_COMPRESSED, {"header": header(time_ns, frame), "format": "jpeg", "data": jpeg})


@tolerant
def decode_compressed(data: bytes) -> Picture:
    """Return the compressed picture, with width and height 0."""
    message = read(_COMPRESSED, data)
    return Picture(time_of(message), 0, 0, message["format"], message["data"])


def jpeg(sample: CameraSample, quality: int) -> bytes:
    """Return the picture as JPEG with a `quality` from 1 to 95. Raises MissingExtraError."""
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
    """Encode sensor_msgs/CameraInfo; the rectified picture has the same pinhole model."""
    time_ns, width, height, (fx, fy, cx, cy), distortion = pinhole
    matrix = fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0
    projection = fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0
    lens = {"distortion_model": "plumb_bob", "d": distortion, "k": matrix, "r": _UPRIGHT, "p": projection}
    return encode(_CAMERA_INFO, {"header": header(time_ns, frame), "height": height, "width": width, **lens})


@tolerant
def decode_camera_info(data: bytes) -> Pinhole:
    """Return the pinhole model and a distortion of five numbers; rectification and region are ignored."""
    message = read(_CAMERA_INFO, data)
    if len(message["d"]) != 5:
        raise MalformedError("another distortion")
    fx, _, cx, _, fy, cy, _, _, _ = message["k"]
    intrinsics = Intrinsics(fx, fy, cx, cy)
    return Pinhole(time_of(message), message["width"], message["height"], intrinsics, message["d"])


def camera_messages(
    sample: CameraSample, prefix: str, images: str = "raw", quality: int = 80, name: str = "camera"
) -> ros.Encoded:
    """Return all messages of one picture; `images` is "raw", "jpeg" or "both". Raises MissingExtraError."""
    frame, shape = f"{prefix}{name}_optical_frame", (sample.time_ns, sample.width, sample.height)
    info = encode_camera_info(Pinhole(*shape, sample.intrinsics, sample.distortion), frame)
    messages = [(f"{name}/camera_info", info)]
    if images != "jpeg":
        messages.append((f"{name}/image_raw", encode_image(Picture(*shape, "rgb8", sample.rgb), frame)))
    if images != "raw":
        messages.append(
            (f"{name}/image_raw/compressed", encode_compressed(sample.time_ns, jpeg(sample, quality), frame))
        )
    if sample.depth is not None:
        messages.append((f"{name}/depth/camera_info", info))
        messages.append((f"{name}/depth/image_raw", encode_image(Picture(*shape, "32FC1", sample.depth), frame)))
    if sample.points is not None:
        cloud = Cloud(*shape, coloured(sample.points, sample.rgb))
        messages.append((f"{name}/depth/points", encode_cloud(cloud, frame)))
    if sample.labels is not None:
        messages.append((f"{name}/labels", encode_image(Picture(*shape, "32SC1", sample.labels), frame)))
    return messages


def encode_sonar(sample: SonarImageSample, frame: str = "forward_sonar_fan") -> bytes:
    """Encode marine_acoustic_msgs/ProjectedSonarImage."""
    beams = len(sample.beams)
    return encode(_SONAR, {
        "header": header(sample.time_ns, frame), "ping_info": _ping(sample, beams),
        "beam_directions": [{"y": sin(angle), "z": cos(angle)} for angle in sample.beams],
        "ranges": [sample.first_range + (i + 0.5) * sample.range_step for i in range(sample.bins)],
        "image": _echoes(sample.encoding, beams, sample.intensities),
    })  # fmt: skip


@tolerant
def decode_sonar(data: bytes) -> SonarImageSample:
    """Return the picture of a device with evenly spaced ranges."""
    message = read(_SONAR, data)
    ranges = message["ranges"]
    step = (ranges[-1] - ranges[0]) / (len(ranges) - 1) if len(ranges) > 1 else 0.0
    beams = tuple([atan2(direction["y"], direction["z"]) for direction in message["beam_directions"]])
    encoding, count, echoes = _read_echoes(message["image"])
    if count != len(beams) or len(echoes) != count * len(ranges) * (4 if encoding == "float32" else 1):
        raise MalformedError("not a picture of its size")
    first = ranges[0] - 0.5 * step if ranges else 0.0
    ping = _read_ping(message["ping_info"])
    return SonarImageSample(time_of(message), beams, len(ranges), first, step, *ping, encoding, echoes)


def encode_fan(sample: SonarImageSample, frame: str = "forward_sonar_link") -> bytes:
    """Encode sensor_msgs/Image of a sonar's picture as a fan, ahead upwards, port on the left, for displays."""
    from sim.sensors.imaging.fan_picture import SIZE, render_fan  # imports numpy

    grey = render_fan(sample, 2 * SIZE)
    return encode_image(Picture(sample.time_ns, grey.shape[1], grey.shape[0], "mono8", grey.tobytes()), frame)


def encode_side_scan(sample: SideScanSample, frame: str = "side_scan_link") -> bytes:
    """Encode marine_acoustic_msgs/RawSonarImage of two beams, port and starboard; the altitude is not sent.

    The beams' angles are about the sensor's x axis, from down to starboard.
    """
    code = "B" if sample.encoding == "uint8" else "f"
    samples = array(code, bytes(len(sample.port) + len(sample.starboard)))
    samples[0::2], samples[1::2] = array(code, sample.port), array(code, sample.starboard)
    port_and_starboard = -0.5 * pi, 0.5 * pi
    return encode(_SIDE_SCAN, {
        "header": header(sample.time_ns, frame), "ping_info": _ping(sample, 2),
        "sample_rate": 0.5 * sample.sound_speed / sample.range_step, "samples_per_beam": sample.bins,
        "tx_delays": (0.0, 0.0), "tx_angles": (0.0, 0.0), "rx_angles": port_and_starboard,
        "image": _echoes(sample.encoding, 2, samples.tobytes()),
    })  # fmt: skip


@tolerant
def decode_side_scan(data: bytes) -> SideScanSample:
    """Return the ping; its altitude is inf, as it is not sent."""
    message = read(_SIDE_SCAN, data)
    rate, bins = message["sample_rate"], message["samples_per_beam"]
    encoding, count, echoes = _read_echoes(message["image"])
    samples = array("B" if encoding == "uint8" else "f")
    if count != 2 or len(echoes) != 2 * bins * samples.itemsize or rate <= 0.0:
        raise MalformedError("not two sides of as many samples")
    samples.frombytes(echoes)
    sides = samples[0::2].tobytes(), samples[1::2].tobytes()
    ping = _read_ping(message["ping_info"])
    return SideScanSample(time_of(message), bins, 0.5 * ping[1] / rate, *ping, inf, encoding, *sides)


def _ping(sample: SonarImageSample | SideScanSample, beams: int) -> Message:
    """Return a PingInfo; the transmit beam has the height of a beam, the receive beam its width."""
    widths = {"tx_beamwidths": [sample.beam_height] * beams, "rx_beamwidths": [sample.beam_width] * beams}
    return {"frequency": sample.frequency, "sound_speed": sample.sound_speed, **widths}


def _read_ping(ping: Message) -> tuple[float, float, float, float]:
    """Return frequency (Hz), speed of sound (m/s), width and height (rad) of the first beam."""
    height, width = [ping[key][0] if ping[key] else 0.0 for key in ("tx_beamwidths", "rx_beamwidths")]
    return ping["frequency"], ping["sound_speed"], width, height


def _echoes(encoding: Encoding, beams: int, data: bytes) -> Message:
    """Return SonarImageData, little-endian."""
    return {"dtype": _TYPE_CODES[encoding], "beam_count": beams, "data": data}


def _read_echoes(image: Message) -> tuple[Encoding, int, bytes]:
    if image["is_bigendian"] or image["dtype"] not in _ENCODINGS:
        raise MalformedError("no numbers that are sent here")
    return _ENCODINGS[image["dtype"]], image["beam_count"], image["data"]


ENCODERS: dict[str, ros.Encoder] = {
    "camera": camera_messages,
    "forward_sonar": lambda sample, prefix, name="forward_sonar": [
        (f"{name}/image", encode_sonar(sample, f"{prefix}{name}_fan"))
    ],
    "side_scan": lambda sample, prefix, name="side_scan": [
        (f"{name}/image", encode_side_scan(sample, f"{prefix}{name}_link"))
    ],
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
    "forward_sonar/fan/image_raw": decode_image,
    "scanning_sonar/image": decode_sonar,
    "side_scan/image": decode_side_scan,
}

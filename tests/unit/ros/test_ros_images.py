"""Images, clouds and sonar messages of ROS 2, read by an independent library."""

import io
from array import array
from math import cos, inf, nan, pi, sin
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hil.ros import clouds as ros_clouds
from hil.ros import encoders as ros
from hil.ros import images as ros_images
from hil.ros import types
from hil.ros.topics import TOPICS
from hil.slave.ros.node import HEADS
from sim.rotations import rotate
from sim.sensors.imaging.samples import CameraSample, Intrinsics, SideScanSample, SonarImageSample

STORE: Any = get_typestore(Stores.ROS2_JAZZY)
_PACKAGE = "marine_acoustic_msgs/msg/"
_MARINE = [name for name in types.names() if name.startswith(_PACKAGE)]
STORE.register({k: v for name in _MARINE for k, v in get_types_from_msg(types.definition(name).text, name).items()})

WIDTH, HEIGHT = 48, 32
TIME = 7_000_000_009
LENS = (0.1, -0.2, 0.001, 0.002, 0.05)


def rgb() -> bytes:
    """Return a picture whose red grows to the right and green downwards; the upper left is black but for blue."""
    return bytes(c for v in range(HEIGHT) for u in range(WIDTH) for c in (5 * u, 7 * v, 40))


DEPTH = array("f", [1.0 + 0.01 * i for i in range(WIDTH * HEIGHT - 1)] + [inf]).tobytes()
LABELS = array("i", [i % 3 - 1 for i in range(WIDTH * HEIGHT)]).tobytes()
POINTS = array("f", [0.1 * i for i in range(3 * WIDTH * HEIGHT - 3)] + [nan] * 3).tobytes()  # ahead, right, down
CAMERA = CameraSample(TIME, WIDTH, HEIGHT, rgb(), DEPTH, LABELS, Intrinsics(50.0, 51.0, 23.5, 15.5), LENS)
BEAMS = (-0.5, 0.0, 0.25)
ECHOES = bytes(range(12))
SONAR = SonarImageSample(TIME, BEAMS, 4, 1.0, 0.5, 750e3, 1500.0, 0.02, 0.35, "uint8", ECHOES)
SIDES = SideScanSample(
    TIME, 4, 0.5, 445e3, 1500.0, 0.01, 0.8, 12.5, "uint8", bytes((1, 2, 3, 4)), bytes((101, 102, 103, 104))
)


def read(messages: ros.Encoded) -> dict[str, Any]:
    return {topic: STORE.deserialize_cdr(payload, TOPICS[topic].type) for topic, payload in messages}


def test_a_raw_image_comes_with_camera_info_depth_and_labels() -> None:
    messages = read(ros.encoder("camera")(CAMERA, "uuv1/"))
    assert set(messages) == {
        "camera/camera_info", "camera/image_raw", "camera/depth/camera_info", "camera/depth/image_raw", "camera/labels"
    }  # fmt: skip
    for message in messages.values():
        assert message.header.frame_id == "uuv1/camera_optical_frame"
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (7, 9)
        assert (message.height, message.width) == (HEIGHT, WIDTH)
    image = messages["camera/image_raw"]
    assert (image.encoding, image.step, image.is_bigendian) == ("rgb8", 3 * WIDTH, 0)
    pixels = image.data.reshape(HEIGHT, WIDTH, 3)
    assert pixels[10, 20].tolist() == [100, 70, 40]
    depth = messages["camera/depth/image_raw"]
    assert depth.encoding == "32FC1"
    assert depth.data.view("<f4").reshape(HEIGHT, WIDTH)[1, 2] == pytest.approx(1.5)
    assert depth.data.view("<f4")[-1] == inf
    assert messages["camera/labels"].data.view("<i4")[:3].tolist() == [-1, 0, 1]


def test_camera_info_has_the_lens_model() -> None:
    info = read(ros.encoder("camera")(CAMERA, ""))["camera/camera_info"]
    assert info.distortion_model == "plumb_bob"
    assert info.d.tolist() == list(LENS)
    assert info.k.tolist() == [50.0, 0.0, 23.5, 0.0, 51.0, 15.5, 0.0, 0.0, 1.0]
    assert info.r.tolist() == [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    assert info.p.reshape(3, 4)[:, :3].ravel().tolist() == info.k.tolist()
    assert info.p.reshape(3, 4)[:, 3].tolist() == [0.0, 0.0, 0.0]


def test_a_jpeg_image_shows_the_same_picture() -> None:
    found = read(ros_images.camera_messages(CAMERA._replace(depth=None, labels=None), "", "jpeg", 90))
    assert set(found) == {"camera/camera_info", "camera/image_raw/compressed"}
    message = found["camera/image_raw/compressed"]
    assert message.format == "jpeg"
    picture = Image.open(io.BytesIO(message.data.tobytes()))
    assert picture.size == (WIDTH, HEIGHT)
    for u, v in ((4, 4), (40, 4), (4, 28), (40, 28)):
        pixel = picture.getpixel((u, v))
        assert isinstance(pixel, tuple)
        assert all(abs(a - b) < 12 for a, b in zip(pixel, (5 * u, 7 * v, 40), strict=True))
    both = dict(ros_images.camera_messages(CAMERA, "", "both"))
    assert {"camera/image_raw", "camera/image_raw/compressed"} <= set(both)
    small, large = (len(ros_images.jpeg(CAMERA, quality)) for quality in (20, 95))
    assert small < large


def test_a_point_cloud_has_the_bytes_of_rosbags() -> None:
    """The bytes equal those of rosbags, with the fields and the colours of depth_image_proc."""
    payload = dict(ros.encoder("camera")(CAMERA._replace(points=POINTS), "uuv1/"))["camera/depth/points"]
    kind = TOPICS["camera/depth/points"].type
    cloud = STORE.deserialize_cdr(payload, kind)
    assert bytes(STORE.serialize_cdr(cloud, kind)) == payload
    assert cloud.header.frame_id == "uuv1/camera_optical_frame"
    assert (cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (7, 9)
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (HEIGHT, WIDTH, 16, 16 * WIDTH)
    assert (cloud.is_bigendian, cloud.is_dense) == (False, False)
    fields = [(field.name, field.offset, field.datatype, field.count) for field in cloud.fields]
    assert fields == [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("rgb", 12, 7, 1)]
    points = cloud.data.view("<f4").reshape(HEIGHT, WIDTH, 4)
    there = np.frombuffer(POINTS, np.float32).reshape(HEIGHT, WIDTH, 3)
    np.testing.assert_array_equal(points[..., :3], there[..., [1, 2, 0]])  # right, down, ahead
    colour = cloud.data.view("<u4").reshape(HEIGHT, WIDTH, 4)[..., 3]
    assert colour[10, 20] == 100 << 16 | 70 << 8 | 40
    assert ros_clouds.decode_cloud(payload) == ros_clouds.Cloud(TIME, WIDTH, HEIGHT, cloud.data.tobytes())


def test_a_point_cloud_with_other_fields_is_none() -> None:
    payload = ros_clouds.encode_cloud(ros_clouds.Cloud(TIME, 2, 1, bytes(32)))
    kind = TOPICS["camera/depth/points"].type
    others: tuple[dict[str, Any], ...] = (
        {"width": 3},
        {"is_bigendian": True},
        {"fields": []},
        {"point_step": 32},
        {"height": 2},
    )
    for changes in others:
        message = STORE.deserialize_cdr(payload, kind)
        for name, value in changes.items():
            setattr(message, name, value)
        assert ros_clouds.decode_cloud(bytes(STORE.serialize_cdr(message, kind))) is None


def test_a_sonar_image_has_its_beams_and_bins() -> None:
    image = read(ros.encoder("forward_sonar")(SONAR, "uuv1/"))["forward_sonar/image"]
    assert image.header.frame_id == "uuv1/forward_sonar_fan"
    assert image.ranges.tolist() == [1.25, 1.75, 2.25, 2.75]
    assert [(b.x, b.y, b.z) for b in image.beam_directions] == [(0.0, sin(a), cos(a)) for a in BEAMS]
    assert (image.image.dtype, image.image.beam_count, image.image.is_bigendian) == (0, 3, False)
    assert image.image.data.reshape(4, 3).tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]
    assert image.ping_info.frequency == 750e3
    assert image.ping_info.rx_beamwidths.tolist() == pytest.approx([0.02] * 3)


def test_a_sonar_fan_is_drawn_as_an_image() -> None:
    """The middle beam of three is ahead, upwards; the farthest bin at the top; black beyond the fan."""
    echoes = bytes((10, 20, 30)) * 3 + bytes((50, 250, 70))  # the last bin is the farthest
    message = STORE.deserialize_cdr(ros_images.encode_fan(SONAR._replace(intensities=echoes)), "sensor_msgs/msg/Image")
    assert (message.encoding, message.step, message.header.frame_id) == ("mono8", message.width, "forward_sonar_link")
    picture = message.data.reshape(message.height, message.width)
    middle = message.width // 2
    assert picture[5, middle] == 250
    assert picture[message.height // 2, middle] == 20
    assert picture[-1, middle] == 0, "nearer than the first bin"
    assert picture[5, 2] == 0, "beside the fan"
    ahead, port = 0.9 * cos(0.4), 0.9 * sin(0.4)
    half = message.height * (1.0 - ahead), middle - message.height * port
    assert picture[int(half[0]), int(half[1])] == 50


def test_a_side_scan_ping_has_its_two_sides() -> None:
    image = read(ros.encoder("side_scan")(SIDES, ""))["side_scan/image"]
    assert image.sample_rate == 1500.0, "half a metre there and back"
    assert image.samples_per_beam == 4
    assert image.image.data.reshape(4, 2).tolist() == [[1, 101], [2, 102], [3, 103], [4, 104]]
    assert image.rx_angles.tolist() == pytest.approx([-pi / 2, pi / 2])


@pytest.mark.parametrize(("name", "axes"), [
    ("camera", ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))),
    ("forward_sonar", ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0))),
    ("profiler", ((0.0, 0.0, -1.0), (0.0, -1.0, 0.0), (-1.0, 0.0, 0.0))),
])  # fmt: skip
def test_the_frames_of_the_messages_have_their_axes(name: str, axes: Any) -> None:
    """The frame's axes x, y and z have these directions in the sensor's FLU."""
    quaternion = HEADS[name][1]
    for axis, expected in zip(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), axes, strict=True):
        assert rotate(quaternion, axis) == pytest.approx(expected)


def test_images_and_sonars_survive_a_round_trip() -> None:
    found = dict(ros.encoder("camera")(CAMERA, ""))
    decoded = {topic: ros.decoder(topic)(payload) for topic, payload in found.items()}  # type: ignore[misc]
    assert decoded["camera/image_raw"] == ros_images.Picture(TIME, WIDTH, HEIGHT, "rgb8", CAMERA.rgb)
    assert decoded["camera/depth/image_raw"].data == DEPTH
    assert decoded["camera/camera_info"].intrinsics == CAMERA.intrinsics
    assert decoded["camera/camera_info"].distortion == LENS
    sonar = ros_images.decode_sonar(ros_images.encode_sonar(SONAR))
    assert sonar is not None
    assert sonar.beams == pytest.approx(BEAMS)
    assert (sonar.bins, sonar.first_range, sonar.range_step, sonar.intensities) == (4, 1.0, 0.5, ECHOES)
    assert (sonar.beam_width, sonar.beam_height) == pytest.approx((SONAR.beam_width, SONAR.beam_height))
    floats = SIDES._replace(encoding="float32", port=DEPTH[:16], starboard=DEPTH[16:32])
    for sample in (SIDES, floats):
        again = ros_images.decode_side_scan(ros_images.encode_side_scan(sample))
        assert again is not None
        assert (again.port, again.starboard, again.range_step) == (sample.port, sample.starboard, sample.range_step)
        assert (again.beam_width, again.beam_height) == pytest.approx((sample.beam_width, sample.beam_height))


@pytest.mark.parametrize("topic", list(ros_images.DECODERS))
def test_truncated_messages_are_malformed(topic: str) -> None:
    payloads = dict(ros_images.camera_messages(CAMERA._replace(points=POINTS), "", "both"))
    payloads |= dict(ros.encoder("forward_sonar")(SONAR, "")) | dict(ros.encoder("side_scan")(SIDES, ""))
    payloads |= {"forward_sonar/fan/image_raw": ros_images.encode_fan(SONAR)}
    payloads |= {"scanning_sonar/image": payloads["forward_sonar/image"]}
    data = payloads[topic]
    ends = [end for end in (*range(200), *range(200, len(data), 97), len(data) - 1) if end < len(data)]
    assert [ros_images.DECODERS[topic](data[:end]) for end in ends] == [None] * len(ends)

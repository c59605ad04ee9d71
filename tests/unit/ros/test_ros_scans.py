"""Scans as sensor_msgs/LaserScan, read by an independent library."""

from math import inf, nan, radians
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from hil.ros import encoders as ros
from hil.ros import scans as ros_scans
from hil.ros.topics import TOPICS
from sim.sensors.extra_samples import LaserSample, RangeSample
from sim.sensors.imaging.samples import EchoSample, SonarImageSample

STORE: Any = get_typestore(Stores.ROS2_JAZZY)
FLOATS = st.floats(-100.0, 100.0, width=32)
SCAN = LaserSample(7_000_000_009, radians(-30.0), radians(15.0), (1.0, 2.0, inf, -inf, 5.0), (0.5, 20.0))


def read(name: str, sample: Any) -> Any:
    topic, payload = next(iter(ros.encoder(name)(sample, "uuv1/")))
    assert topic == name
    return STORE.deserialize_cdr(payload, TOPICS[topic].type)


@pytest.mark.parametrize("name", ["laser", "scanning_sonar"])
def test_laser_scan_angles_increase_to_port(name: str) -> None:
    """A return at 30 deg to starboard is the first of the message, at -30 deg in FLU."""
    message = read(name, SCAN)
    assert message.header.frame_id == f"uuv1/{name}_link"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (7, 9)
    assert message.angle_min == pytest.approx(radians(-30.0))
    assert message.angle_max == pytest.approx(radians(30.0))
    assert list(message.ranges) == [5.0, -inf, inf, 2.0, 1.0]
    assert (message.range_min, message.range_max) == (0.5, 20.0)
    assert len(message.intensities) == 0


def test_a_profile_has_its_beams_in_order() -> None:
    message = read("profiler", SCAN)
    assert message.header.frame_id == "uuv1/profiler_scan"
    assert message.angle_min == pytest.approx(radians(-30.0))
    assert list(message.ranges) == list(SCAN.ranges)


def test_a_profile_is_a_point_cloud_with_strengths() -> None:
    """Points lie in "profiler_scan", x down and y to starboard; a beam without an echo is none."""
    sample = LaserSample(5, 0.0, radians(90.0), (4.0, inf, 2.0), (0.5, 20.0), (-27.0, nan, -20.0))
    messages = dict(ros.encoder("profiler")(sample, "uuv1/"))
    cloud = STORE.deserialize_cdr(messages["profiler/points"], TOPICS["profiler/points"].type)
    assert cloud.header.frame_id == "uuv1/profiler_scan"
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "intensity"]
    assert (cloud.height, cloud.width, cloud.point_step) == (1, 2, 16)
    points = cloud.data.view("<f4").reshape(-1, 4)
    assert points == pytest.approx(np.array([[4.0, 0.0, 0.0, -27.0], [-2.0, 0.0, 0.0, -20.0]]), abs=1e-6)
    decoder = ros.decoder("profiler/points")
    assert decoder is not None
    assert decoder(messages["profiler/points"]).points[1][3] == -20.0
    assert decoder(messages["profiler/points"][:-3]) is None
    scan = STORE.deserialize_cdr(messages["profiler"], TOPICS["profiler"].type)
    assert scan.intensities[0] == -27.0


def test_a_scanning_sonar_ping_is_an_image_of_one_beam() -> None:
    scan = LaserSample(0, 0.5, 0.01, (3.0,), (0.75, 50.0))
    echoes = SonarImageSample(0, (0.5,), 4, 0.75, 0.5, 750e3, 1500.0, 0.03, 0.4, "uint8", bytes((1, 2, 3, 4)))
    messages = dict(ros.encoder("scanning_sonar")(EchoSample(9, scan, echoes), "uuv1/"))
    assert set(messages) == {"scanning_sonar", "scanning_sonar/image"}
    found = ros_scans.decode_scan(messages["scanning_sonar"])
    assert found is not None
    assert (found.time_ns, found.ranges, found.angle_min) == (9, (3.0,), 0.5)
    decoder = ros.decoder("scanning_sonar/image")
    assert decoder is not None
    image = decoder(messages["scanning_sonar/image"])
    assert (image.time_ns, image.bins, image.intensities) == (9, 4, bytes((1, 2, 3, 4)))
    assert image.beams == pytest.approx((0.5,))


def test_an_echosounder_sample_is_a_range_message() -> None:
    sample = RangeSample(5, 7.5, (0.5, 50.0))
    assert read("echosounder", sample).range == 7.5
    ((_, payload),) = ros.encoder("echosounder")(sample, "")
    decoder = ros.decoder("echosounder")
    assert decoder is not None
    assert decoder(payload) == sample


@given(st.integers(0, 2**31 * 10**9 - 1), FLOATS, st.floats(0.0625, 1.0, width=32), st.lists(FLOATS, max_size=50))
def test_any_scan_has_the_bytes_of_rosbags_and_a_round_trip(
    time_ns: int, first: float, step: float, ranges: list[float]
) -> None:
    sample = LaserSample(time_ns, first, step, tuple(ranges), (0.5, 20.0))
    data = ros_scans.encode_profile(sample)
    message = STORE.deserialize_cdr(data, "sensor_msgs/msg/LaserScan")
    assert bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/LaserScan")) == data
    assert ros_scans.decode_profile(data) == sample
    again = ros_scans.decode_scan(ros_scans.encode_scan(sample))
    assert again is not None
    assert again.ranges == sample.ranges
    assert again.angle_min == pytest.approx(first, abs=1e-4)


@pytest.mark.parametrize("decode", [ros_scans.decode_scan, ros_scans.decode_profile])
def test_truncated_messages_are_malformed(decode: Any) -> None:
    data = ros_scans.encode_scan(SCAN)
    assert [decode(data[:end]) for end in range(len(data))] == [None] * len(data)

"""DVL messages: bytes of another implementation, and what is lost without bottom lock."""

import json
import math
import os
from typing import Any

import pytest

from hil.ros import dvl as ros_dvl
from hil.ros import encoders as ros
from hil.ros import message as ros_message
from hil.ros.topics import TOPICS
from sim.sensors.samples import DvlSample

with open(os.path.join(os.path.dirname(__file__), "..", "..", "vectors", "cdr_golden.json"), encoding="utf-8") as _file:
    GOLDEN = {message["type"]: bytes.fromhex(message["hex"]) for message in json.load(_file)["messages"]}

TIME_NS = 1_700_000_000_123_456_789
SAMPLE = DvlSample(TIME_NS, (0.5, 0.25, -0.125), 12.375, True)
LOST = DvlSample(TIME_NS, (math.nan,) * 3, math.nan, False)


def fields(topic: str, payload: bytes) -> dict[str, Any]:
    message = ros_message.decode(TOPICS[topic].type, payload)
    assert message is not None
    return message


def test_messages_have_the_golden_bytes() -> None:
    assert ros_dvl.encode_dvl(SAMPLE, variance=0.0625) == GOLDEN["marine_acoustic_msgs/msg/Dvl"]
    assert ros_dvl.decode_dvl(GOLDEN["marine_acoustic_msgs/msg/Dvl"]) == SAMPLE
    twist = GOLDEN["geometry_msgs/msg/TwistWithCovarianceStamped"]
    assert ros_dvl.encode_dvl_twist(SAMPLE, variance=0.0625) == twist
    decoded = ros_dvl.decode_dvl_twist(twist)
    assert decoded is not None
    assert math.isnan(decoded.altitude)
    assert decoded._replace(altitude=12.375) == SAMPLE


def test_altitude_is_a_range_message_with_the_golden_bytes() -> None:
    data = GOLDEN["sensor_msgs/msg/Range"]
    assert ros_dvl.encode_range(SAMPLE, limits=(0.5, 75.0), variance=0.0625) == data
    assert ros_dvl.decode_range(data) == (TIME_NS, 12.375)
    assert ros_dvl.decode_range(data[:-4]) == (TIME_NS, 12.375)  # Humble's has no variance


def test_the_dvl_message_is_in_transducer_axes_with_z_along_its_view() -> None:
    """A DVL that sinks and drifts to starboard reports both as positive in its own message, negative along FLU."""
    sample = SAMPLE._replace(velocity=(0.0, 0.3, 0.1))
    (_, own), (_, twist), _ = ros.encoder("dvl")(sample, "uuv1/")
    message = fields("dvl", own)
    assert message["velocity"] == {"x": 0.0, "y": 0.3, "z": 0.1}
    assert message["header"]["frame_id"] == "uuv1/dvl_transducer_link"
    assert message["course_gnd"] == pytest.approx(math.pi / 2)
    assert message["speed_gnd"] == pytest.approx(0.3)
    stamped = fields("dvl_twist", twist)
    assert stamped["twist"]["twist"]["linear"] == {"x": 0.0, "y": -0.3, "z": -0.1}
    assert stamped["header"]["frame_id"] == "uuv1/dvl_link"


def test_lost_bottom_lock_is_in_the_message() -> None:
    for encode, decode in (
        (ros_dvl.encode_dvl, ros_dvl.decode_dvl),
        (ros_dvl.encode_dvl_twist, ros_dvl.decode_dvl_twist),
    ):
        decoded = decode(encode(LOST, variance=0.01))
        assert decoded is not None
        assert not decoded.locked
    assert fields("dvl", ros_dvl.encode_dvl(LOST))["num_good_beams"] == 0
    assert ros_dvl.decode_range(ros_dvl.encode_range(LOST)) == (TIME_NS, math.inf)


def test_a_water_track_sample_has_its_own_topic_and_frame() -> None:
    sample = SAMPLE._replace(altitude=math.nan)
    ((topic, payload),) = ros.encoder("dvl_water")(sample, "")
    assert topic == "dvl_water"
    message = fields(topic, payload)
    assert (message["velocity_mode"], message["header"]["frame_id"]) == (2, "dvl_water_transducer_link")
    decoded = ros_dvl.decode_dvl(payload)
    assert decoded is not None
    assert decoded[:2] == sample[:2]
    assert decoded.locked


def test_an_unknown_variance_is_minus_one() -> None:
    assert fields("dvl", ros_dvl.encode_dvl(SAMPLE))["velocity_covar"] == (-1.0, 0, 0, 0, -1.0, 0, 0, 0, -1.0)

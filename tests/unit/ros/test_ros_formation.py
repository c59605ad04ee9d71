"""The report of a vehicle in a formation: ROS's definition, round trips, and invalid messages."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.ros import encoders as ros
from hil.ros import message as ros_message
from hil.ros.fleet import FormationSample, decode_formation, encode_formation
from hil.ros.topics import TOPICS

METRES = st.floats(-1e5, 1e5)
TYPE = "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"
SAMPLE = FormationSample((3.0, 4.0, 2.0), (1.0, 0.0, 0.0, 0.0), 12_345_678_901)


def test_a_report_is_encoded_in_enu_as_the_definition_states() -> None:
    """A position 3 north, 4 east and 2 deep is ENU (4, 3, -2); a bow to the north is a yaw of 90 degrees."""
    message = ros_message.decode(TYPE, encode_formation(SAMPLE))
    assert message is not None
    (transform,) = message["transforms"]
    assert transform["translation"] == {"x": 4.0, "y": 3.0, "z": -2.0}
    rotation = [transform["rotation"][axis] for axis in "wxyz"]
    assert rotation == pytest.approx([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
    assert (message["velocities"], message["accelerations"]) == ([], [])
    assert message["time_from_start"] == {"sec": 12, "nanosec": 345_678_901}
    assert TOPICS["formation"].type == TYPE
    assert ros.decoder("formation") is decode_formation


@given(st.tuples(METRES, METRES, METRES), st.floats(-math.pi, math.pi), st.integers(0, 10**15))
def test_a_report_survives_a_round_trip(position: tuple[float, float, float], heading: float, clock_ns: int) -> None:
    sample = FormationSample(position, (math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2)), clock_ns)
    decoded = decode_formation(encode_formation(sample))
    assert decoded is not None
    assert (decoded.position, decoded.clock_ns) == (position, clock_ns)
    assert decoded.orientation == pytest.approx(sample.orientation, abs=1e-12)


@pytest.mark.parametrize("cut", [0, 3, 4, 20, 79])
def test_a_truncated_report_is_none(cut: int) -> None:
    assert decode_formation(encode_formation(SAMPLE)[:cut]) is None


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_report_with_non_finite_numbers_is_none(value: float) -> None:
    assert decode_formation(encode_formation(SAMPLE._replace(position=(value, 0.0, 0.0)))) is None


def test_a_report_with_two_transforms_is_none() -> None:
    data = bytearray(encode_formation(SAMPLE))
    data[4:8] = struct.pack("<I", 2)
    assert decode_formation(bytes(data)) is None

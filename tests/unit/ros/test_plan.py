"""The planned path as nav_msgs/Path."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.ros import message as ros_message
from hil.ros.plan import MAX_POINTS, TYPE, decode_plan, encode_plan

POINTS = st.tuples(*[st.floats(-1e4, 1e4)] * 3)


@given(st.lists(POINTS, max_size=20))
def test_a_path_survives_a_round_trip(path: list[tuple[float, float, float]]) -> None:
    assert decode_plan(encode_plan(0, path, 2.0)) == tuple(path)


def test_horizontal_points_get_the_depth_in_the_axes_of_ros() -> None:
    data = encode_plan(1_500_000_000, [(1.0, 2.0), (3.0, 4.0)], 5.0)
    assert decode_plan(data) == ((1.0, 2.0, 5.0), (3.0, 4.0, 5.0))
    message = ros_message.decode(TYPE, data)
    assert message
    assert message["header"] == {"stamp": {"sec": 1, "nanosec": 500_000_000}, "frame_id": "map"}
    assert message["poses"][0]["pose"]["position"] == {"x": 2.0, "y": 1.0, "z": -5.0}


def test_a_long_path_is_subsampled_and_keeps_its_end() -> None:
    path = [(float(number), 0.0) for number in range(3 * MAX_POINTS)]
    positions = decode_plan(encode_plan(0, path, 1.0))
    assert positions
    assert len(positions) <= MAX_POINTS
    assert (positions[0][0], positions[-1][0]) == (0.0, path[-1][0])


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0", encode_plan(0, [(1.0, 2.0)], 3.0)[:-3]])
def test_malformed_paths_are_none(data: bytes) -> None:
    assert decode_plan(data) is None

"""Thrusts as sensor_msgs/JointState, compared with the codec that works by the definition."""

from hypothesis import given
from hypothesis import strategies as st

from hil.ros import message
from hil.ros.joints import (
    JointStates,
    MotorState,
    decode_joints,
    decode_motors,
    encode_joints,
    encode_motors,
    joint_states,
)
from sim.vehicle.vehicle import load_vehicle

NAME = st.text(st.characters(min_codepoint=33, max_codepoint=0x2FF), max_size=20)


@given(st.lists(st.tuples(NAME, st.floats(allow_nan=False)), max_size=8), st.integers(0, 2**31 * 10**9 - 1))
def test_a_message_has_the_bytes_of_the_definition_and_a_round_trip(
    joints: list[tuple[str, float]], time_ns: int
) -> None:
    states = JointStates(time_ns, tuple(name for name, _ in joints), tuple(effort for _, effort in joints))
    payload = encode_joints(states)
    assert decode_joints(payload) == states
    fields = message.decode("sensor_msgs/msg/JointState", payload)
    assert fields is not None
    assert fields["name"] == list(states.names)
    assert fields["effort"] == states.efforts
    assert message.encode("sensor_msgs/msg/JointState", fields) == payload


@given(st.lists(st.builds(MotorState, *[st.floats(allow_nan=False)] * 3), max_size=12))
def test_motor_values_survive_a_round_trip_with_their_column_names(motors: list[MotorState]) -> None:
    payload = encode_motors(motors)
    assert decode_motors(payload) == tuple(motors)
    fields = message.decode("std_msgs/msg/Float64MultiArray", payload)
    assert fields is not None
    assert [row["label"] for row in fields["layout"]["dim"]] == ["channel", "pulse_us,speed,current"]
    assert [row["size"] for row in fields["layout"]["dim"]] == [len(motors), 3]


def test_motor_messages_with_an_incomplete_row_are_malformed() -> None:
    payload = encode_motors([MotorState(1600.0, 100.0, 2.0)])
    assert all(decode_motors(payload[:length]) is None for length in range(len(payload)))
    layout = {"dim": [], "data_offset": 0}
    assert (
        decode_motors(message.encode("std_msgs/msg/Float64MultiArray", {"layout": layout, "data": [1.0] * 4})) is None
    )


def test_truncated_and_inconsistent_messages_are_malformed() -> None:
    payload = encode_joints(JointStates(1, ("a", "b"), (1.0, 2.0)))
    assert all(decode_joints(payload[:length]) is None for length in range(len(payload)))
    for fields in ({"effort": (1.0, 2.0)}, {"effort": (1.0,), "position": (1.0, 2.0)}):
        assert decode_joints(message.encode("sensor_msgs/msg/JointState", {"name": ["a"], **fields})) is None


def test_thrusters_come_first_then_fins_with_their_deflections() -> None:
    vehicle = load_vehicle("remus100")[0]
    states = joint_states(7, vehicle, (12.5,), (0.1, -0.2))
    assert states == JointStates(7, ("propeller", "rudder", "stern planes"), (12.5, 0.0, 0.0), (0.0, 0.1, -0.2))
    assert decode_joints(encode_joints(states)) == states

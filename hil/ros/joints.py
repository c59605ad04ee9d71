"""Encode and decode sensor_msgs/JointState: the thrust of each thruster."""

from typing import NamedTuple

from hil.ros.cdr import MalformedError, tolerant
from hil.ros.encoders import Decoder, Encoder
from hil.ros.message import encode, header, read, time_of

_TYPE = "sensor_msgs/msg/JointState"


class JointStates(NamedTuple):
    """Thrusters by their `names` in the vehicle's file; `efforts` are their thrusts (N), positive along their axes."""

    time_ns: int
    names: tuple[str, ...]
    efforts: tuple[float, ...]


def encode_joints(states: JointStates) -> bytes:
    """sensor_msgs/JointState of no frame, without positions and velocities."""
    return encode(_TYPE, {"header": header(states.time_ns), "name": states.names, "effort": states.efforts})


@tolerant
def decode_joints(data: bytes) -> JointStates:
    """Return the joints of a message. One whose names and efforts differ in number counts as malformed."""
    message = read(_TYPE, data)
    if len(message["effort"]) != len(message["name"]):
        raise MalformedError("not an effort for each joint")
    return JointStates(time_of(message), tuple(message["name"]), message["effort"])


ENCODERS: dict[str, Encoder] = {}  # no sensor sends them
DECODERS: dict[str, Decoder] = {"joint_states": decode_joints}

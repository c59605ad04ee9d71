"""What the vehicles of a fleet send each other: reports in a formation, and messages by modem.

A report has a vehicle's estimated position, and its progress in the plan. It is a
trajectory_msgs/MultiDOFJointTrajectoryPoint with one transform, the pose, and the time since the plan's start.

Messages to and from a modem are std_msgs/UInt8MultiArray with one dimension, whose label is the sender. `modem_tx` has
messages for a vehicle's modem to send, `modem_rx` those it received. `modem_range` (sensor_msgs/Range) is the distance
to the sender of the last message received, which its frame names. `modem_position` is the position of the vehicle that
its frame names, relative to this one, measured by USBL (east, north, up).
"""

from math import isfinite
from typing import NamedTuple

from hil.common.vectors import Quaternion, Vector3
from hil.ros.cdr import HEADER, Layout, MalformedError, tolerant
from hil.ros.encoders import Decoder, swap_attitude, swap_world
from hil.ros.message import encode, read
from hil.ros.sensors import decode_distance, decode_position, encode_distance, encode_position
from sim.sensors.extra_samples import PositionSample, RangeSample

_NS_PER_S = 1_000_000_000
_TYPE = "std_msgs/msg/UInt8MultiArray"
_POINT = Layout("I 7d I I i I")  # one transform, no velocities, no accelerations


class FormationSample(NamedTuple):
    """A vehicle's own estimate of its position (m, NED) and attitude (FRD in NED), and its time in the plan (ns)."""

    position: Vector3
    orientation: Quaternion
    clock_ns: int


def encode_formation(sample: FormationSample) -> bytes:
    """Encode trajectory_msgs/MultiDOFJointTrajectoryPoint; the transform is the pose of FLU in ENU."""
    w, x, y, z = swap_attitude(sample.orientation)
    elapsed = divmod(sample.clock_ns, _NS_PER_S)
    return _POINT.struct().pack(HEADER, 1, *swap_world(sample.position), x, y, z, w, 0, 0, *elapsed)


@tolerant
def decode_formation(data: bytes) -> FormationSample:
    """Return the sample in NED and FRD. More than one transform, or values not finite, count as malformed."""
    _, transforms, east, north, up, x, y, z, w, velocities, accelerations, seconds, ns = _POINT.unpack(data)
    if (transforms, velocities, accelerations) != (1, 0, 0) or not all(map(isfinite, (east, north, up, x, y, z, w))):
        raise MalformedError("not the place of one vehicle")
    return FormationSample(swap_world((east, north, up)), swap_attitude((w, x, y, z)), seconds * _NS_PER_S + ns)


class Message(NamedTuple):
    """Sender and payload of a message."""

    sender: str
    payload: bytes


def encode_message(message: Message) -> bytes:
    """Encode std_msgs/UInt8MultiArray of one dimension."""
    size = len(message.payload)
    dimension = {"label": message.sender, "size": size, "stride": size}
    return encode(_TYPE, {"layout": {"dim": [dimension]}, "data": message.payload})


@tolerant
def decode_message(data: bytes) -> Message:
    """Return sender and payload; another number of dimensions counts as malformed."""
    message = read(_TYPE, data)
    dimensions = message["layout"]["dim"]
    if len(dimensions) != 1:
        raise MalformedError("not one dimension")
    return Message(dimensions[0]["label"], message["data"])


def encode_range(time_ns: int, sender: str, distance: float, reach: float) -> bytes:
    """Encode sensor_msgs/Range: `distance` (m) to `sender`; the limits are 0 and `reach` (m)."""
    return encode_distance(RangeSample(time_ns, distance, (0.0, reach)), sender)


def encode_place(sample: PositionSample, sender: str) -> bytes:
    """Encode geometry_msgs/PoseWithCovarianceStamped: the position of `sender` from the receiver (m, NED)."""
    return encode_position(sample, sender)


DECODERS: dict[str, Decoder] = {
    "formation": decode_formation,
    "modem_tx": decode_message,
    "modem_rx": decode_message,
    "modem_range": decode_distance,
    "modem_position": decode_position,
}

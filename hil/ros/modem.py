"""Messages to and from a modem: std_msgs/UInt8MultiArray with one dimension, whose label is the sender.

`modem_tx` has messages for a vehicle's modem to send, `modem_rx` those it received. `modem_range` (sensor_msgs/Range)
is the distance to the sender of the last message received, which its frame names.
"""

from typing import NamedTuple

from hil.ros.cdr import MalformedError, tolerant
from hil.ros.encoders import Decoder
from hil.ros.message import encode, read
from hil.ros.sensors import decode_distance, encode_distance
from sim.sensors.extra_samples import RangeSample

_TYPE = "std_msgs/msg/UInt8MultiArray"


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


DECODERS: dict[str, Decoder] = {
    "modem_tx": decode_message,
    "modem_rx": decode_message,
    "modem_range": decode_distance,
}

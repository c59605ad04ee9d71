"""Messages to and from a modem: std_msgs/UInt8MultiArray, whose one dimension is labelled by the sender.

`modem_tx` is what a vehicle gives its modem, `modem_rx` what that has heard; `modem_range` (sensor_msgs/Range) how far
the sender of the last message heard is, as the frame's name says.
"""

from typing import NamedTuple

from hil.ros.cdr import MalformedError, Reader, Writer, tolerant
from hil.ros.encoders import Decoder, Encoder
from hil.ros.sensors import decode_distance, encode_distance
from sim.sensors.extra_samples import RangeSample


class Message(NamedTuple):
    """Sender and payload of a message."""

    sender: str
    payload: bytes


def encode_message(message: Message) -> bytes:
    """std_msgs/UInt8MultiArray of one dimension."""
    size = len(message.payload)
    writer = Writer()
    writer.numbers("I", 1)
    writer.string(message.sender)
    writer.numbers("I", size, size, 0, size)
    writer.raw(message.payload)
    return bytes(writer.data)


@tolerant
def decode_message(data: bytes) -> Message:
    """Sender and payload. Another number of dimensions counts as malformed."""
    reader = Reader(data)
    if reader.count() != 1:
        raise MalformedError("not one dimension")
    sender = reader.string()
    reader.numbers("I", 3)
    return Message(sender, reader.raw(reader.count()))


def encode_range(time_ns: int, sender: str, distance: float, reach: float) -> bytes:
    """sensor_msgs/Range: `distance` (m) to `sender`, from 0 to `reach`."""
    return encode_distance(RangeSample(time_ns, distance, (0.0, reach)), sender)


ENCODERS: dict[str, Encoder] = {}  # no sensor sends them
DECODERS: dict[str, Decoder] = {
    "modem_tx": decode_message,
    "modem_rx": decode_message,
    "modem_range": decode_distance,
}

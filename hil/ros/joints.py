"""Encode and decode sensor_msgs/JointState: the thrust of each thruster."""

from typing import NamedTuple

from hil.ros.cdr import MalformedError, Reader, Writer, tolerant
from hil.ros.encoders import Decoder, Encoder

_NS_PER_S = 1_000_000_000


class JointStates(NamedTuple):
    """Thrusters by their `names` in the vehicle's file; `efforts` are their thrusts (N), positive along their axes."""

    time_ns: int
    names: tuple[str, ...]
    efforts: tuple[float, ...]


def encode_joints(states: JointStates) -> bytes:
    """sensor_msgs/JointState without positions and velocities."""
    writer = Writer()
    seconds, nanoseconds = divmod(states.time_ns, _NS_PER_S)
    writer.numbers("i", seconds)
    writer.numbers("I", nanoseconds)
    writer.string("")  # of no frame
    writer.numbers("I", len(states.names))
    for name in states.names:
        writer.string(name)
    writer.numbers("I", 0, 0, len(states.efforts))
    writer.numbers("d", *states.efforts)
    return bytes(writer.data)


@tolerant
def decode_joints(data: bytes) -> JointStates:
    """Return the joints of a message. One whose names and efforts differ in number counts as malformed."""
    reader = Reader(data)
    (seconds,), (nanoseconds,) = reader.numbers("i"), reader.numbers("I")
    reader.string()
    names = tuple([reader.string() for _ in range(reader.count())])
    for _ in ("position", "velocity"):
        reader.numbers("d", reader.count())
    efforts = tuple(reader.numbers("d", reader.count()))
    if len(efforts) != len(names):
        raise MalformedError("not an effort for each joint")
    return JointStates(seconds * _NS_PER_S + nanoseconds, names, efforts)


ENCODERS: dict[str, Encoder] = {}  # no sensor sends them
DECODERS: dict[str, Decoder] = {"joint_states": decode_joints}

"""What is in a file of a recording: its messages, topics of its own, and types and QoS as in recordings of rosbag2."""

from typing import NamedTuple

from hil.common.errors import ConfigError
from hil.ros.topics import TOPICS, Qos, Topic

# Only in recordings: the number of a step, and the pulses (us, one per channel) from that step on.
PULSES = Topic("pulses", "std_msgs/msg/Int64MultiArray", 0, "data")
# Only in recordings: the number of a step, and the epoch (ns since 1970) of stamps from that step on.
EPOCHS = Topic("epochs", "std_msgs/msg/Int64MultiArray", 0, "data")
# Only in recordings: the wall clock minus the log times (ns) from then on, after the clock was set.
CLOCK_SHIFT = Topic("clock_shift", "std_msgs/msg/Int64MultiArray", 0, "data")


class Message(NamedTuple):
    """One message on a topic ("/uuv1/imu"): `data` in CDR, its publisher's sequence number, and two wall times (ns).

    `published_ns` is when it was sent, by the sender's clock, which may be wrong. `logged_ns` is when the recorder
    received it; in a recording by the clock as it was at the start, so that it never jumps (see `CLOCK_SHIFT`).
    """

    topic: str
    type: str
    sequence: int
    published_ns: int
    logged_ns: int
    data: bytes


class TopicCount(NamedTuple):
    """Number of messages of a topic."""

    topic: str
    type: str
    messages: int


class FileSummary(NamedTuple):
    """Summary of a file: path, size in bytes, times of the first and last message (ns since 1970; 0: none), topics."""

    path: str
    size: int
    first_ns: int
    last_ns: int
    topics: tuple[TopicCount, ...]


def schema_of(kind: str) -> tuple[str, bytes]:
    """Return encoding and text of a type's definition; both are empty for an unknown type."""
    from hil.ros import types

    try:
        return "ros2msg", types.full_text(kind).encode()
    except ConfigError:
        return "", b""


def qos_profile(topic: str) -> str:
    """Return the QoS with which rosbag2 offers `topic` in playback, by the numbers of rmw/types.h.

    An unknown topic has the default QoS.
    """
    known = TOPICS.get(topic.rpartition("/")[2]) or TOPICS.get(topic)
    qos = known.qos if known else Qos()
    never = "{sec: 9223372036, nsec: 854775807}"
    return (
        f"- history: 1\n  depth: {qos.depth}\n  reliability: {1 if qos.reliable else 2}\n"
        f"  durability: {1 if qos.latched else 2}\n  deadline: {never}\n  lifespan: {never}\n  liveliness: 1\n"
        f"  liveliness_lease_duration: {never}\n  avoid_ros_namespace_conventions: false\n"
    )

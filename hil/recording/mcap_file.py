"""Write an MCAP file that is valid after every flush, also when power is lost.

An MCAP file ends with an index, so a file whose writer was killed has no end, and most readers refuse it. Here each
flush also writes the shortest valid end, "no index" in 50 bytes, in the same system call. The next flush overwrites
it, and only `close` writes the index. Schemas are "ros2msg" and messages "cdr", as in recordings of rosbag2.
"""

from typing import NamedTuple

from hil.common import __version__
from hil.common.errors import ConfigError
from hil.recording.mcap_writer import SHORTEST_END, McapWriter, Stream
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


class RecordingFile:
    """Writes messages to a new file at `path`, with `about` and `attachments` (name -> text) at its beginning.

    `compression` is "zstd", "lz4" or "none". Raises MissingExtraError, and OSError as `open` does.
    """

    def __init__(self, path: str, about: dict[str, str], attachments: dict[str, str], compression: str) -> None:
        self.path = path
        self._stream = Stream(path)
        self._writer = McapWriter(self._stream, f"uuv-hil {__version__}", compression)
        self._writer.add_metadata("uuv_hil", about)
        for name, text in attachments.items():
            self._writer.add_attachment(name, "application/toml", text.encode())
        self._stream.commit(SHORTEST_END)

    @property
    def size(self) -> int:
        """Number of bytes so far, without the unfinished chunk."""
        return self._stream.total

    @property
    def topics(self) -> int:
        """Number of topics so far."""
        return len(self._writer.channels)

    def write(self, message: Message) -> None:
        """Add a message. It is on disk after the next `flush`."""
        topic, kind, sequence, published_ns, logged_ns, data = message
        channel = self._writer.channels.get(topic)
        if channel is None:
            about = {"offered_qos_profiles": qos_profile(topic)}
            channel = self._writer.add_channel(topic, kind, schema_of(kind), about)
        self._writer.add_message(channel, sequence, published_ns, logged_ns, data)

    def add_topic(self, topic: str, kind: str, schema: tuple[str, bytes], encoding: str) -> None:
        """Add a topic whose messages are not in CDR, before its first message."""
        self._writer.add_channel(topic, kind, schema, {}, encoding)

    def flush(self) -> None:
        """Write all messages to disk, and wait until they are there. Raises OSError; the file stays valid."""
        self._writer.end_chunk()
        self._stream.commit(SHORTEST_END)
        self._stream.sync()

    def close(self) -> FileSummary:
        """Write the index and close. If it raises OSError, the file is closed, and valid up to the last flush."""
        try:
            self._writer.finish()
            self._stream.commit(b"")
            self._stream.sync()
        finally:
            self._stream.close()
        return self.summary()

    def abandon(self) -> None:
        """Close without an index, as the last flush left it."""
        self._stream.close()

    def summary(self) -> FileSummary:
        """Return the summary of the file so far."""
        writer = self._writer
        topics = tuple([TopicCount(each.topic, each.type, each.count) for each in writer.channels.values()])
        return FileSummary(self.path, self._stream.size, writer.first_ns, writer.last_ns, topics)


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

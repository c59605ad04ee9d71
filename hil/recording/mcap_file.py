"""Write an MCAP file that is valid after every flush, also when power is lost.

An MCAP file ends with an index of where everything is, so a file whose writer was killed has no end and most
readers refuse it. Here each flush also writes the shortest end there is, "no index, 50 bytes", in the same system
call; the next flush overwrites it, and only `close` writes the index. Schemas are "ros2msg" and messages "cdr", as
rosbag2's own recorder has them.
"""

import os
from typing import NamedTuple

from hil.common import __version__
from hil.common.errors import ConfigError
from hil.recording.mcap_writer import SHORTEST_END, McapWriter
from hil.ros.topics import TOPICS, Qos, Topic

# Only in recordings: the number of a step, and the pulses (us, one a channel) from that step on.
PULSES = Topic("pulses", "std_msgs/msg/Int64MultiArray", 0, "data")
# From which step on stamps count simulation time from which instant (ns since 1970).
EPOCHS = Topic("epochs", "std_msgs/msg/Int64MultiArray", 0, "data")

BINARY: int = getattr(os, "O_BINARY", 0)  # Windows' files would be texts
_to_disk = getattr(os, "fdatasync", os.fsync)  # Linux'


class Message(NamedTuple):
    """One message on a topic ("/uuv1/imu"): `data` in CDR, its number from its publisher, and two wall instants (ns).

    `published_ns` is when it was sent, by the sender's clock, which may be anywhere; `logged_ns` when it came to the
    recorder.
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
    """Summary of a file: the instants of its first and last message (ns since 1970; 0 and 0: none)."""

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
        self._stream = _Stream(path)
        self._writer = McapWriter(self._stream, f"uuv-hil {__version__}", compression)
        self._writer.add_metadata("uuv_hil", about)
        for name, text in attachments.items():
            self._writer.add_attachment(name, "application/toml", text.encode())
        self._stream.commit(SHORTEST_END)

    @property
    def size(self) -> int:
        """Bytes so far, without the chunk in the making."""
        return self._stream.total

    @property
    def topics(self) -> int:
        """Topics with their message counts so far."""
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
        """Put all that was written on disk, and wait until it is there. Raises OSError; the file stays whole."""
        self._writer.end_chunk()
        self._stream.commit(SHORTEST_END)
        self._stream.sync()

    def close(self) -> FileSummary:
        """Write the index and close. Raises OSError; the file is closed, and whole up to the last flush."""
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
        """Return what the file holds so far."""
        writer = self._writer
        topics = tuple([TopicCount(each.topic, each.type, each.count) for each in writer.channels.values()])
        return FileSummary(self.path, self._stream.size, writer.first_ns, writer.last_ns, topics)


def schema_of(kind: str) -> tuple[str, bytes]:
    """Return encoding and text of a type's definition; none for a type of others that we do not know."""
    from hil.ros import types

    try:
        return "ros2msg", types.full_text(kind).encode()
    except ConfigError:
        return "", b""


def qos_profile(topic: str) -> str:
    """Return the QoS with which rosbag2 offers `topic` in playback, by the numbers of rmw/types.h.

    Topics that are not ours have the default.
    """
    known = TOPICS.get(topic.rpartition("/")[2]) or TOPICS.get(topic)
    qos = known.qos if known else Qos()
    never = "{sec: 9223372036, nsec: 854775807}"
    return (
        f"- history: 1\n  depth: {qos.depth}\n  reliability: {1 if qos.reliable else 2}\n"
        f"  durability: {1 if qos.latched else 2}\n  deadline: {never}\n  lifespan: {never}\n  liveliness: 1\n"
        f"  liveliness_lease_duration: {never}\n  avoid_ros_namespace_conventions: false\n"
    )


class _Stream:
    """Buffer of what the library writes, until `commit` writes it at once, with an end behind it."""

    def __init__(self, path: str) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | BINARY, 0o644)
        self._pending = bytearray()
        self.size = 0  # of what is on disk, without the end
        self.total = 0  # with what is pending

    def write(self, data: bytes) -> None:
        self._pending += data
        self.total += len(data)

    def tell(self) -> int:
        return self.total

    def commit(self, end: bytes) -> None:
        """Write what is pending and `end`. Raises OSError: then what was there before is whole again."""
        try:
            _write_all(self._descriptor, bytes(self._pending) + end, self.size)
        except OSError:
            if self.size:
                os.ftruncate(self._descriptor, self.size)
                _write_all(self._descriptor, SHORTEST_END, self.size)
            raise
        self.size += len(self._pending)
        self._pending.clear()

    def sync(self) -> None:
        _to_disk(self._descriptor)

    def close(self) -> None:
        os.close(self._descriptor)


def _write_all(descriptor: int, data: bytes, at: int) -> None:
    """Write all bytes, usually by one system call; a disk that fills up takes a part, then raises."""
    view = memoryview(data)
    while view:
        os.lseek(descriptor, at, os.SEEK_SET)  # Windows has no pwrite
        written = os.write(descriptor, view)
        view, at = view[written:], at + written

"""Write a file of MCAP (https://mcap.dev/spec) that is valid after every flush, also when power is lost.

An MCAP file ends with an index, so a file whose writer was killed has no end, and most readers refuse it. Here each
flush also writes the shortest valid end, "no index" in 50 bytes, in the same system call. The next flush overwrites
it, and only `close` writes the index.

This module packs the messages into chunks, which is done thousands of times a second, in a third of the time that the
library takes. That writes every other record.
"""

import os
from collections.abc import Callable, Iterator
from struct import Struct, pack
from typing import Any
from zlib import crc32

from hil.common import __version__
from hil.common.errors import MissingExtraError
from hil.recording.mcap_file import FileSummary, Message, TopicCount, qos_profile, schema_of

CHUNK = 65536  # bytes before compression; a flush ends the current chunk early
MAGIC = b"\x89MCAP0\r\n"
SHORTEST_END = pack("<BQI", 0x0F, 4, 0) + pack("<BQQQI", 0x02, 20, 0, 0, 0) + MAGIC  # no index

BINARY: int = getattr(os, "O_BINARY", 0)  # without it Windows opens files in text mode
_to_disk = getattr(os, "fdatasync", os.fsync)  # fdatasync is faster, and only on Linux

_MESSAGE = Struct("<BQHIQQ")  # 5, length, channel, sequence, log time, publish time
_MESSAGE_FIELDS = 22  # bytes of these fields that the length includes
_RECORD = Struct("<BQ")  # opcode, length
_CHUNK_HEAD = Struct(
    "<QQQ4xI"
)  # first and last log time, uncompressed size, checksum, length of the compression's name
_CHUNK_RECORD, _INDEX_RECORD = 6, 7
_WINDOW = 65536  # bytes of the file that are read at once to make the index
_INDEX = Struct("<BQHI")  # 7, length, channel, bytes of the entries, which are log time and offset in the chunk


class Stream:
    """Buffer of the bytes that a writer makes. `commit` writes them to a new file at once, followed by an end."""

    def __init__(self, path: str) -> None:
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | BINARY, 0o644)
        self._pending = bytearray()
        self.size = 0  # bytes on disk, without the end
        self.total = 0  # bytes on disk and in the buffer

    def write(self, data: bytes) -> None:
        """Append bytes."""
        self._pending += data
        self.total += len(data)

    def read(self, at: int, size: int) -> bytes:
        """Return up to `size` bytes of what is in the file, from the offset `at` on. Raises OSError."""
        os.lseek(self._descriptor, at, os.SEEK_SET)  # Windows has no pread
        return os.read(self._descriptor, size)

    def commit(self, end: bytes) -> None:
        """Write the buffer and `end`. If it raises OSError, the file is as before this call."""
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
        """Wait until the file is on the disk. Raises OSError."""
        _to_disk(self._descriptor)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)


def _write_all(descriptor: int, data: bytes, at: int) -> None:
    """Write all bytes, usually by one system call. On a full disk a part is written before it raises OSError."""
    view = memoryview(data)
    while view:
        os.lseek(descriptor, at, os.SEEK_SET)  # Windows has no pwrite
        written = os.write(descriptor, view)
        view, at = view[written:], at + written


class Channel:
    """One topic: its number, its count of messages in the file, and log time and offset of those in the open chunk."""

    __slots__ = ("count", "entries", "number", "topic", "type")

    def __init__(self, number: int, topic: str, kind: str) -> None:
        self.number = number
        self.topic = topic
        self.type = kind
        self.count = 0
        self.entries: list[int] = []


class RecordingFile:
    """Writes messages to a new file at `path`, with `about` and `attachments` (name -> text) at its beginning.

    `compression` is "zstd", "lz4" or "none". Raises MissingExtraError, and OSError as `open` does.
    """

    def __init__(self, path: str, about: dict[str, str], attachments: dict[str, str], compression: str) -> None:
        require_library()
        from mcap import records
        from mcap.data_stream import RecordBuilder

        self.path = path
        self._records: Any = records
        self._new_builder: Any = RecordBuilder
        self._compression = "" if compression == "none" else compression
        self._compress = _compressor(compression)
        self._stream = Stream(path)
        self._chunk = bytearray()
        self._chunk_channels: list[Channel] = []  # the channels with messages in the chunk
        self._chunks = 0
        self._attachments: list[Any] = []  # indexes of them
        self._schemas: dict[str, Any] = {}
        self._channels: dict[str, Channel] = {}
        self._channel_records: list[Any] = []
        self._first_ns = self._last_ns = 0  # log times of the first and last message, 0 before there is one
        self._stream.write(MAGIC)
        self._write(records.Header(profile="ros2", library=f"uuv-hil {__version__}"))
        at = self._stream.total
        length = self._write(records.Metadata(name="uuv_hil", metadata=about))
        self._metadata = records.MetadataIndex(offset=at, length=length, name="uuv_hil")
        for name, text in attachments.items():
            at, data, kind = self._stream.total, text.encode(), "application/toml"
            length = self._write(records.Attachment(0, 0, name, kind, data))
            index = records.AttachmentIndex(
                offset=at, length=length, log_time=0, create_time=0, data_size=len(data), name=name, media_type=kind
            )
            self._attachments.append(index)
        self._stream.commit(SHORTEST_END)

    @property
    def size(self) -> int:
        """Number of bytes so far, without the unfinished chunk."""
        return self._stream.total

    @property
    def topics(self) -> int:
        """Number of topics so far."""
        return len(self._channels)

    def add_topic(self, topic: str, kind: str, schema: tuple[str, bytes], encoding: str, **about: str) -> Channel:
        """Add and return a topic whose messages have `encoding`; `schema` is encoding and text of its definition."""
        records = self._records
        if kind not in self._schemas:
            language, data = schema
            self._schemas[kind] = records.Schema(id=len(self._schemas) + 1, data=data, encoding=language, name=kind)
            self._chunk += self._bytes(self._schemas[kind])
        channel = self._channels[topic] = Channel(len(self._channels) + 1, topic, kind)
        record = records.Channel(
            id=channel.number, topic=topic, message_encoding=encoding, metadata=about, schema_id=self._schemas[kind].id
        )
        self._channel_records.append(record)
        self._chunk += self._bytes(record)
        return channel

    def write(self, message: Message) -> None:
        """Add a message. It is on disk after the next `flush`. A time before 1970 is stored as 0."""
        topic, kind, sequence, published_ns, logged_ns, data = message
        channel = self._channels.get(topic)
        if channel is None:
            channel = self.add_topic(topic, kind, schema_of(kind), "cdr", offered_qos_profiles=qos_profile(topic))
        chunk, entries = self._chunk, channel.entries
        if not entries:
            self._chunk_channels.append(channel)
        entries += logged_ns, len(chunk)
        chunk += _MESSAGE.pack(
            5, _MESSAGE_FIELDS + len(data), channel.number, sequence & 0xFFFFFFFF, logged_ns, max(0, published_ns)
        )
        chunk += data
        if len(chunk) > CHUNK:
            self._end_chunk()

    def flush(self) -> None:
        """Write all messages to disk, and wait until they are there. Raises OSError; the file stays valid."""
        self._end_chunk()
        self._stream.commit(SHORTEST_END)
        self._stream.sync()

    def close(self) -> FileSummary:
        """Write the index and close. If it raises OSError, the file is closed, and valid up to the last flush."""
        try:
            self._finish()
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
        topics = tuple([TopicCount(each.topic, each.type, each.count) for each in self._channels.values()])
        return FileSummary(self.path, self._stream.size, self._first_ns, self._last_ns, topics)

    def _end_chunk(self) -> None:
        """Write the open chunk to the file, if there is a message in it."""
        if not self._chunk_channels:
            return
        data = bytes(self._chunk)
        first = min([min(channel.entries[::2]) for channel in self._chunk_channels])
        last = max([max(channel.entries[::2]) for channel in self._chunk_channels])
        self._write(
            self._records.Chunk(
                compression=self._compression,
                data=self._compress(data),
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=crc32(data),
                uncompressed_size=len(data),
            )
        )
        self._write_message_indexes()
        self._chunks += 1
        self._first_ns = min(self._first_ns or first, first)
        self._last_ns = max(self._last_ns, last)
        self._chunk.clear()

    def _finish(self) -> None:
        """End the last chunk, and write the index and the end."""
        self._end_chunk()
        self._stream.commit(SHORTEST_END)
        data_end = self._stream.total
        self._write(self._records.DataEnd(data_section_crc=0))
        start = self._stream.total
        indexes = self._chunk_indexes(data_end)
        groups = (self._schemas.values(), self._channel_records, [self._statistics()], indexes)
        summary = bytearray()
        offsets = bytearray()
        for group in (*groups, self._attachments, [self._metadata]):
            at = start + len(summary)
            data = b"".join([self._bytes(record) for record in group])
            summary += data
            if data:
                offsets += self._bytes(self._records.SummaryOffset(data[0], at, len(data)))
        offset_start = start + len(summary)
        summary += offsets
        checksum = crc32(pack("<BQQQ", 0x02, 20, start, offset_start), crc32(summary))
        self._stream.write(bytes(summary))
        self._write(self._records.Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=checksum))
        self._stream.write(MAGIC)

    def _write_message_indexes(self) -> None:
        """Write the index of each channel's messages in the chunk that was written."""
        indexes = bytearray()
        for channel in self._chunk_channels:
            entries = channel.entries
            indexes += _INDEX.pack(7, 6 + 8 * len(entries), channel.number, 8 * len(entries))
            indexes += pack(f"<{len(entries)}Q", *entries)
            channel.count += len(entries) // 2
            entries.clear()
        self._stream.write(bytes(indexes))
        self._chunk_channels.clear()

    def _chunk_indexes(self, end: int) -> Iterator[Any]:
        """Yield the index of each chunk before the offset `end` of the file, read from there.

        In memory the indexes of an hour would take 20 MiB.
        """
        read, at, index = _windows(self._stream.read), len(MAGIC), None
        head_size = _CHUNK_HEAD.size + len(self._compression)
        while at < end:
            opcode, length = _RECORD.unpack(read(at, _RECORD.size))
            body = at + _RECORD.size
            if opcode == _CHUNK_RECORD:
                if index:
                    yield index
                first, last, size, _ = _CHUNK_HEAD.unpack(read(body, _CHUNK_HEAD.size))
                index = self._records.ChunkIndex(
                    message_start_time=first,
                    message_end_time=last,
                    chunk_start_offset=at,
                    chunk_length=_RECORD.size + length,
                    message_index_offsets={},
                    message_index_length=0,
                    compression=self._compression,
                    compressed_size=length - head_size - 8,
                    uncompressed_size=size,
                )
            elif opcode == _INDEX_RECORD and index:
                index.message_index_offsets[int.from_bytes(read(body, 2), "little")] = at
                index.message_index_length += _RECORD.size + length
            at = body + length
        if index:
            yield index

    def _statistics(self) -> Any:
        counts = {channel.number: channel.count for channel in self._channels.values()}
        return self._records.Statistics(
            attachment_count=len(self._attachments), metadata_count=1, schema_count=len(self._schemas),
            channel_count=len(counts), channel_message_counts=counts, chunk_count=self._chunks,
            message_count=sum(counts.values()), message_start_time=self._first_ns, message_end_time=self._last_ns,
        )  # fmt: skip

    def _write(self, record: Any) -> int:
        data = self._bytes(record)
        self._stream.write(data)
        return len(data)

    def _bytes(self, record: Any) -> bytes:
        builder = self._new_builder()
        record.write(builder)
        data: bytes = builder.end()
        return data


def _windows(read: Callable[[int, int], bytes]) -> Callable[[int, int], bytes]:
    """Return `read` with a window of the file in memory: most calls need no system call."""
    start, data = 0, b""

    def read_in_window(at: int, size: int) -> bytes:
        nonlocal start, data
        if not start <= at <= at + size <= start + len(data):
            start, data = at, read(at, _WINDOW)
        return data[at - start : at - start + size]

    return read_in_window


def require_library() -> None:
    """Check, without loading it, that the MCAP library is installed. Raises MissingExtraError."""
    from importlib.util import find_spec

    if find_spec("mcap") is None:
        raise MissingExtraError("a recording needs mcap: pip install 'uuv-hil[recording]'")


def _compressor(name: str) -> Any:
    """Return the function for that compression; both libraries are dependencies of mcap."""
    if name == "zstd":
        import zstandard

        return zstandard.ZstdCompressor(level=1).compress
    if name == "lz4":
        from lz4.frame import compress

        return compress
    return bytes

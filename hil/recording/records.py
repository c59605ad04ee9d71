"""Read the records of an MCAP file one after another, with limits on memory and time for untrusted files.

No length in the file is trusted. A record may have `LONGEST_RECORD` bytes, an unpacked chunk `LARGEST_CHUNK` bytes, and
all unpacked chunks together `MAX_TIMES` their size in the file.
"""

from collections.abc import Iterator
from io import BytesIO
from struct import unpack
from typing import IO, Any

from hil.common.errors import ConfigError

MAGIC = b"\x89MCAP0\r\n"
LONGEST_RECORD = 1 << 28  # bytes; our longest record is a picture
LARGEST_CHUNK = 1 << 27  # bytes when unpacked; those of uuv-hil and rosbag2 have less than 1 MiB, or one picture
MAX_TIMES = 1000  # limit of unpacked over packed size; recordings with sensor noise have about 10
UNPACKED_FREE = 64 << 20  # bytes that may be unpacked at any ratio


def read_records(file: IO[bytes], path: str, emit_chunks: bool = False) -> Iterator[Any]:
    """Yield the records of known types, including those in chunks; with `emit_chunks` yield the chunks instead.

    Raises ConfigError for a chunk beyond the limits, and the library's exceptions for a damaged file.
    """
    from mcap.opcode import Opcode
    from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema

    kinds: dict[int, Any] = {
        Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.CHUNK: Chunk,
        Opcode.ATTACHMENT: Attachment, Opcode.METADATA: Metadata, Opcode.MESSAGE: Message,
    }  # fmt: skip
    if file.read(len(MAGIC)) != MAGIC:
        raise ValueError("it does not begin as one does")
    size = unpacked = 0
    for kind, data in _framed(file, kinds):
        record = _parse(kind, data)
        if not isinstance(record, Chunk) or emit_chunks:
            yield record
            continue
        size += len(data)
        inside = _unpack(record, path)
        unpacked += len(inside)
        if unpacked > UNPACKED_FREE + MAX_TIMES * size:
            raise ConfigError(f"{path}: unpacks to more than {MAX_TIMES} times its size, which no recording does")
        for inner, content in _framed(BytesIO(inside), kinds):
            yield _parse(inner, content)


def _framed(file: IO[bytes], kinds: dict[int, Any]) -> Iterator[tuple[Any, bytes]]:
    """Yield the class and the bytes of each record of a known type, up to the end of the data."""
    from mcap.exceptions import RecordLengthLimitExceeded
    from mcap.opcode import Opcode

    while head := file.read(9):
        opcode, length = unpack("<BQ", head)
        if length > LONGEST_RECORD:
            raise RecordLengthLimitExceeded(opcode, length, LONGEST_RECORD)
        data = file.read(length)
        if len(data) < length:
            raise EOFError("it ends within a record")
        if opcode in (Opcode.FOOTER, Opcode.DATA_END):
            return
        if opcode in kinds:
            yield kinds[opcode], data


def _parse(kind: Any, data: bytes) -> Any:
    from mcap.data_stream import ReadDataStream
    from mcap.records import Message

    stream = ReadDataStream(BytesIO(data))
    return Message.read(stream, len(data)) if kind is Message else kind.read(stream)


def _unpack(chunk: Any, path: str) -> bytes:
    """Return the content of a chunk.

    Raises ConfigError if it is too large, ValueError if its compression is unknown.
    """
    most = chunk.uncompressed_size
    if most > LARGEST_CHUNK:
        raise ConfigError(
            f"{path}: a chunk of {most >> 20} MiB, where a recording has at most {LARGEST_CHUNK >> 20} MiB in one"
        )
    if chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
            data = reader.read(most + 1)
    elif chunk.compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        data = LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1)
    elif chunk.compression:
        raise ValueError(f"packed by {chunk.compression!r}")
    else:
        data = chunk.data
    if len(data) > most:
        raise ConfigError(f"{path}: a chunk that is larger than it says; copy the recording again")
    return bytes(data)

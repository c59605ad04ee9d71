"""Reading recordings: ours, and any other MCAP file of ROS 2 messages; also what is left of a broken one."""

import os
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from hil.errors import ConfigError
from hil.transport.recording_file import Message
from hil.transport.recording_mcap import require_library


class About(NamedTuple):
    """What stands at the beginning of a recording: `facts` of the run, and files by their names. Empty: not ours."""

    facts: dict[str, str]
    attachments: dict[str, str]


def recording_files(path: str) -> list[str]:
    """The files of a recording in the order they were written: `path` is one, or a folder. Raises ConfigError."""
    if os.path.isfile(path):
        return [path]
    if not os.path.isdir(path):
        raise ConfigError(f"{path}: no such file or folder")
    names = [name for name in os.listdir(path) if name.endswith(".mcap")]
    if not names:
        raise ConfigError(f"{path}: no .mcap file in this folder")
    return [os.path.join(path, name) for name in sorted(names, key=_number)]


def read_messages(path: str) -> Iterator[Message]:
    """The messages of a recording as they were written. Raises ConfigError, MissingExtraError."""
    for file in recording_files(path):
        yield from _messages(file)


def read_about(path: str) -> About:
    """What the recording says about its run. Raises ConfigError, MissingExtraError."""
    require_library()
    from mcap.records import Attachment, Chunk, Metadata

    found = About({}, {})
    for record in _records(recording_files(path)[0], emit_chunks=True):
        if isinstance(record, Metadata) and record.name == "uuv_hil":
            found.facts.update(record.metadata)
        elif isinstance(record, Attachment):
            found.attachments[record.name] = record.data.decode(errors="replace")
        elif isinstance(record, Chunk):  # all of it comes before the first message
            break
    return found


def _number(name: str) -> tuple[int, str]:
    """NAME_12.mcap comes after NAME_9.mcap."""
    digits = name.removesuffix(".mcap").rpartition("_")[2]
    return (int(digits) if digits.isdigit() else 0, name)


def _messages(path: str) -> Iterator[Message]:
    require_library()
    from mcap import records

    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    for record in _records(path):
        if isinstance(record, records.Message):
            if record.channel_id in channels:
                topic, kind = channels[record.channel_id]
                yield Message(topic, kind, record.sequence, record.publish_time, record.log_time, record.data)
        elif isinstance(record, records.Schema):
            schemas[record.id] = record.name
        elif isinstance(record, records.Channel) and record.message_encoding == "cdr":
            channels[record.id] = record.topic, schemas.get(record.schema_id, "")


def _records(path: str, emit_chunks: bool = False) -> Iterator[Any]:
    """The records of a file up to where it is broken, if it is."""
    from mcap.exceptions import InvalidMagic, McapError
    from mcap.stream_reader import StreamReader

    try:
        file = open(path, "rb")  # noqa: SIM115 - closed by the with below
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    with file:
        try:
            reader = iter(StreamReader(file, emit_chunks=emit_chunks, record_size_limit=1 << 28).records)
            first = next(reader)
        except (InvalidMagic, McapError, StopIteration, ValueError) as error:
            raise ConfigError(f"{path}: not an MCAP file: {error or 'it is empty'}") from None
        except Exception as error:  # noqa: BLE001 - what a broken file makes of the library
            raise ConfigError(f"{path}: not an MCAP file: {error or 'it is too short'}") from None
        yield first
        with suppress(GeneratorExit):
            yield from _until_broken(reader)


def _until_broken(reader: Iterator[Any]) -> Iterator[Any]:
    while True:
        try:
            record = next(reader)
        except StopIteration:
            return
        except Exception:  # noqa: BLE001 - the library raises struct.error, EndOfFile, codec errors and others
            return
        yield record

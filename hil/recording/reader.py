"""Read recordings of uuv-hil, other MCAP files with ROS 2 messages, and the intact part of a damaged file."""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.tables import LARGEST, check_file
from hil.common.text import clean
from hil.recording.mcap_file import Message
from hil.recording.mcap_writer import require_library
from hil.recording.records import read_records

MAX_ATTACHMENTS = 64  # a recording of uuv-hil has three: scenario, vehicle, world


class About(NamedTuple):
    """Head of a recording: `facts` of the run, and attached files by name. Both are empty for other software's."""

    facts: dict[str, str]
    attachments: dict[str, str]


def recording_files(path: str) -> list[str]:
    """Return the files of a recording in the order they were written; `path` is a file or a folder.

    Raises ConfigError.
    """
    if not os.path.isdir(path):
        check_file(path, sys.maxsize)  # any size, as it is read in chunks
        return [path]
    names = [name for name in os.listdir(path) if name.endswith(".mcap")]
    if not names:
        raise ConfigError(f"{path}: no .mcap file in this folder")
    return [os.path.join(path, name) for name in sorted(names, key=_number)]


def read_messages(path: str) -> Iterator[Message]:
    """Yield the messages of a recording as they were written. Raises ConfigError, MissingExtraError."""
    for file in recording_files(path):
        yield from _messages(file)


def read_about(path: str) -> About:
    """Return the facts and files of the recorded run. Raises ConfigError, MissingExtraError."""
    require_library()
    from mcap.records import Attachment, Chunk, Metadata

    about = About({}, {})
    for record in _records(recording_files(path)[0], emit_chunks=True):
        if isinstance(record, Metadata) and record.name == "uuv_hil":
            about.facts.update(record.metadata)
        elif isinstance(record, Attachment):
            if len(record.data) > LARGEST or len(about.attachments) >= MAX_ATTACHMENTS:
                raise ConfigError(
                    f"{path}: more than {MAX_ATTACHMENTS} files are attached, or one of more than {LARGEST >> 20} MiB"
                )
            about.attachments[record.name] = record.data.decode(errors="replace")
        elif isinstance(record, Chunk):  # metadata and attachments come before the first message
            break
    return about


def _number(name: str) -> tuple[int, str]:
    """Return a sort key with which NAME_12.mcap comes after NAME_9.mcap."""
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
    """Yield the records of a file, up to its end or to the first damaged one.

    Raises ConfigError if it is no MCAP file, or exceeds the limits of `read_records`.
    """
    check_file(path, sys.maxsize)
    try:
        file = open(path, "rb")  # noqa: SIM115 - closed by the with below
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    with file:
        records = read_records(file, path, emit_chunks)
        try:
            first = next(records)
        except ConfigError:
            raise
        except Exception as error:  # noqa: BLE001 - the library raises struct.error, EndOfFile, codec errors and others
            reason = str(error) if os.path.getsize(path) else "it is empty"
            raise ConfigError(f"{path}: not an MCAP file: {clean(reason) or 'it is too short'}") from None
        yield first
        with suppress(GeneratorExit):
            yield from _until_broken(records)


def _until_broken(records: Iterator[Any]) -> Iterator[Any]:
    while True:
        try:
            record = next(records)
        except StopIteration:
            return
        except ConfigError:
            raise
        except Exception:  # noqa: BLE001 - as above
            return
        yield record

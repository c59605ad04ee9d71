"""TCPROS, which carries the messages and services of ROS 1: connection headers, and frames with their length.

http://wiki.ros.org/ROS/TCPROS, ROS/Connection Header. All that comes is bounded in size and time.
"""

import asyncio
from collections.abc import Mapping
from struct import Struct, pack
from typing import NamedTuple

from hil.gateways.json_lines.connection import SOCKET_OPTIONS, tcp_options

LARGEST_HEADER = 1 << 16  # bytes
HEADER_S = 5.0  # within which a header must have come
UNREAD_MS = 30_000  # for which a peer may leave what is sent to it unread, or not be there
ANY = "*"  # for a type or md5 sum: whatever it is
_LENGTH = Struct("<I")


class Connection(NamedTuple):
    """A connection whose header was received: its fields, and both directions of the stream."""

    header: dict[str, str]
    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter


class PeerError(Exception):
    """A mistake of a peer, in words for it: it gets them in the `error` field of a header."""


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return a connection header, with its length."""
    items = [f"{name}={value}".encode() for name, value in fields.items()]
    content = b"".join([_LENGTH.pack(len(item)) + item for item in items])
    return _LENGTH.pack(len(content)) + content


def decode_header(data: bytes) -> dict[str, str]:
    """Return the fields of a connection header, without its length. Raises PeerError."""
    fields: dict[str, str] = {}
    at = 0
    while at < len(data):
        if len(data) - at < _LENGTH.size:
            raise PeerError("the connection header ends within a length")
        (length,) = _LENGTH.unpack_from(data, at)
        at += _LENGTH.size
        if length > len(data) - at:
            raise PeerError("a field of the connection header is longer than the header")
        name, found, value = data[at : at + length].partition(b"=")
        if not found or not name:
            raise PeerError("a field of the connection header is not NAME=VALUE")
        fields[name.decode(errors="replace")] = value.decode(errors="replace")
        at += length
    return fields


async def read_frame(reader: asyncio.StreamReader, largest: int, what: str) -> bytes:
    """Return the next bytes with their length before them. Raises PeerError, and what a closed connection raises."""
    (length,) = _LENGTH.unpack(await reader.readexactly(_LENGTH.size))
    if length > largest:
        raise PeerError(f"{what} of {length} bytes; at most {largest} are taken")
    return await reader.readexactly(length)


async def read_header(reader: asyncio.StreamReader) -> dict[str, str]:
    """Return the header that a peer sends first. Raises PeerError, and what a closed connection raises."""
    try:
        data = await asyncio.wait_for(read_frame(reader, LARGEST_HEADER, "a connection header"), HEADER_S)
    except asyncio.TimeoutError:
        raise PeerError(f"no connection header received within {HEADER_S:g} s") from None
    return decode_header(data)


def frame(data: bytes) -> bytes:
    """Return bytes with their length before them."""
    return pack("<I", len(data)) + data


def required(fields: Mapping[str, str], *names: str) -> list[str]:
    """Return these fields of a header. Raises PeerError for one that is missing."""
    for name in names:
        if name not in fields:
            raise PeerError(f"the connection header has no field {name!r}")
    return [fields[name] for name in names]


def require_type(fields: Mapping[str, str], name: str, type_name: str, md5sum: str) -> None:
    """Check that a peer has the same type under the same definition. Raises PeerError."""
    (theirs,) = required(fields, "md5sum")
    kind = fields.get("type", ANY)
    if theirs not in (ANY, md5sum):
        raise PeerError(f"{name} has the type {type_name} with md5sum {md5sum}; {kind[:80]} came with {theirs[:80]}")
    if kind not in (ANY, type_name):
        raise PeerError(f"{name} has the type {type_name}, not {kind[:80]}")


def set_options(writer: asyncio.StreamWriter) -> None:
    """Let a connection send at once, and end when its peer vanishes or reads nothing for long."""
    opened = writer.get_extra_info("socket")
    for option in (*SOCKET_OPTIONS, *tcp_options(TCP_USER_TIMEOUT=UNREAD_MS)):
        opened.setsockopt(*option)


def peer_name(writer: asyncio.StreamWriter) -> str:
    """Return the address of a peer, HOST:PORT."""
    name = writer.get_extra_info("peername") or ("?", 0)
    return f"{name[0]}:{name[1]}"

"""Find the messages in the bytes of an instrument, by the marks and checksums of the usual protocols."""

import json
import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

from hil.links.frame.checksums import CRCS, SUMS, Checksum, crc_checksum

LONGEST = 400  # bytes of a binary output without a length field
LARGEST = 2_500  # bytes of a message; a greater size is taken for damaged
IMAGE = 65_000
VECTORNAV = b"\xfa"
LINE = re.compile(rb"[ -~\t]*(\r\n|\n|\r)")
HEAD = re.compile(rb"HTTP/1\.1 (\d{3}) .*?\r\nContent-Length: (\d{1,8})\r\n(?:.*\r\n)*?\r\n", re.DOTALL)
STARTED = re.compile(rb"[ -~\t]+\Z")
CRC8, CRC16 = crc_checksum(CRCS["crc8"]), crc_checksum(CRCS["crc16-xmodem"])  # of Water Linked and VectorNav


class Frame(NamedTuple):
    """One message: its kind and text for a person, whether its checksum is right (None: it has none), its size."""

    kind: str
    text: str
    ok: bool | None
    size: int


INCOMPLETE = Frame("", "", None, 0)


def split(data: bytes) -> Iterator[Frame]:
    """Yield the messages; a byte that belongs to none is a message "stray" with a wrong checksum. Never raises."""
    while data:
        found = next((frame for find in (_http, _binary, _vectornav, _line) if (frame := find(data[:70_000]))), None)
        if found is INCOMPLETE:
            return
        frame = found or Frame("stray", data[:1].hex(), False, 1)
        yield frame
        data = data[frame.size :]


def _little(data: bytes) -> int:
    return int.from_bytes(data, "little")


def _fletcher(message: bytes, _: int) -> int:
    first = second = 0
    for byte in message[2:]:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return first | second << 8


class Protocol(NamedTuple):
    """Binary messages that begin with `mark` and end with `checksum`; the `size` field counts all but `beyond` bytes.

    `kind` names a message for a person.
    """

    mark: bytes
    size: slice
    beyond: int
    checksum: Checksum
    kind: Callable[[bytes], str]
    most: int = LARGEST


_MODBUS = crc_checksum(CRCS["crc16-modbus"])
PROTOCOLS = (
    Protocol(b"BR", slice(2, 4), 10, SUMS["sum16"], lambda data: f"ping {_little(data[4:6])}"),
    Protocol(b"\xb5\x62", slice(4, 6), 8, Checksum(2, 0, _fletcher), lambda data: f"UBX {data[2:4].hex(' ')}"),
    Protocol(b"\x7f\x7f", slice(2, 4), 2, SUMS["sum16"], lambda _: "PD0"),
    Protocol(b"\x7d\x00", slice(2, 4), 2, SUMS["sum16"], lambda _: "PD4"),
    Protocol(b"RIP", slice(4, 8), 0, crc_checksum(CRCS["crc32"]), lambda data: data[:4].decode("latin-1"), IMAGE),
    # Answers of function 3 and refusals, by device 1 or the one that answers to 250.
    *[Protocol(mark, slice(2, 3), 5, _MODBUS, lambda _: "MODBUS 3") for mark in (b"\x01\x03", b"\xfa\x03")],
    *[Protocol(mark, slice(2, 2), 5, _MODBUS, lambda _: "MODBUS refusal") for mark in (b"\x01\x83", b"\xfa\x83")],
)


def _binary(data: bytes) -> Frame | None:
    """Return a message of one of `PROTOCOLS`; of a damaged one, whose size may be wrong, one byte.

    A VectorNav's outputs may begin as messages of MODBUS do, so their checksum tells which they are.
    """
    protocol = next((each for each in PROTOCOLS if data.startswith(each.mark)), None)
    if protocol is None or len(data) < protocol.size.stop:
        return None
    size = _little(data[protocol.size]) + protocol.beyond
    if len(data) < size <= protocol.most:
        return INCOMPLETE
    message, checksum = data[:size], protocol.checksum
    end = size - checksum.size
    is_sound = protocol.size.stop <= end <= protocol.most and checksum.of(message[:end]) == _little(message[end:])
    if not is_sound and data[:1] == VECTORNAV:
        return None
    return Frame(protocol.kind(data), message[:24].hex(" "), is_sound, size if is_sound else 1)


def _vectornav(data: bytes) -> Frame | None:
    """Return a binary output: its length is in no field, so the first end whose CRC is right."""
    if data[:1] != VECTORNAV:
        return None
    crc = CRC16.empty
    for size in range(2, min(len(data), LONGEST) + 1):
        crc = CRC16.update(data[size - 1 : size], crc)
        if crc == 0 and size > 8:
            return Frame(f"binary {data[1]:02x}", data[: min(24, size)].hex(" "), True, size)
    return None if len(data) > LONGEST else INCOMPLETE


def _line(data: bytes) -> Frame | None:
    """Return a line of text, or the prompt of a Teledyne instrument."""
    if data[:1] == b">":
        return Frame("prompt", ">", None, 1)
    match = LINE.match(data)
    if not match:
        return INCOMPLETE if STARTED.match(data) and len(data) < 65_536 else None
    text = match[0].strip().decode("ascii")
    if text.startswith("{"):
        return _json(text, len(match[0]))
    word = re.split(r"[,*=\s]", text, maxsplit=1)[0]
    kind = word[:3] if word[:1] in "$#" and len(word) > 8 else word[:8] or "empty line"
    return Frame(kind, text, _line_is_sound(text), len(match[0]))


def _http(data: bytes) -> Frame | None:
    """Return an answer of HTTP; one with an error of the server's is damaged, but not 503, "no position"."""
    match = HEAD.match(data)
    if not match:
        return None
    status, size = int(match[1]), match.end() + int(match[2])
    text = f"{status} {data[match.end() : size].decode('utf-8', 'replace')}"
    return Frame(f"HTTP {status}", text, status < 500 or status == 503, size) if len(data) >= size else INCOMPLETE


def _json(text: str, size: int) -> Frame:
    try:
        message = json.loads(text)
    except ValueError:
        return Frame("JSON", text, False, size)
    return Frame(str(message.get("response_to") or message.get("type", "JSON")), text, True, size)


def _line_is_sound(text: str) -> bool | None:
    """Return whether the checksum behind the last `*` is right: CRC-8 of Water Linked, XOR, or a CRC-16."""
    body, mark, checksum = text.rpartition("*")
    if not mark or not re.fullmatch("[0-9A-Fa-f]{2}|[0-9A-Fa-f]{4}", checksum):
        return None
    if text[0] == "w" and len(checksum) == 2:
        return int(checksum, 16) == CRC8.of(body.encode())
    right = SUMS["xor8"] if len(checksum) == 2 else CRC16
    return int(checksum, 16) == right.of(body.lstrip("$!").encode())

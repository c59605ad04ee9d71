"""Find the messages in the bytes of an instrument, by the marks and checksums of the usual protocols."""

import json
import re
import zlib
from collections.abc import Callable, Iterator
from typing import NamedTuple

LONGEST = 400  # bytes of a binary output without a length field
LARGEST = 2_500  # bytes of a message; a greater size is taken for damaged
IMAGE = 65_000
LINE = re.compile(rb"[ -~\t]*(\r\n|\n|\r)")
STARTED = re.compile(rb"[ -~\t]+\Z")


class Frame(NamedTuple):
    """One message: its kind and text for a person, whether its checksum is right (None: it has none), its size."""

    kind: str
    text: str
    ok: bool | None
    size: int


INCOMPLETE = Frame("", "", None, 0)
Finder = Callable[[bytes], Frame | None]


def split(data: bytes) -> Iterator[Frame]:
    """Yield the messages; a byte that belongs to none is a message "stray" with a wrong checksum. Never raises."""
    while data:
        found = next((frame for find in FINDERS if (frame := find(data[:70_000]))), None)
        if found is INCOMPLETE:
            return
        frame = found or Frame("stray", data[:1].hex(), False, 1)
        yield frame
        data = data[frame.size :]


def _sized(
    name: str, data: bytes, size: int, kind: str, checksum: Callable[[bytes], bool], most: int = LARGEST
) -> Frame:
    """Return a binary message whose size its header gives; of a damaged one, whose size may be wrong, one byte."""
    if len(data) < size <= most:
        return INCOMPLETE
    message = data[:size]
    is_sound = size <= most and checksum(message)
    return Frame(f"{name} {kind}".strip(), message[:24].hex(" "), is_sound, size if is_sound else 1)


def _ping(data: bytes) -> Frame | None:
    if data[:2] != b"BR" or len(data) < 8:
        return None
    size = 10 + int.from_bytes(data[2:4], "little")
    kind = str(int.from_bytes(data[4:6], "little"))
    return _sized("ping", data, size, kind, _ends_with_sum)


def _ubx(data: bytes) -> Frame | None:
    if data[:2] != b"\xb5\x62" or len(data) < 6:
        return None
    size = 8 + int.from_bytes(data[4:6], "little")
    return _sized("UBX", data, size, data[2:4].hex(" "), lambda message: _fletcher(message[2:-2]) == message[-2:])


def _teledyne(data: bytes) -> Frame | None:
    if data[:2] not in (b"\x7f\x7f", b"\x7d\x00") or len(data) < 4:
        return None
    size = 2 + int.from_bytes(data[2:4], "little")
    return _sized("PD0" if data[0] == 0x7F else "PD4", data, size, "", _ends_with_sum)


def _range_image(data: bytes) -> Frame | None:
    if data[:3] != b"RIP" or len(data) < 8:
        return None
    size = int.from_bytes(data[4:8], "little")
    crc = lambda message: zlib.crc32(message[:-4]) == int.from_bytes(message[-4:], "little")  # noqa: E731
    return _sized(data[:4].decode("ascii", "replace"), data, max(size, 12), "", crc, IMAGE)


def _vectornav(data: bytes) -> Frame | None:
    """Return a binary output: its length is in no field, so the first end whose CRC is right."""
    if data[:1] != b"\xfa":
        return None
    crc = 0
    for size, byte in enumerate(data[1:LONGEST], 2):
        crc = _crc_ccitt(crc, byte)
        if crc == 0 and size > 8:
            return Frame(f"binary {data[1]:02x}", data[: min(24, size)].hex(" "), True, size)
    return None if len(data) > LONGEST else INCOMPLETE


def _modbus(data: bytes) -> Frame | None:
    """Return an answer of function 3, by device 1 or the one that answers to 250."""
    if data[:1] not in (b"\x01", b"\xfa") or data[1:2] != b"\x03" or len(data) < 3:
        return None
    size = 5 + data[2]
    crc = 0xFFFF
    for byte in data[: size - 2]:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return _sized("MODBUS", data, size, "3", lambda message: crc == int.from_bytes(message[-2:], "little"))


def _prompt(data: bytes) -> Frame | None:
    return Frame("prompt", ">", None, 1) if data[:1] == b">" else None


def _line(data: bytes) -> Frame | None:
    match = LINE.match(data)
    if not match:
        return INCOMPLETE if STARTED.match(data) and len(data) < 65_536 else None
    text = match[0].strip().decode("ascii")
    return Frame(_kind_of(text), text, _line_is_sound(text), len(match[0]))


FINDERS: tuple[Finder, ...] = (_ping, _ubx, _teledyne, _range_image, _modbus, _vectornav, _prompt, _line)


def _kind_of(text: str) -> str:
    """Return what a line is: its type if it is JSON, else its first word."""
    if text.startswith("{"):
        try:
            message = json.loads(text)
        except ValueError:
            return "JSON"
        return str(message.get("response_to") or message.get("type", "JSON"))
    word = re.split(r"[,*=\s]", text, maxsplit=1)[0]
    return word[:3] if word[:1] in "$#" and len(word) > 8 else word[:8] or "empty line"


def _line_is_sound(text: str) -> bool | None:
    """Return whether the checksum behind the last `*` is right: CRC-8 of Water Linked, XOR, or a CRC-16."""
    if text.startswith("{"):
        try:
            return isinstance(json.loads(text), dict)
        except ValueError:
            return False
    body, mark, checksum = text.rpartition("*")
    if not mark or not re.fullmatch("[0-9A-Fa-f]{2}|[0-9A-Fa-f]{4}", checksum):
        return None
    data = body.encode()
    xor = crc8 = crc16 = 0
    for byte in data.lstrip(b"$!"):
        xor ^= byte
        crc16 = _crc_ccitt(crc16, byte)
    for byte in data:
        crc8 ^= byte
        for _ in range(8):
            crc8 = crc8 << 1 ^ (0x107 if crc8 & 0x80 else 0)
    return int(checksum, 16) in ((crc16,) if len(checksum) == 4 else (crc8,) if text[0] == "w" else (xor,))


def _crc_ccitt(crc: int, byte: int) -> int:
    crc = (crc >> 8 | crc << 8) & 0xFFFF ^ byte
    crc ^= (crc & 0xFF) >> 4
    crc ^= crc << 12 & 0xFFFF
    return crc ^ (crc & 0xFF) << 5


def _fletcher(data: bytes) -> bytes:
    first = second = 0
    for byte in data:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return bytes((first, second))


def _ends_with_sum(message: bytes) -> bool:
    return sum(message[:-2]) & 0xFFFF == int.from_bytes(message[-2:], "little")

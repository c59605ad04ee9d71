"""Packets of the Range Image Protocol, version 2: "RIP2", length, compressed protobuf message, CRC-32.

Sources: docs.waterlinked.com (sonar-3d-15-api) and the .proto file of github.com/waterlinked/wlsonar. Few fields are
written, so they are packed here, without protobuf's library. The message stands in one literal of the Snappy format,
which every reader of that takes, uncompressed; an image has at most 49 kB and fits in a datagram.
"""

import struct
from collections.abc import Iterable
from typing import Any, NamedTuple
from zlib import crc32

_PACKAGE = "type.googleapis.com/waterlinked.sonar.protocol."
_LITERAL = 61 << 2  # a literal whose length stands in the next two bytes


class Shot(NamedTuple):
    """What the messages of one image share: time (ns since 1970), number, settings, size and field of view (deg)."""

    time_ns: int
    sequence: int
    speed_of_sound: float
    reach: float
    frequency: int
    width: int
    height: int
    field_across: float
    field_down: float


def range_image(shot: Shot, scale: float, pixels: Any) -> bytes:
    """Return the packet of a range image; each of `pixels`, a numpy array, times `scale` is a distance in m."""
    import numpy as np

    value = np.asarray(pixels, np.uint16).ravel()
    more, most = value > 0x7F, value > 0x3FFF
    digits = np.stack([value & 0x7F | more << 7, value >> 7 & 0x7F | most << 7, value >> 14], axis=1).astype(np.uint8)
    packed = digits[np.stack([np.ones_like(more), more, most], axis=1)].tobytes()
    sizes = _number(5, shot.width) + _number(6, shot.height)
    fields = _float(7, shot.field_across) + _float(8, shot.field_down) + _float(9, scale) + _bytes(10, packed)
    return _packet("RangeImage", _common(shot) + sizes + fields)


def strength_image(shot: Shot, pixels: bytes) -> bytes:
    """Return the packet of the strengths of the echoes, a byte each: 100 log10(strength / 30)."""
    sizes = _number(6, shot.width) + _number(7, shot.height)
    fields = _float(8, shot.field_across) + _float(9, shot.field_down) + _bytes(10, pixels)
    return _packet("BitmapImageGreyscale8", _common(shot) + sizes + fields)


def imu_batch(sequence: int, times_ns: Iterable[int], forces: Iterable[float], rates: Iterable[float]) -> bytes:
    """Return the packet of inertial samples: times, and three specific forces (m/s²) and rates (rad/s) of each."""
    times = [_bytes(3, _timestamp(time_ns)) for time_ns in times_ns]
    vectors = [_bytes(n, b"".join(struct.pack("<f", x) for x in values)) for n, values in ((4, forces), (5, rates))]
    return _packet("ImuBatch", b"".join([_number(1, sequence), _number(2, len(times)), *times, *vectors]))


def _common(shot: Shot) -> bytes:
    header = _bytes(1, _timestamp(shot.time_ns)) + _number(2, shot.sequence)
    return _bytes(1, header) + _float(2, shot.speed_of_sound) + _float(3, shot.reach) + _number(4, shot.frequency)


def _packet(name: str, message: bytes) -> bytes:
    body = _bytes(1, _bytes(1, (_PACKAGE + name).encode()) + _bytes(2, message))
    body = _varint(len(body)) + bytes((_LITERAL,)) + struct.pack("<H", len(body) - 1) + body
    head = b"RIP2" + struct.pack("<I", len(body) + 12)
    return head + body + struct.pack("<I", crc32(head + body))


def _timestamp(time_ns: int) -> bytes:
    seconds, rest = divmod(time_ns, 1_000_000_000)
    return _number(1, seconds) + _number(2, rest)


def _varint(value: int) -> bytes:
    data = bytearray()
    while value > 0x7F:
        data.append(value & 0x7F | 0x80)
        value >>= 7
    data.append(value)
    return bytes(data)


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _float(field: int, value: float) -> bytes:
    return _varint(field << 3 | 5) + struct.pack("<f", value)


def _bytes(field: int, value: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(value)) + value

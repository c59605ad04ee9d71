"""CAN frames on a wire of bytes: a sequence of Linux's `struct can_frame` (16 bytes, linux/can.h).

So a CAN bus is a `Wire` like any other: a `Protocol` for CAN encodes to such records and decodes whole ones. Classic
CAN only: up to 8 bytes of data.
"""

from struct import Struct
from typing import NamedTuple

EXTENDED = 0x8000_0000  # CAN_EFF_FLAG: the identifier has 29 bits
REMOTE = 0x4000_0000  # CAN_RTR_FLAG
ERROR = 0x2000_0000  # CAN_ERR_FLAG
ID_MASK = 0x1FFF_FFFF

_RECORD = Struct("=IB3x8s")
RECORD_SIZE = _RECORD.size
MAX_DATA = 8


class CanFrame(NamedTuple):
    """One data frame; `id` has 29 bits if `extended`, else 11."""

    id: int
    data: bytes
    extended: bool = True


def pack_frame(frame: CanFrame) -> bytes:
    """Return the record of a frame."""
    return _RECORD.pack(frame.id | EXTENDED if frame.extended else frame.id, len(frame.data), frame.data)


def unpack_frames(records: bytes) -> list[CanFrame]:
    """Return the data frames of whole records; ignore remote frames, error frames and invalid records."""
    return [
        CanFrame(marked_id & ID_MASK, data[:size], bool(marked_id & EXTENDED))
        for marked_id, size, data in _RECORD.iter_unpack(records[: len(records) - len(records) % RECORD_SIZE])
        if size <= MAX_DATA and not marked_id & (REMOTE | ERROR)
    ]

"""Write PNG pictures: height maps of 16 bits, and colours."""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from hil.charts.grid import write_file


def write_png(image: NDArray[np.uint16] | NDArray[np.uint8], path: str) -> None:
    """Write (rows, columns) of 8 or 16 bits as grey, (rows, columns, 3) as colours. Raises ConfigError.

    After the W3C's PNG specification; every row unfiltered.
    """
    rows, columns = image.shape[:2]
    bits, colour = 8 * image.itemsize, 2 if image.ndim == 3 else 0
    lines = np.ascontiguousarray(image, f">u{image.itemsize}").view(np.uint8).reshape(rows, -1)
    data = zlib.compress(np.hstack([np.zeros((rows, 1), np.uint8), lines]).tobytes(), 6)
    head = struct.pack(">IIBBBBB", columns, rows, bits, colour, 0, 0, 0)
    write_file(path, b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", head) + _chunk(b"IDAT", data) + _chunk(b"IEND", b""))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

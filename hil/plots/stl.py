"""Read triangles from an STL file, binary or text."""

import struct
from typing import Any

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.tables import read_bytes

LARGEST = 256 << 20  # bytes: 5 million triangles
_HEADER, _TRIANGLE = 84, 50  # bytes: 80 of text and the count; normal, three corners, attribute


def read_stl(path: str) -> Any:
    """Return the corners of the triangles (n x 3 x 3), in the axes and unit of the file.

    Raises ConfigError, MissingExtraError.
    """
    try:
        import numpy as np
    except ImportError:
        raise MissingExtraError("reading a mesh needs numpy: pip install 'uuv-hil[master]'") from None
    data = read_bytes(path, LARGEST)
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= _HEADER else 0
    if count and len(data) == _HEADER + _TRIANGLE * count:
        rows = np.frombuffer(data, np.uint8, offset=_HEADER).reshape(count, _TRIANGLE)
        return rows[:, 12:48].copy().view("<f4").reshape(count, 3, 3).astype(float)
    words = [line.split() for line in data.decode("ascii", "replace").splitlines()]
    try:
        corners = np.array([line[1:] for line in words if line[:1] == ["vertex"]], float)
        return corners.reshape(-1, 3, 3)
    except ValueError:
        raise ConfigError(f"{path}: is not an STL file: its triangles are incomplete") from None

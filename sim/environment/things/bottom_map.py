"""A map of the seabed's material for sonars and cameras: the `[bottom_map]` of a world made from a chart.

[bottom_map]
file = "bay.bottom"            # beside the world's file: a byte a node, row after row from the south-west
north_min = -200.0
east_min = -150.0
resolution = 20.0
rows = 21
columns = 16

A byte is the number of a material in S-57 (attribute 113, NATSUR, nature of surface), or 0 where it is unknown: there
the seabed is that of `[bottom]`. Between four nodes the material with the largest bilinear weight is used. The weights
vary with the position (`_BORDER_WAVES`), so that a border is neither stepped at nodes nor a straight line. The file is
memory-mapped when a sonar or a camera first needs it. sim.environment.things.natures has the materials' properties.
"""

import os
import sys
from math import pi, sin
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, convert
from hil.common.tables import check_file
from sim.environment.bottom import PROPERTIES, Bottom
from sim.environment.terrain_grid import Edge

if TYPE_CHECKING:
    from mmap import mmap

    import numpy as np
    from numpy.typing import NDArray

    Codes = NDArray[np.uint8]
    Floats = NDArray[np.float32]


UNKNOWN = 0
# Waves along borders: share of a weight, cycles per node to the north and to the east. Their sum is below 1/2.
_BORDER_WAVES = ((0.11, 0.61, 0.37), (0.09, -0.83, 1.49), (0.06, 2.27, -1.91), (0.04, 3.1, 4.7))
_CODES = 256


class BottomMapKeys(NamedTuple):
    """The keys of a `[bottom_map]`: see the top of this module."""

    file: str
    north_min: Edge
    east_min: Edge
    resolution: Annotated[float, Range(0.01, 1e5, "m")]
    rows: Annotated[int, Range(1, 100_000)]
    columns: Annotated[int, Range(1, 100_000)]


class BottomMap:
    """The kinds of seabed of a world, in the file at `path`. Methods that take arrays need numpy."""

    def __init__(self, keys: BottomMapKeys, path: str) -> None:
        self.keys, self.path = keys, path
        self._mapped: mmap | None = None

    def code(self, north: float, east: float) -> int:
        """Return S-57's number of the material at a position (m), 0 if unknown."""
        keys = self.keys
        x, y = (north - keys.north_min) / keys.resolution, (east - keys.east_min) / keys.resolution
        if not (-0.5 <= x < keys.rows - 0.5 and -0.5 <= y < keys.columns - 0.5):
            return UNKNOWN
        x, y = min(max(x, 0.0), keys.rows - 1.0), min(max(y, 0.0), keys.columns - 1.0)
        row, column = int(x), int(y)
        u, v = x - row, y - column
        weights = (1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v
        scores: dict[int, float] = {}
        for corner, weight in enumerate(weights):
            if weight > 0.0:
                code = self._bytes()[(row + corner // 2) * keys.columns + column + corner % 2]
                scores[code] = scores.get(code, 0.0) + weight
        ragged = _border_waves(sin, x, y)
        return max(scores, key=lambda code: scores[code] + _wave_factor(code) * ragged)

    def codes(self, north: Any, east: Any) -> "Codes":
        """Return S-57's numbers of the material at positions (m, arrays of one shape), 0 if unknown."""
        import numpy as np

        keys, grid = self.keys, self.grid()
        x = (np.asarray(north) - keys.north_min) / keys.resolution
        y = (np.asarray(east) - keys.east_min) / keys.resolution
        if not x.size:
            return np.zeros(x.shape, np.uint8)
        outside = (x < -0.5) | (x >= keys.rows - 0.5) | (y < -0.5) | (y >= keys.columns - 0.5)
        x, y = np.clip(x, 0, keys.rows - 1), np.clip(y, 0, keys.columns - 1)
        window = grid[_nodes_around(x), _nodes_around(y)]
        if window.size < x.size and (window == window[0, 0]).all():  # most often
            nearest = np.full(x.shape, window[0, 0])
        else:
            nearest = _codes_at(grid, x.astype(np.float32), y.astype(np.float32))
        nearest[outside] = UNKNOWN
        return nearest

    def echoes(self, north: Any, east: Any, bottom: Bottom | None) -> "Floats":
        """Return `echo_ratios` at positions (m, arrays of one shape)."""
        import numpy as np

        ratios: Floats = np.array(echo_ratios(bottom), np.float32)
        return ratios[self.codes(north, east)]

    def appearances(self, north: Any, east: Any, default: Any) -> "tuple[Floats, Floats]":
        """Return the colours (n x 3) at n positions, `default` where unknown, and the strengths of texture (n)."""
        import numpy as np

        from sim.environment.things.natures import NATURES

        colours, textures = np.full((_CODES, 3), default, np.float32), np.ones(_CODES, np.float32)
        for nature in NATURES.values():
            colours[nature.code], textures[nature.code] = nature.colour, nature.texture
        codes = self.codes(north, east)
        return colours[codes], textures[codes]

    def grid(self) -> "Codes":
        """Return the numbers at the nodes, rows x columns, as a view of the mapped file."""
        import numpy as np

        return np.frombuffer(self._bytes(), np.uint8).reshape(self.keys.rows, self.keys.columns)

    def _bytes(self) -> "mmap":
        if self._mapped is None:
            from mmap import ACCESS_READ, mmap  # imported at the first use, to start faster

            with open(self.path, "rb") as file:
                self._mapped = mmap(file.fileno(), 0, access=ACCESS_READ)
        return self._mapped


def _nodes_around(positions: Any) -> slice:
    """Return the range of nodes around positions (in nodes) along an axis."""
    return slice(int(positions.min()), int(positions.max()) + 2)


def _codes_at(grid: "Codes", x: "Floats", y: "Floats") -> "Codes":
    """Return the code with the largest weight at each position (in nodes), which must be within the grid."""
    import numpy as np

    columns = grid.shape[1]
    row, column = x.astype(np.intp), y.astype(np.intp)
    first = row * columns + column
    # Beyond the last row or column a corner's weight is 0, whatever its code.
    corners = np.stack([grid.ravel().take(first + more, mode="clip") for more in (0, 1, columns, columns + 1)])
    result: Codes = corners[0].copy()
    mixed = (corners[1:] != result).any(axis=0)
    if mixed.any():
        mixed_corners, x, y = corners[:, mixed], x[mixed], y[mixed]
        u, v = x - row[mixed], y - column[mixed]
        weights = (1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v
        ragged, scores = _border_waves(np.sin, x, y), []
        present = np.flatnonzero(np.bincount(mixed_corners.ravel()))
        for code in present:
            weight = sum(part * (corner == code) for part, corner in zip(weights, mixed_corners, strict=True))
            scores.append(np.where(weight > 0.0, weight + np.float32(_wave_factor(int(code))) * ragged, -np.inf))
        result[mixed] = present[np.argmax(scores, axis=0)]
    return result


def _border_waves(sine: Any, x: Any, y: Any) -> Any:
    """Return the change of a weight at positions (in nodes) that makes borders irregular: the sum of the waves."""
    return sum(size * sine(2.0 * pi * (along * x + across * y)) for size, along, across in _BORDER_WAVES)


def _wave_factor(code: int) -> float:
    """Return the factor (-1 to 1) of the waves for a material; it differs, so that one gains where another loses."""
    return sin(2.4 * code)


def echo_ratios(bottom: Bottom | None) -> list[float]:
    """Return the echo of each material, by its number in S-57, relative to that of a world's `bottom` (None: sand)."""
    from sim.environment.things.natures import NATURES

    reference = PROPERTIES[bottom.kind].echo if bottom else 0.0
    ratios = [1.0] * _CODES
    for nature in NATURES.values():
        ratios[nature.code] = 10.0 ** (0.1 * (nature.echo - reference))
    return ratios


def read_bottom_map(section: Any, where: str) -> BottomMap:
    """Return the `[bottom_map]` table of a world at `where`, its file and key. Raises ConfigError."""
    keys: BottomMapKeys = convert(section, BottomMapKeys, where)
    file = os.path.join(os.path.dirname(where.removesuffix(": bottom_map")), keys.file)
    check_file(file, sys.maxsize)
    size, expected = os.path.getsize(file), keys.rows * keys.columns
    if size != expected:
        raise ConfigError(f"{file}: {size} bytes, but {keys.rows} x {keys.columns} are {expected}")
    return BottomMap(keys, file)

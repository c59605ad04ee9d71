"""A map of the seabed's material for sonars and cameras: `[bottom_map]` of a world's file, as charts have it.

[bottom_map]
file = "bay.bottom"            # beside the world's file: a byte a node, row after row from the south-west
north_min = -200.0
east_min = -150.0
resolution = 20.0
rows = 21
columns = 16

A byte is the number that S-57 gives the nature of a surface (attribute 113, NATSUR), 0 where nothing is known: there
the seabed is that of `[bottom]`. The file is mapped when a sonar or a camera looks; sim.environment.things.natures
has what they see.
"""

import os
import sys
from math import floor
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import Range, parse
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
        """Return S-57's number of the kind at a place (m): that of the nearest node, 0: unknown."""
        keys = self.keys
        row = floor((north - keys.north_min) / keys.resolution + 0.5)
        column = floor((east - keys.east_min) / keys.resolution + 0.5)
        inside = 0 <= row < keys.rows and 0 <= column < keys.columns
        return self._bytes()[row * keys.columns + column] if inside else UNKNOWN

    def codes(self, north: Any, east: Any) -> "Codes":
        """Return S-57's number of the kind at places (m, arrays of one shape): that of the nearest node, 0: unknown."""
        import numpy as np

        keys, grid = self.keys, self.grid()
        row = np.floor((np.asarray(north) - keys.north_min) / keys.resolution + 0.5)
        column = np.floor((np.asarray(east) - keys.east_min) / keys.resolution + 0.5)
        inside = (row >= 0) & (row < keys.rows) & (column >= 0) & (column < keys.columns)
        found = grid[np.where(inside, row, 0).astype(np.intp), np.where(inside, column, 0).astype(np.intp)]
        return np.where(inside, found, np.uint8(UNKNOWN))

    def echoes(self, north: Any, east: Any, bottom: Bottom | None) -> "Floats":
        """Return `echo_ratios` at places (m, arrays of one shape)."""
        import numpy as np

        ratios: Floats = np.array(echo_ratios(bottom), np.float32)
        return ratios[self.codes(north, east)]

    def looks(self, north: Any, east: Any, usual: Any) -> "tuple[Floats, Floats]":
        """Return the colours (n x 3) at n places, `usual` where none is known, and how strong the texture is."""
        import numpy as np

        from sim.environment.things.natures import NATURES

        colours, textures = np.full((_CODES, 3), usual, np.float32), np.ones(_CODES, np.float32)
        for nature in NATURES.values():
            colours[nature.code], textures[nature.code] = nature.colour, nature.texture
        codes = self.codes(north, east)
        return colours[codes], textures[codes]

    def grid(self) -> "Codes":
        """Return the numbers at the nodes, rows x columns, mapped."""
        import numpy as np

        return np.frombuffer(self._bytes(), np.uint8).reshape(self.keys.rows, self.keys.columns)

    def _bytes(self) -> "mmap":
        if self._mapped is None:
            from mmap import ACCESS_READ, mmap  # at the first use, not while a vehicle starts

            with open(self.path, "rb") as file:
                self._mapped = mmap(file.fileno(), 0, access=ACCESS_READ)
        return self._mapped


def echo_ratios(bottom: Bottom | None) -> list[float]:
    """Return by S-57's number how many times stronger than of a world's `bottom` (None: sand) the echo of a kind is."""
    from sim.environment.things.natures import NATURES

    usual = PROPERTIES[bottom.kind].echo if bottom else 0.0
    ratios = [1.0] * _CODES
    for nature in NATURES.values():
        ratios[nature.code] = 10.0 ** (0.1 * (nature.echo - usual))
    return ratios


def read_bottom_map(section: Any, path: str) -> BottomMap:
    """Return the `[bottom_map]` table of the world in the file `path`. Raises ConfigError."""
    if not isinstance(section, dict):
        raise ConfigError(f"{path}: bottom_map: expected a table")
    keys = parse(section, BottomMapKeys, f"{path}: bottom_map")
    file = os.path.join(os.path.dirname(path), keys.file)
    check_file(file, sys.maxsize)
    size, wanted = os.path.getsize(file), keys.rows * keys.columns
    if size != wanted:
        raise ConfigError(f"{file}: {size} bytes, but {keys.rows} x {keys.columns} are {wanted}")
    return BottomMap(keys, file)

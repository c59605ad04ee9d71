"""Relief and echo strength of a seabed below the resolution of its grid, used by sonars and cameras alike.

The relief is noise with the power spectrum k^-exponent of a natural bed (APL-UW 1994, TR 9407: 3 to 3.5), cut off at
`OUTER` m, plus ripples. The strength is noise of longer wavelengths. They repeat after 20 m and 41 m. `footprint` (m)
is the size over which a sensor averages: smaller detail is not visible. Slopes are the increase of depth per m, as in
sim.environment.terrain.Terrain.gradient.
"""

from functools import lru_cache
from math import cos, sin, tau
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.environment.bottom import OUTER, PROPERTIES, Bottom
from sim.environment.terrain import Terrain

Floats = NDArray[np.float32]

_SIDE = 512  # nodes of a tile, a power of two
NODE = 0.04  # m between nodes of the finest relief: it repeats after 20 m
_LEVELS = 6  # each of half the resolution of the one before


class _Tiles(NamedTuple):
    """Slopes to the north and the east (two columns) and strength, for each level the flattened square of nodes."""

    slopes: tuple[Floats, ...]
    strength: tuple[Floats, ...]


class Texture:
    """The texture of one bottom."""

    def __init__(self, bottom: Bottom) -> None:
        kind = PROPERTIES[bottom.kind]
        height = kind.height if bottom.roughness is None else bottom.roughness
        patches = kind.patches if bottom.patches is None else bottom.patches
        self._tiles = _tiles(bottom.seed, kind.exponent)
        self._height, self._patches = np.float32(height), np.float32(patches)
        self.height = float(height)  # m, of the relief
        self.echo = kind.echo  # dB, re sand
        wave = tau / bottom.ripple_length
        self._wave = np.float32(wave * cos(bottom.ripple_heading)), np.float32(wave * sin(bottom.ripple_heading))
        self._ripple, self._length = 0.5 * bottom.ripple_height, bottom.ripple_length

    def sample(self, north: Any, east: Any, footprint: float) -> tuple[Floats, Floats, Floats]:
        """Return slopes to the north and the east, in addition to the grid's, and echo strength at positions (m, NED).

        The strength is relative to its mean (dB). A camera's brightness varies by about as much.
        """
        level, row, column = _nodes(north, east, footprint)
        side = _SIDE >> level
        slopes = self._tiles.slopes[level].take((row & (side - 1)) * side + (column & (side - 1)), axis=0)
        to_north, to_east = self._height * slopes[..., 0], self._height * slopes[..., 1]
        ripple = self._ripple * float(np.sinc(footprint / self._length)) if footprint < self._length else 0.0
        if ripple:
            along, across = self._wave
            rise = np.float32(ripple) * np.cos(along * np.float32(north) + across * np.float32(east))
            to_north, to_east = to_north + along * rise, to_east + across * rise
        # Patches are twice as large as the relief's nodes, so they repeat after twice the distance.
        strength = self._tiles.strength[level].take(((row >> 1) & (side - 1)) * side + ((column >> 1) & (side - 1)))
        return to_north, to_east, self._patches * strength

    @property
    def ripples(self) -> tuple[float, float, float, float]:
        """Return the ripples' wave numbers to the north and the east (rad/m), their amplitude and length (m)."""
        return float(self._wave[0]), float(self._wave[1]), self._ripple, self._length

    def tiles(self) -> Floats:
        """Return slopes to the north and east for a relief of 1 m, and brightness as a factor, each with all levels.

        For sim/native/_picture.c. Nodes are `NODE` m apart at the finest level, twice that at the next, and so on.
        """
        factors = [np.float32(10.0) ** (self._patches * level * np.float32(0.05)) for level in self._tiles.strength]
        slopes = [level[:, axis] for axis in (0, 1) for level in self._tiles.slopes]
        return np.concatenate([*slopes, *factors]).astype(np.float32)


def smooth_slopes(terrain: Terrain, north: Any, east: Any) -> tuple[Floats, Floats]:
    """Return the slopes of a terrain at positions (m, NED), bilinear between those of its nodes.

    The slopes of the surface itself jump from cell to cell, which would be visible as facets in a picture. The result
    is 0 beyond the grid and near nodes without data.
    """
    _, _, _, rows, columns = terrain.grid
    x, y = terrain.coordinates(np.asarray(north), np.asarray(east))  # type: ignore[arg-type]
    row = np.clip(x, 0.0, rows - 1.001).astype(np.int64)
    column = np.clip(y, 0.0, columns - 1.001).astype(np.int64)
    u, v = np.float32(np.clip(x - row, 0.0, 1.0)), np.float32(np.clip(y - column, 0.0, 1.0))
    depths = np.asarray(terrain.depths, np.float32)

    def at(i: Any, j: Any) -> Any:
        return depths.take(np.clip(i, 0, rows - 1) * columns + np.clip(j, 0, columns - 1))

    block = [[at(row + i, column + j) for j in (-1, 0, 1, 2)] for i in (-1, 0, 1, 2)]
    scale = np.float32(0.5 * terrain.scale)
    down = [[(block[i + 1][j] - block[i - 1][j]) for j in (1, 2)] for i in (1, 2)]
    across = [[(block[i][j + 1] - block[i][j - 1]) for j in (1, 2)] for i in (1, 2)]
    outside = (x < 0.0) | (y < 0.0) | (x > rows - 1) | (y > columns - 1)
    slopes = []
    for (a, b), (c, d) in (down, across):
        slope = scale * ((a + (b - a) * v) * (1.0 - u) + (c + (d - c) * v) * u)
        slopes.append(np.nan_to_num(np.where(outside, 0.0, slope)).astype(np.float32))
    return slopes[0], slopes[1]


def _nodes(north: Any, east: Any, footprint: float) -> tuple[int, NDArray[np.int32], NDArray[np.int32]]:
    """Return the level whose nodes are about as far apart as the footprint, and the rows and columns of its nodes."""
    level = min(max(round(float(np.log2(max(footprint / NODE, 1.0)))), 0), _LEVELS - 1)
    scale = np.float32(1.0 / (NODE * 2**level))
    row = np.floor(np.asarray(north, np.float32) * scale).astype(np.int32)
    return level, row, np.floor(np.asarray(east, np.float32) * scale).astype(np.int32)


@lru_cache(maxsize=4)
def _tiles(seed: int, exponent: float) -> _Tiles:
    """Return the tiles of a relief of standard deviation 1 m, and of a strength of standard deviation 1."""
    random = np.random.default_rng((seed, 17))
    down, across = np.fft.fftfreq(_SIDE)[:, None], np.fft.rfftfreq(_SIDE)[None, :]
    frequency = np.sqrt(down * down + across * across)  # cycles a node
    frequency[0, 0] = np.inf
    relief = np.fft.rfft2(random.standard_normal((_SIDE, _SIDE))) * frequency ** (-0.5 * exponent)
    relief[frequency < NODE / OUTER] = 0.0
    relief /= np.fft.irfft2(relief, (_SIDE, _SIDE)).std()
    composition = np.fft.rfft2(random.standard_normal((_SIDE, _SIDE))) / frequency
    composition /= np.fft.irfft2(composition, (_SIDE, _SIDE)).std()
    per_metre = tau / NODE
    spectra = relief * 1j * per_metre * down, relief * 1j * per_metre * across, composition
    north, east, strength = (_pyramid(np.fft.irfft2(spectrum, (_SIDE, _SIDE))) for spectrum in spectra)
    return _Tiles(tuple(np.stack(pair, axis=-1) for pair in zip(north, east, strict=True)), strength)


def _pyramid(tile: NDArray[np.float64]) -> tuple[Floats, ...]:
    levels = [tile]
    for _ in range(_LEVELS - 1):
        last = levels[-1]
        levels.append(0.25 * (last[::2, ::2] + last[1::2, ::2] + last[::2, 1::2] + last[1::2, 1::2]))
    return tuple(level.astype(np.float32).ravel() for level in levels)

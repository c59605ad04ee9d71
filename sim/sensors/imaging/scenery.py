"""Appearance of surfaces without water: colours, texture, daylight and lamps.

Made up, but the same for the same world in every run, and the same from wherever it is seen: colours go by what a thing
is and how steep and how bent it is, grain by its place. Numbers are shares of what a white surface would send back.
Not modelled: shadows of daylight, gloss, a texture that goes with what moves.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.environment.optics import Rgb
from sim.environment.terrain import Terrain
from sim.environment.world import World
from sim.rays.geometry import SEABED

if TYPE_CHECKING:
    from sim.environment.texture import Texture

_SAND, ROCK = (0.42, 0.36, 0.26), (0.17, 0.16, 0.14)
# By the kind of a world's `[bottom]`.
_GROUNDS = {"mud": (0.22, 0.19, 0.14), "sand": _SAND, "gravel": (0.30, 0.28, 0.24), "rock": ROCK}
FINEST = 0.01  # m: of a pixel on the seabed
Pixels = NDArray[np.float32]

# Concrete, rust, paint in yellow, weed, paint in red, bare metal; objects take them in turn.
_PAINTS = (
    (0.33, 0.32, 0.29), (0.25, 0.11, 0.05), (0.60, 0.42, 0.05), (0.10, 0.16, 0.05), (0.45, 0.07, 0.05), (0.4, 0.4, 0.4),
)  # fmt: skip
_SIDE = 512  # nodes of the grain along each side, a power of two; then it repeats itself
SCALES = ((0.01, 0.16), (0.089, 0.11))  # m from node to node, and standard deviation: 5 m and 46 m to a repetition


# Cosines to the vertical between which the sky's light fades at the edge of Snell's window, 49 deg, under small waves.
# Beyond it the surface mirrors the water below.
_EDGE = (0.62, 0.70)


class Seen(NamedTuple):
    """Hits of n rays in m, NED; without a hit point and normal are 0 and the range is inf.

    `points` and `normals` are three rows of n; `facing` is the cosine of incidence; `footprint` how far apart
    neighbouring rays are there.
    """

    points: Pixels
    normals: Pixels
    objects: NDArray[np.int32]
    ranges: Pixels
    facing: Pixels
    footprint: Pixels


class Beam(NamedTuple):
    """The light of a lamp at n hits: how far (m) it came, and the cosine of its incidence, 0 in the shadow."""

    ranges: Pixels
    facing: Pixels


class Scenery:
    """The looks of a world; `surface` is the number of the water's surface among the objects."""

    def __init__(self, world: World, surface: int) -> None:
        paints = [_PAINTS[i % len(_PAINTS)] for i in range(surface - 1)]
        self.colours = np.array([_SAND, *paints, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)], np.float32)  # the last: NOTHING
        for number, colour, _ in world.appearances():
            if colour:
                self.colours[number] = colour
        self.surface = surface
        self.terrain, self.bottom_map = world.terrain, world.bottom_map
        if world.bottom:
            from sim.environment.texture import Texture

            self.colours[SEABED] = _GROUNDS[world.bottom.kind]
        self.texture = Texture(world.bottom) if world.bottom else None

    def add(self, number: int) -> None:
        """Add an object, the `number`-th."""
        self.colours = np.insert(self.colours, number, _PAINTS[(number - 2) % len(_PAINTS)], axis=0)

    def radiance(
        self,
        seen: Seen,
        light: Rgb,
        lamps: float,
        attenuation: Rgb,
        beams: Sequence[Beam] | None = None,
        dapple: Pixels | None = None,
        veil: Rgb = (0.0, 0.0, 0.0),
    ) -> Pixels:
        """Return the radiance (n x 3) of each hit in daylight, of which `light` is left, and in lamps.

        `lamps` is what a white surface 1 m before them would send back; their light is weakened on its way by
        `attenuation` (1/m). `beams` are those of the single lamps, by default of one at the camera; `dapple` is what
        waves make of the daylight from above, `veil` what the surface mirrors of the water. One colour lies after the
        other in memory, which is quick.
        """
        seabed, surface = seen.objects == SEABED, seen.objects == self.surface
        tone = np.where(surface, np.float32(1.0), _grain(seen))
        if self.terrain is not None and seabed.any():
            tone[seabed] *= self._bent(seen.points[:, seabed])
        if self.texture is not None and seabed.any():
            tone[seabed] *= self._textured(self.texture, seen, seabed)
        ground: Pixels | None = None
        if self.bottom_map is not None and seabed.any():
            north, east = seen.points[:2, seabed]
            ground, texture = self.bottom_map.appearances(north, east, self.colours[SEABED])
            tone[seabed] = np.maximum(np.float32(0.1), 1.0 + (tone[seabed] - 1.0) * texture)
        # From above as from a sky that is evenly bright, and a fifth from all sides.
        day = tone * (np.float32(0.6) - np.float32(0.4) * seen.normals[2])
        sky = _window(seen.facing[surface])
        day[surface] = sky
        if dapple is not None:
            day *= dapple
        if beams is None:
            beams = [Beam(seen.ranges, seen.facing)]
        # Sand where the seabed is level, rock where it is steep, paint for the rest.
        rock = np.clip((np.float32(0.93) + seen.normals[2]) / np.float32(0.12), 0.0, 1.0) * seabed
        radiance = np.empty((3, len(tone)), np.float32)
        for channel, out in enumerate(radiance):
            np.multiply(day, np.float32(light[channel]), out)
            if lamps:
                share = np.float32(lamps / len(beams))
                for beam in beams:
                    out += tone * share * _lamplight(beam, attenuation[channel]) * ~surface
            colour = self.colours[:, channel].take(seen.objects, mode="wrap")
            darker: np.float32 | Pixels = np.float32(ROCK[channel] - self.colours[SEABED, channel])
            if ground is not None:
                colour[seabed] = ground[:, channel]
                darker = np.float32(ROCK[channel]) - colour
            out *= colour + rock * darker
            out[surface] += (np.float32(1.0) - sky) * np.float32(veil[channel])
        pixels: Pixels = radiance.T
        return pixels

    @staticmethod
    def _textured(texture: "Texture", seen: Seen, seabed: NDArray[np.bool_]) -> Pixels:
        """Return the brightness by what is smaller than the grid: patches, and slopes that lean towards the camera.

        Daylight comes from everywhere, so a slope shows by how much less of the sky it sees.
        """
        north, east, _ = seen.points[:, seabed]
        footprints = seen.footprint[seabed]
        level = np.round(np.log2(np.maximum(footprints, np.float32(FINEST)) / np.float32(FINEST))).astype(int)
        shade = np.empty(len(north), np.float32)
        for one in np.unique(level):
            some, size = level == one, FINEST * 2.0 ** int(one)
            to_north, to_east, strength = texture.sample(north[some], east[some], size)
            steep = to_north * to_north + to_east * to_east
            # A fifth of the light comes from the side, from the north-east, as under a low sun.
            lean = np.clip(np.float32(0.5) * (to_north + to_east), -0.5, 0.5)
            bright = np.float32(10.0) ** (strength * np.float32(0.05))
            shade[some] = bright * (np.float32(0.8) / np.sqrt(np.float32(1.0) + steep) + np.float32(0.2) + lean)
        return shade

    def _bent(self, points: Pixels) -> Pixels:
        """Return the brightness by curvature of the nodes that are hit: crests are bright, hollows dark."""
        assert self.terrain is not None
        grid, scale = self.terrain.grid, self.terrain.scale
        rows = np.clip(((points[0] - grid.north_min) * scale + 0.5).astype(np.int32), 0, grid.rows - 1)
        columns = np.clip(((points[1] - grid.east_min) * scale + 0.5).astype(np.int32), 0, grid.columns - 1)
        first = rows.min(), columns.min()
        bend = _bend(self.terrain, range(first[0], rows.max() + 1), range(first[1], columns.max() + 1))
        bent: Pixels = bend[rows - first[0], columns - first[1]]
        return bent


def _lamplight(beam: Beam, attenuation: float) -> Pixels:
    """Return how much of it falls on things; on what faces the lamp 1 m away, without water, 1."""
    distances = np.clip(beam.ranges, np.float32(0.05), np.float32(1e4))
    falls: Pixels = (
        np.maximum(beam.facing, 0.0) * np.exp(distances * np.float32(-attenuation)) / (distances * distances)
    )
    return falls


def _window(facing: Pixels) -> Pixels:
    """Return the share of the sky in what the water's surface sends, by the cosine at which it is met."""
    low, high = _EDGE
    share: Pixels = np.clip((facing - np.float32(low)) / np.float32(high - low), 0.0, 1.0)
    return share


def _bend(terrain: Terrain, rows: range, columns: range) -> Pixels:
    """Return the brightness by curvature at nodes: how much higher than the mean of its neighbours each one lies."""
    grid = terrain.grid
    around_rows = np.clip(np.arange(rows.start - 1, rows.stop + 1), 0, grid.rows - 1)
    around_columns = np.clip(np.arange(columns.start - 1, columns.stop + 1), 0, grid.columns - 1)
    padded = np.asarray(terrain.depths, np.float32).reshape(grid.rows, grid.columns)[
        np.ix_(around_rows, around_columns)
    ]
    depths = padded[1:-1, 1:-1]
    around = 0.25 * (padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:])
    height = np.nan_to_num((around - depths) * np.float32(terrain.scale))
    bend: Pixels = np.clip(1.0 + 3.0 * height, 0.7, 1.3).astype(np.float32)
    return bend


def _grain(seen: Seen) -> Pixels:
    """Return the brightness by place, 1 in the mean; finer than the rays lie apart there is none."""
    north, east, down = seen.points
    x, y, z = np.abs(seen.normals)
    level = z >= 0.5
    u = np.where(~level & (x > y), east, north)
    v = np.where(level, east, down)
    tone = np.ones(len(u), np.float32)
    for node, deviation in SCALES:
        # A pixel sees the mean of the grain within it: of noise whose size falls with 1 / frequency, this much is left.
        left = np.float32(deviation) / np.maximum(np.float32(1.0), seen.footprint / np.float32(8.0 * node))
        tone += left * _interpolate_grain(u / np.float32(node), v / np.float32(node))
    bounded: Pixels = np.maximum(tone, np.float32(0.1))
    return bounded


def _interpolate_grain(u: Pixels, v: Pixels) -> Pixels:
    """Return the grain between its nodes, bilinear."""
    whole_u, whole_v = np.floor(u), np.floor(v)
    a, b = u - whole_u, v - whole_v
    row, column = whole_u.astype(np.int32) & (_SIDE - 1), whole_v.astype(np.int32) & (_SIDE - 1)
    tile = grain_tile()  # with its first row and column once more at its end
    first = row * (_SIDE + 1) + column
    corners = [tile.take(first + offset) for offset in (0, 1, _SIDE + 1, _SIDE + 2)]
    one = corners[0] + (corners[1] - corners[0]) * b
    other = corners[2] + (corners[3] - corners[2]) * b
    tone: Pixels = one + (other - one) * a
    return tone


@lru_cache(maxsize=1)
def grain_tile() -> Pixels:
    """Return noise whose amplitude falls with 1 / frequency, mean 0, standard deviation 1, flattened."""
    random = np.random.default_rng(1)
    spectrum = np.fft.rfft2(random.standard_normal((_SIDE, _SIDE)))
    down, across = np.fft.fftfreq(_SIDE)[:, None], np.fft.rfftfreq(_SIDE)[None, :]
    frequency = np.sqrt(down * down + across * across)
    frequency[0, 0] = np.inf
    tile = np.fft.irfft2(spectrum / frequency, (_SIDE, _SIDE))
    tile /= tile.std()
    return np.pad(tile, ((0, 1), (0, 1)), mode="wrap").astype(np.float32).ravel()

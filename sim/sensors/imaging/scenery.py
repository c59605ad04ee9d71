"""Appearance of surfaces without water: colours, texture, daylight and lamps.

The appearance is invented, but the same in every run of the same world and from every viewpoint. The colour depends on
the kind of object, its slope and its curvature, the grain on the position. Radiances are relative to that of a white
surface in full daylight. Not modelled: shadows of daylight, gloss, texture that moves with an object.
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
# Colours by the kind of a world's `[bottom]`.
_GROUNDS = {"mud": (0.22, 0.19, 0.14), "sand": _SAND, "gravel": (0.30, 0.28, 0.24), "rock": ROCK}
MIN_FOOTPRINT = 0.01  # m: the least size of a pixel on the seabed for which texture is computed
Pixels = NDArray[np.float32]

# Concrete, rust, yellow paint, weed, red paint, bare metal; successive objects have successive colours.
_PAINTS = (
    (0.33, 0.32, 0.29), (0.25, 0.11, 0.05), (0.60, 0.42, 0.05), (0.10, 0.16, 0.05), (0.45, 0.07, 0.05), (0.4, 0.4, 0.4),
)  # fmt: skip
_TILE_NODES = 512  # nodes of the grain's tile along each side, a power of two; the tile repeats
SCALES = ((0.01, 0.16), (0.089, 0.11))  # spacing of nodes (m) and standard deviation; the tiles are 5 m and 46 m wide


# Cosines to the vertical between which the light of the sky fades at the edge of Snell's window (49 deg), with small
# waves. Outside the window the surface reflects the water below.
_WINDOW_EDGE = (0.62, 0.70)


class SurfaceHits(NamedTuple):
    """Hits of n rays, NED in m; without a hit point and normal are 0 and the range is inf.

    `points` and `normals` are 3 x n; `cos_incidence` is the cosine of the angle of incidence; `footprint` (m) is the
    distance of neighbouring rays at the hit.
    """

    points: Pixels
    normals: Pixels
    objects: NDArray[np.int32]
    ranges: Pixels
    cos_incidence: Pixels
    footprint: Pixels


class LampLight(NamedTuple):
    """Light of a lamp at n hits: distance of the lamp (m) and cosine of the angle of incidence, 0 in the shadow."""

    ranges: Pixels
    cos_incidence: Pixels


class Scenery:
    """Appearance of a world; `surface` is the object number of the water's surface."""

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
        """Add the object `number`."""
        self.colours = np.insert(self.colours, number, _PAINTS[(number - 2) % len(_PAINTS)], axis=0)

    def radiance(
        self,
        surfaces: SurfaceHits,
        light: Rgb,
        lamps: float,
        attenuation: Rgb,
        lamp_lights: Sequence[LampLight] | None = None,
        veil: Rgb = (0.0, 0.0, 0.0),
    ) -> Pixels:
        """Return the radiance (n x 3) of each hit in daylight and in the light of lamps.

        `light` is the remaining daylight. `lamps` is the radiance of a white surface 1 m in front of the lamps, whose
        light `attenuation` (1/m) weakens on its path. `lamp_lights` is the light of each lamp, by default of one at the
        camera. `veil` is the radiance of the water that the surface reflects. The colours are separate blocks of
        memory, which is faster.
        """
        seabed, surface = surfaces.objects == SEABED, surfaces.objects == self.surface
        tone = np.where(surface, np.float32(1.0), _grain(surfaces))
        if self.terrain is not None and seabed.any():
            tone[seabed] *= self._curvature_brightness(surfaces.points[:, seabed])
        if self.texture is not None and seabed.any():
            tone[seabed] *= self._texture_brightness(self.texture, surfaces, seabed)
        ground_colours: Pixels | None = None
        if self.bottom_map is not None and seabed.any():
            north, east = surfaces.points[:2, seabed]
            ground_colours, texture = self.bottom_map.appearances(north, east, self.colours[SEABED])
            tone[seabed] = np.maximum(np.float32(0.1), 1.0 + (tone[seabed] - 1.0) * texture)
        # A uniformly bright sky above, and a fifth of the light from all sides.
        daylight = tone * (np.float32(0.6) - np.float32(0.4) * surfaces.normals[2])
        sky = _sky_share(surfaces.cos_incidence[surface])
        daylight[surface] = sky
        if lamp_lights is None:
            lamp_lights = [LampLight(surfaces.ranges, surfaces.cos_incidence)]
        # Sand where the seabed is level, rock where it is steep; objects have their own colour.
        rock = np.clip((np.float32(0.93) + surfaces.normals[2]) / np.float32(0.12), 0.0, 1.0) * seabed
        radiance = np.empty((3, len(tone)), np.float32)
        for channel, out in enumerate(radiance):
            np.multiply(daylight, np.float32(light[channel]), out)
            if lamps:
                share = np.float32(lamps / len(lamp_lights))
                for beam in lamp_lights:
                    out += tone * share * _lamplight(beam, attenuation[channel]) * ~surface
            colour = self.colours[:, channel].take(surfaces.objects, mode="wrap")
            rock_difference: np.float32 | Pixels = np.float32(ROCK[channel] - self.colours[SEABED, channel])
            if ground_colours is not None:
                colour[seabed] = ground_colours[:, channel]
                rock_difference = np.float32(ROCK[channel]) - colour
            out *= colour + rock * rock_difference
            out[surface] += (np.float32(1.0) - sky) * np.float32(veil[channel])
        pixels: Pixels = radiance.T
        return pixels

    @staticmethod
    def _texture_brightness(texture: "Texture", surfaces: SurfaceHits, seabed: NDArray[np.bool_]) -> Pixels:
        """Return the brightness of the seabed's texture, which is finer than the terrain grid: patches and slopes.

        Daylight is diffuse, so a slope is darker by the part of the sky that it does not face.
        """
        north, east, _ = surfaces.points[:, seabed]
        footprints = surfaces.footprint[seabed]
        level = np.round(np.log2(np.maximum(footprints, np.float32(MIN_FOOTPRINT)) / np.float32(MIN_FOOTPRINT))).astype(
            int
        )
        shade = np.empty(len(north), np.float32)
        for one in np.unique(level):
            some, size = level == one, MIN_FOOTPRINT * 2.0 ** int(one)
            to_north, to_east, strength = texture.sample(north[some], east[some], size)
            steep = to_north * to_north + to_east * to_east
            # A fifth of the light comes from the side, from the north-east, as under a low sun.
            sidelight = np.clip(np.float32(0.5) * (to_north + to_east), -0.5, 0.5)
            bright = np.float32(10.0) ** (strength * np.float32(0.05))
            shade[some] = bright * (np.float32(0.8) / np.sqrt(np.float32(1.0) + steep) + np.float32(0.2) + sidelight)
        return shade

    def _curvature_brightness(self, points: Pixels) -> Pixels:
        """Return the brightness by curvature at hits (3 x n) of the terrain: crests are bright, hollows are dark."""
        assert self.terrain is not None
        grid, scale = self.terrain.grid, self.terrain.scale
        rows = np.clip(((points[0] - grid.north_min) * scale + 0.5).astype(np.int32), 0, grid.rows - 1)
        columns = np.clip(((points[1] - grid.east_min) * scale + 0.5).astype(np.int32), 0, grid.columns - 1)
        first = rows.min(), columns.min()
        nodes = _node_brightness(self.terrain, range(first[0], rows.max() + 1), range(first[1], columns.max() + 1))
        brightness: Pixels = nodes[rows - first[0], columns - first[1]]
        return brightness


def _lamplight(beam: LampLight, attenuation: float) -> Pixels:
    """Return the irradiance of hits; it is 1 for a surface that faces the lamp at 1 m without water."""
    distances = np.clip(beam.ranges, np.float32(0.05), np.float32(1e4))
    received: Pixels = (
        np.maximum(beam.cos_incidence, 0.0) * np.exp(distances * np.float32(-attenuation)) / (distances * distances)
    )
    return received


def _sky_share(cos_incidence: Pixels) -> Pixels:
    """Return the sky's share of the light from the water's surface, by the cosine of incidence."""
    low, high = _WINDOW_EDGE
    share: Pixels = np.clip((cos_incidence - np.float32(low)) / np.float32(high - low), 0.0, 1.0)
    return share


def _node_brightness(terrain: Terrain, rows: range, columns: range) -> Pixels:
    """Return the brightness of terrain nodes by curvature: the height of each above the mean of its neighbours."""
    grid = terrain.grid
    around_rows = np.clip(np.arange(rows.start - 1, rows.stop + 1), 0, grid.rows - 1)
    around_columns = np.clip(np.arange(columns.start - 1, columns.stop + 1), 0, grid.columns - 1)
    padded = np.asarray(terrain.depths, np.float32).reshape(grid.rows, grid.columns)[
        np.ix_(around_rows, around_columns)
    ]
    depths = padded[1:-1, 1:-1]
    around = 0.25 * (padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:])
    height = np.nan_to_num((around - depths) * np.float32(terrain.scale))
    brightness: Pixels = np.clip(1.0 + 3.0 * height, 0.7, 1.3).astype(np.float32)
    return brightness


def _grain(surfaces: SurfaceHits) -> Pixels:
    """Return the brightness by position, 1 on average, without detail finer than the spacing of rays."""
    north, east, down = surfaces.points
    x, y, z = np.abs(surfaces.normals)
    level = z >= 0.5
    u = np.where(~level & (x > y), east, north)
    v = np.where(level, east, down)
    tone = np.ones(len(u), np.float32)
    for node, deviation in SCALES:
        # A pixel averages the grain within it: this is the remaining amplitude of noise with a 1 / frequency spectrum.
        remaining = np.float32(deviation) / np.maximum(np.float32(1.0), surfaces.footprint / np.float32(8.0 * node))
        tone += remaining * _interpolate_grain(u / np.float32(node), v / np.float32(node))
    bounded: Pixels = np.maximum(tone, np.float32(0.1))
    return bounded


def _interpolate_grain(u: Pixels, v: Pixels) -> Pixels:
    """Return the grain at coordinates in nodes, interpolated bilinearly."""
    whole_u, whole_v = np.floor(u), np.floor(v)
    a, b = u - whole_u, v - whole_v
    row, column = whole_u.astype(np.int32) & (_TILE_NODES - 1), whole_v.astype(np.int32) & (_TILE_NODES - 1)
    tile = grain_tile()  # its first row and column are repeated at its end
    first = row * (_TILE_NODES + 1) + column
    corners = [tile.take(first + offset) for offset in (0, 1, _TILE_NODES + 1, _TILE_NODES + 2)]
    one = corners[0] + (corners[1] - corners[0]) * b
    other = corners[2] + (corners[3] - corners[2]) * b
    tone: Pixels = one + (other - one) * a
    return tone


@lru_cache(maxsize=1)
def grain_tile() -> Pixels:
    """Return a flattened tile of noise with amplitude ~ 1 / frequency, mean 0 and standard deviation 1."""
    random = np.random.default_rng(1)
    spectrum = np.fft.rfft2(random.standard_normal((_TILE_NODES, _TILE_NODES)))
    down, across = np.fft.fftfreq(_TILE_NODES)[:, None], np.fft.rfftfreq(_TILE_NODES)[None, :]
    frequency = np.sqrt(down * down + across * across)
    frequency[0, 0] = np.inf
    tile = np.fft.irfft2(spectrum / frequency, (_TILE_NODES, _TILE_NODES))
    tile /= tile.std()
    return np.pad(tile, ((0, 1), (0, 1)), mode="wrap").astype(np.float32).ravel()

"""Texture of the seabed in a sonar's range bins: relief and composition below the grid's resolution, by place.

A ray's patch on the seabed may be metres long where the beam grazes, so the texture is that of the places of the bins,
interpolated between the hits of a beam's rays. By Lambert's rule a bin's echo goes with cos² of the angle of incidence,
which the slope of the texture changes; what it is made of adds dB. Not modelled: shadows within the texture.
"""

import numpy as np
from numpy.typing import NDArray

from sim.environment.texture import Texture
from sim.environment.world import World
from sim.rays.scene import SEABED
from sim.sensors.imaging.echoes import Bins, Echoes, Floats

_MOST = 10.0  # times the mean echo
_LEAST = 0.03  # of a cosine: nothing grazes more
_ROUGH = 0.3  # of the variance: a patch that faces away still scatters


def make_texture(world: World) -> Texture | None:
    """Return the texture of a world's bottom, None where it has none."""
    return Texture(world.bottom) if world.bottom else None


def shares_of(echoes: Echoes, bins: Bins, beams: int, texture: Texture | None, stride: int = 1) -> Floats:
    """Return what of the echoes is in each bin (beams x bins), the seabed's with its texture.

    `stride` neighbouring beams share one texture, as beams do that are much wider than they are apart.
    """
    if texture is None:
        return bins.shares(echoes, beams)
    seabed = echoes.object == SEABED
    return bins.shares(echoes, beams, ~seabed) + _textured(
        bins.shares(echoes, beams, seabed), echoes, bins, texture, stride
    )


def _textured(shares: Floats, echoes: Echoes, bins: Bins, texture: Texture, stride: int) -> Floats:
    """Return the seabed's `shares` with its texture."""
    assert echoes.ground is not None
    place, points, facing, shape = echoes.ground
    step, count = bins.step, bins.count
    on = (echoes.object[: len(points)] == SEABED) & np.isfinite(echoes.ranges[: len(points)])
    some = shares[::stride]
    here = np.flatnonzero(some > 0.0)
    if not on.any() or not len(here):
        return shares
    order, at = _order(echoes.ranges[: len(points)], on, shape, _row(bins))
    middles = bins.first + (np.arange(count) + 0.5) * step
    along = (np.arange(0, len(shares), stride) * _row(bins))[:, None] + middles
    position = np.interp(along.ravel()[here], at, np.arange(len(at), dtype=float))
    low = position.astype(np.int32)
    share = (position - low).astype(np.float32)
    north, east, cosine = (
        _between(known[order].astype(np.float32), low, share)
        for known in (points[:, 0] - place[0], points[:, 1] - place[1], facing)
    )
    np.maximum(cosine, np.float32(_LEAST), out=cosine)
    to_north, to_east, strength = texture.sample(north + np.float32(place[0]), east + np.float32(place[1]), step)
    # The level part of the ray's direction is how far the place is on the level, by range.
    change = (to_north * north + to_east * east) / middles.astype(np.float32)[here % count]
    tilted = np.maximum(1.0 - change / cosine, 0.0)
    factor = np.float32(1.0 - _ROUGH) * tilted * tilted + np.float32(_ROUGH)
    factor *= np.exp(np.float32(0.1 * np.log(10.0)) * strength)
    factors = np.ones(some.size, np.float32)
    factors[here] = np.minimum(factor, np.float32(_MOST))
    textured: Floats = shares * np.repeat(factors.reshape(some.shape), stride, axis=0)[: len(shares)]
    return textured


def _between(known: Floats, low: NDArray[np.int32], share: Floats) -> Floats:
    """Return the numbers that lie `share` of the way from the known one at `low` to the next."""
    numbers: Floats = np.append(np.diff(known), np.float32(0.0)).take(low)
    numbers *= share
    numbers += known.take(low)
    return numbers


def _row(bins: Bins) -> float:
    """Return an offset (m) beyond any range of a beam, with which all beams make one growing row."""
    return 4.0 * (bins.first + (bins.count + 2) * bins.step) + 1.0


def _order(
    ranges: Floats, on: NDArray[np.bool_], shape: tuple[int, ...], row: float
) -> tuple[NDArray[np.int64], Floats]:
    """Return the rays that met the seabed, beam by beam and from near to far, and where they stand in one long row."""
    rays = np.flatnonzero(on)
    at = (rays // shape[1]) * row + np.minimum(ranges[rays], 0.9 * row)
    order = np.argsort(at, kind="stable")
    return rays[order], at[order]
